"""Force over a measure: torque and reactions by other equations, work in closed form, drive, and wrong declarations."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from itertools import pairwise
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import textile_twin_core as ttc
from tests.generators.tufting_truth import truth
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import ForceCurve, TorqueTable

TUFTING = ttc.machines.tufting()
KNOTS = (0.55784, 0.5585, 0.5601, 0.5633, 0.5633, 0.5700, 0.5760)
IN_N = (250.0, 1200.0, 640.0, 580.0, 820.0, 900.0, 0.0)
OUT_N = (0.0, 120.0, 300.0, 310.0, 280.0, 350.0, 360.0)
CURVE = ForceCurve("backing", "needle_position_m", KNOTS, IN_N, OUT_N)
STEPPED = dataclasses.replace(TUFTING, loads=(CURVE,))
SPEED = 16.755
OUTPUTS = ["balancing_torque_Nm", "torque_load_Nm", "balancing_torque_newton_euler_Nm", "driven_shaft_torque_Nm"]
OUTPUTS += [f"reaction_{pin}_{axis}_N" for pin in "OABCDE" for axis in "xy"] + ["reaction_guide_N"]


def _law(below: Any, down: bool) -> Any:
    """The curve in extended precision, knot by knot."""
    values = IN_N if down else OUT_N
    for (low, begin), (high, end) in pairwise(zip(KNOTS, values, strict=True)):
        if mp.mpf(low) <= below < mp.mpf(high):
            return begin + (mp.mpf(end) - begin) * (below - mp.mpf(low)) / (mp.mpf(high) - mp.mpf(low))
    return mp.mpf(0)


@pytest.mark.parametrize("speed", [SPEED, -SPEED])
def test_torque_and_reactions_are_those_of_other_equations(speed: float) -> None:
    twin = ttc.compile(STEPPED, OUTPUTS, method="exact")
    angles = [0.37, 0.41, 0.7, 1.1, 1.9, 2.6, 3.1, 3.35, 5.0]
    found = twin.evaluate(np.array(angles), speed, 4.0)
    for k, angle in enumerate(angles):
        single = twin.evaluate(angle, speed, 4.0)
        true = truth(angle, speed, 4.0, digits=30, law=_law)
        for name in OUTPUTS:
            peak = np.abs(found[name]).max()
            assert found[name][k] == pytest.approx(float(true[name]), abs=1e-11 * peak)
            assert single[name] == pytest.approx(float(true[name]), abs=1e-11 * peak)


def test_monotone_curves_are_those_of_scipy() -> None:
    knots, forces = (0.0, 0.3, 0.5, 1.2, 1.3, 2.0), (0.0, 2.0, 1.9, 1.9, -1.0, -3.0)
    curve = ForceCurve("cloth", "sley_position_m", knots, forces, between="monotone")
    places = np.linspace(0.0, 1.999, 400)
    np.testing.assert_allclose(curve.values(places), PchipInterpolator(knots, forces)(places), atol=1e-13)


def test_work_between_two_depths_is_the_integral() -> None:
    with mp.workdps(30):
        stops = [mp.mpf(k) for k in (0.5581, 0.5585, 0.5601, 0.5633, 0.57, 0.575)]
        for down in (True, False):
            true = mp.quad(partial(_law, down=down), stops)
            assert CURVE.work_J(0.5581, 0.575, growing=down) == pytest.approx(float(true), rel=1e-13)
    smooth = dataclasses.replace(CURVE, between="monotone", knots=tuple(np.linspace(0.0, 0.018, 7).tolist()))
    with mp.workdps(20):
        pchip = PchipInterpolator(smooth.knots, smooth.in_N)
        assert smooth.work_J(0.001, 0.0173) == pytest.approx(float(pchip.integrate(0.001, 0.0173)), rel=1e-12)


def test_a_driven_shaft_meets_the_steps_alone_and_its_work_is_that_of_the_curve() -> None:
    """The knots bend the force; the events are the entry, the step inside, the exit and the dead points."""
    machine = dataclasses.replace(STEPPED, bodies=(*TUFTING.bodies, Body.flywheel(2.0)))
    run = ttc.drive(machine, 12.0, 4.6, SPEED, 0.36, tolerance=1e-11)
    place = ttc.compile(machine, ["needle_position_m"], method="exact")
    turned = [e for e in run.events if e.theta_rad < 4.6 + 2.0 * math.pi]
    depths = [float(place.evaluate(e.theta_rad, 0.0, 0.0)["needle_position_m"]) for e in turned]
    low, high = 0.54151, max(depths)
    assert depths == pytest.approx([low, KNOTS[0], KNOTS[3], high, KNOTS[3]], abs=1e-3)
    assert {e.loads for e in run.events} == {("backing",)}
    assert depths[1:3] == pytest.approx([KNOTS[0], KNOTS[3]], abs=1e-13)
    once = CURVE.work_J(0.5, high) + CURVE.work_J(0.5, high, growing=False)
    after_a_turn = float(np.interp(4.6 + 2.0 * math.pi, run.theta_rad, run.load_work_J["backing"]))
    assert after_a_turn == pytest.approx(-once, rel=1e-6)
    assert np.abs(run.energy_error_J).max() < 1e-8 * run.kinetic_energy_J.max()


def test_a_force_along_the_sley_by_virtual_work_and_by_newton_and_euler() -> None:
    loom = ttc.machines.create("handloom_beatup")
    if loom.missing_for_torque:
        bodies = tuple(Body(link, 1.0, 0.01) for link in loom.linkage.solved.links)
        loom = dataclasses.replace(loom, bodies=bodies, missing_for_torque=())
    (measure,) = loom.measures
    theta = loom.shaft_angles(720)
    name = f"{measure.name}_position_m"
    reach = ttc.compile(loom, [name], method="exact").evaluate(theta)[name].max()
    cloth = ForceCurve("cloth", name, (reach - 0.008, reach + 1e-6), (0.0, 900.0), (0.0, -500.0), speed_power=1,
                       at_speed_rad_s=20.0)  # fmt: skip
    machine = dataclasses.replace(loom, loads=(cloth,))
    outputs = ["torque_load_Nm", "balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]
    found = ttc.compile(machine, outputs, method="exact").evaluate(theta, 10.0, 3.0)
    peak = np.abs(found["torque_load_Nm"]).max()
    assert peak > 1.0
    two = [found[name] for name in outputs[1:]]
    np.testing.assert_allclose(two[0], two[1], atol=1e-11 * np.abs(two[0]).max())
    rate = ttc.compile(loom, [f"{measure.name}_velocity_m_s", name], method="exact").evaluate(theta, 10.0, 0.0)
    depth, slope = rate[name] - (reach - 0.008), rate[f"{measure.name}_velocity_m_s"] / 10.0
    inside = depth >= 0.0
    expected = 0.5 * np.where(slope > 0.0, 900.0, 500.0) * depth / (0.008 + 1e-6) * slope * inside
    np.testing.assert_allclose(found["torque_load_Nm"], expected, atol=1e-9 * peak)


def test_a_torque_over_the_crank_angle_is_that_of_a_table() -> None:
    angles = tuple((np.arange(400) * 2.0 * math.pi / 400).tolist())
    values = tuple((3.0 + np.sin(angles)).tolist())
    table = dataclasses.replace(TUFTING, loads=(TorqueTable(angles, values, scale=-1.0),))
    knots, forces = (*angles, 2.0 * math.pi), (*values, values[0])
    curve = dataclasses.replace(TUFTING, loads=(ForceCurve("brake", "theta_rad", knots, forces),))
    theta = np.linspace(-7.0, 20.0, 1500)
    one, other = (ttc.compile(m, ["torque_load_Nm"], "exact").evaluate(theta, 3.0) for m in (table, curve))
    np.testing.assert_allclose(one["torque_load_Nm"], other["torque_load_Nm"], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"knots": KNOTS[:-1]}, "in_N has 7 values for 6 knots"),
        ({"knots": KNOTS[::-1]}, "knots must rise"),
        ({"in_N": (math.nan, *IN_N[1:])}, "in_N must be finite"),
        ({"speed_power": 3, "at_speed_rad_s": 1.0}, "speed_power must be 0, 1 or 2"),
        ({"speed_power": 1}, "at_speed_rad_s must be a positive speed"),
    ],
)
def test_wrong_declarations_say_what(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ttc.MachineError, match=message):
        dataclasses.replace(CURVE, **change)


def test_an_unknown_measure_names_those_that_are_there() -> None:
    with pytest.raises(ttc.MachineError, match=r"'nedle_position_m' does not exist; available: needle_position_m"):
        dataclasses.replace(TUFTING, loads=(dataclasses.replace(CURVE, measure="nedle_position_m"),))
