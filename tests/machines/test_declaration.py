"""Contradictory declarations, which are rejected when the machine is built."""

from __future__ import annotations

import math
from typing import Any

import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Backing, Body
from textile_twin_core.machine import ShaftPlace
from textile_twin_core.mechanism import Arc, Crank, EllipticGearPair, RigidArm, RRRDyad, Travel

POINTS = {"O": (0.0, 0.0), "C": (0.3, 0.0)}
CRANK = Crank("l1", "O", "A", 0.06)
DYAD = RRRDyad("l2", "l3", "A", "C", "B", (0.2, 0.23))
TO_THE_RIGHT = {"point": "B", "origin": "O", "direction": (1.0, 0.0)}


def four_bar(**declared: Any) -> ttc.Machine:
    return ttc.Machine("loom", POINTS, **({"groups": (CRANK, DYAD)} | declared))


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ({"gravity_m_s2": (0.0, math.nan)}, "gravity_m_s2 must be a finite number"),
        ({"nominal_speed_rad_s": 0.0}, "nominal_speed_rad_s must be a positive speed"),
        ({"range_rad": (1.0, 0.0)}, "range_rad must be two rising, finite angles"),
        ({"angle_near_rad": {"l9": 1.0}}, "angle_near_rad names 'l9', which is no link; available: l1, l2, l3"),
        ({"joint_names": {"l9": "rod"}}, "joint_names names 'l9'"),
        ({"transmitted": {"torque_Nm": "l3"}}, "'l3', which is no rigid arm or slider; available: none"),
        ({"joint_names": {"l2": "main_shaft"}}, "'joint_main_shaft_position' would mean two things"),
        ({"measures": (Travel("sley", **TO_THE_RIGHT),) * 2}, "'sley_position_m' would mean two things"),
        ({"groups": (CRANK, RigidArm("1", "l1", "Q", 0.1))}, "'theta_1_rad' would mean two things"),
        ({"groups": (Crank("main_shaft", "O", "A", 0.06),)}, "the name of the shaft itself"),
        ({"measures": (Travel("sley", "B", "A", (1.0, 0.0)),)}, "origin 'A' must be fixed to the ground"),
        ({"measures": (Arc("sley", "l1", 0.06),)}, "link 'l1' turns round"),
        ({"loads": (Backing("needle", 1.0, 0.1, 0.1),)}, "no straight travel of this name; available: none"),
        ({"loads": (Backing("s", 1.0, 0.1, 0.1),), "measures": (Arc("s", "l3", 0.2),)}, "no straight travel"),
    ],
)
def test_refused(declared: dict[str, Any], said: str) -> None:
    with pytest.raises(ttc.MachineError, match=said):
        four_bar(**declared)


@pytest.mark.parametrize(
    ("declare", "said"),
    [
        (lambda: ShaftPlace(math.nan), "phase_rad must be a finite number"),
        (lambda: Arc("sley", "l3", -0.2), "radius_m must be a positive length"),
        (lambda: Arc("sley", "l3", 0.2, sense=2), "sense must be 1 or -1"),
        (lambda: Travel("sley", "B", "O", (math.nan, 0.0)), "direction must be a finite vector"),
        (lambda: Travel("sley", "B", "O", (0.0, 0.0)), "direction must be a finite vector"),
    ],
)
def test_refused_by_itself(declare: Any, said: str) -> None:
    with pytest.raises(ttc.MachineError, match=said):
        declare()


def test_joints_are_called_as_their_links_where_nothing_is_said() -> None:
    assert {j.child_link: j.name for j in four_bar(joint_names={"l3": "sword"}).joints} == {
        "l1": "main_shaft",
        "l2": "l2",
        "l3": "sword",
    }


def test_gears_have_joints_of_their_own() -> None:
    pair = EllipticGearPair("g1", "g2", "O", "C", ("F", "G"), axis_ratio=0.9)
    second = EllipticGearPair("g3", "g4", "C", "X", ("H", "K"), axis_ratio=1.0, mesh="Q", driven_by="g2")
    crank = Crank("l1", "X", "A", 0.06, driven_by="g4")
    machine = ttc.Machine("gears", {**POINTS, "X": (0.3, 0.4)}, (pair, second, crank), (Body("l1", 1.0, 0.01),))
    assert [j.name for j in machine.joints] == ["main_shaft", "g2", "g3", "g4", "l1"]
    turn = ttc.compile(machine, ["theta_g2_rad", "theta_g4_rad", "joint_l1_position"], "exact")
    begin, end = turn.evaluate(0.5), turn.evaluate(0.5 + 2.0 * math.pi)
    grown = [(end[name] - begin[name]) / (2.0 * math.pi) for name in turn.outputs]
    assert grown == pytest.approx([-1.0, 1.0, 1.0], abs=1e-14)
    routes = ttc.compile(machine, ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"], "exact")
    one, two = routes.evaluate(1.1, 20.0, 30.0).values()
    assert two == pytest.approx(one, rel=1e-12)


@pytest.mark.parametrize("name", ["tufting", "handloom_beatup", "elliptic_gear_beatup"])
def test_every_published_linkage_takes_the_parameters_of_its_sensors(name: str) -> None:
    given = {"encoder_zero_rad": 0.1, "torque_sensor_gain": 1.1, "torque_sensor_delay_s": 2e-3}
    machine = getattr(ttc.machines, name)(**given)
    encoder, torque = machine.sensors.encoder, machine.sensors.torque
    assert (encoder.zero_rad, torque.gain, torque.offset_Nm, torque.delay_s) == (0.1, 1.1, 0.0, 2e-3)
    assert {n: machine.parameters[n] for n in given} == given
    assert list(machine.parameters)[-4:] == list(ttc.machines.parameters_of(name))[-4:]
    with pytest.raises(TypeError, match="encoder_zero"):
        getattr(ttc.machines, name)(encoder_zero=0.1)
