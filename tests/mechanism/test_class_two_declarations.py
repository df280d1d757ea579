"""Declarations that slotted dyads and gears reject, and their loads, tables, linkages and files."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.engine_peers.meeting import meeting
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import SliderFriction
from textile_twin_core.errors import MachineError
from textile_twin_core.files import load_machine_file, save_machine_file
from textile_twin_core.machine import Machine, ShaftPlace
from textile_twin_core.mechanism import (
    Crank,
    GearPair,
    Group,
    Guide,
    Linkage,
    PRPDyad,
    RPPDyad,
    RPRDyad,
    RRPDyad,
    RRRDyad,
    check_assembly,
)

O: dict[str, tuple[float, float]] = {"O": (0.0, 0.0)}
CRANK = Crank("crank", "O", "A", 0.06)
LEVER = RPRDyad("block", "lever", "A", "C", "B", "T", (0.03, 0.3))
C = O | {"C": (0.0, -0.15)}
ROUTES = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]


def gears(**changes: object) -> GearPair:
    return dataclasses.replace(GearPair("gear", "O", "C", "D", 0.05, (40, 20), "crank"), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("groups", "points", "says"),
    [
        ((CRANK, dataclasses.replace(LEVER, pivot="A")), C, "from and pivot are one point"),
        ((CRANK, dataclasses.replace(LEVER, offset_m=0.1)), C, "within offset_m"),
        (
            (CRANK, dataclasses.replace(LEVER, slot_m=(0.05, 0.2))),
            C,
            r"leaves its slot: it begins at .* at 0.2 m; lengthen",
        ),
        ((CRANK, LEVER, gears(at="A", driven_at="B", driver="lever")), C, "no link reaches from 'A' to 'B'"),
        ((CRANK, gears(at="A", driven_at="C")), C, "no link reaches"),
        ((CRANK, gears(driver=None)), C, "nothing turns the gear 'gear'"),
        ((CRANK, gears(teeth=(20, 40))), C, "makes -1/2 turns while .* only every 2 turns.* turns 2 times slower"),
        ((CRANK, gears(teeth=(30, 20))), C, "makes -3/2 turns"),
        ((CRANK, LEVER, gears(at="C", driven_at="O")), C, "'C' is no end of 'crank'"),
        ((CRANK, gears(driver="l9")), C, "no shaft 'l9'"),
    ],
)
def test_what_cannot_move_is_refused(
    groups: tuple[Group, ...], points: dict[str, tuple[float, float]], says: str
) -> None:
    with pytest.raises(MachineError, match=says):
        check_assembly(Linkage(points, groups))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: gears(teeth=(0, 20)), "teeth must be two whole numbers"),
        (lambda: gears(teeth=(20, 20), internal=True), "a ring needs more teeth"),
        (lambda: gears(driver="gear"), "one link"),
        (lambda: gears(pressure_angle_rad=1.0), "pressure_angle_rad"),
        (lambda: dataclasses.replace(LEVER, slot_m=(0.2, 0.1)), "two rising"),
        (lambda: dataclasses.replace(LEVER, branch="left"), "forward"),
        (
            lambda: RPPDyad("b", "s", "A", "Q", ("S", "T"), (0.1, 0.1), (0.0, 0.0), (1.0, 0.0), math.pi),
            "parallel to the",
        ),
        (lambda: PRPDyad(("a", "b"), "R", ("S", "T"), (0.1, 0.1), (Guide(), Guide())), "both guides are on one link"),
    ],
)
def test_what_is_no_group_is_refused(make: object, says: str) -> None:
    with pytest.raises(MachineError, match=says):
        make()  # type: ignore[operator]


RAM = RRPDyad("rod", "ram", "A", "D", "E", (0.2, 0.1), (0.1, 0.0), (1.0, 0.0), slot_m=(0.0, 0.15))
DIE = RPPDyad("die", "yoke", "A", "Q", ("S", "T"), (0.1, 0.1), (0.0, 0.0), (1.0, 0.0), slot_m=(-0.1, 0.05))
GUIDES = Guide("lever"), Guide(None, (0.0, 0.1), slot_m=(-0.1, 0.1))
CROSSING = PRPDyad(("die", "ram"), "R", ("S", "E"), (0.1, 0.1), GUIDES)


@pytest.mark.parametrize(
    ("group", "slider", "reach"), [(RAM, "ram", 0.16), (DIE, "die", 0.06), (CROSSING, "ram", 0.109)]
)
def test_every_slot_has_ends(group: Group, slider: str, reach: float) -> None:
    groups = (CRANK, LEVER, group) if isinstance(group, PRPDyad) else (CRANK, group)
    with pytest.raises(MachineError, match=f"leaves its slot: it begins .* deg where '{slider}' passes the end"):
        check_assembly(Linkage(C, groups))
    machine = Machine("open", C, tuple(_without_ends(g) for g in groups))
    name = f"joint_{slider}_position"
    ways = ttc.compile(machine, [name]).evaluate(np.linspace(0.0, 2.0 * math.pi, 721), 0.0, 0.0)[name]
    assert ways.max() == pytest.approx(reach, abs=1e-3)


def _without_ends(group: Group) -> Group:
    if isinstance(group, PRPDyad):
        one, two = (dataclasses.replace(guide, slot_m=None) for guide in group.guides)
        return dataclasses.replace(group, guides=(one, two))
    return dataclasses.replace(group, slot_m=None) if isinstance(group, (RRPDyad, RPPDyad)) else group


def test_guides_that_come_parallel_are_refused_with_the_angle() -> None:
    crossing = PRPDyad(("a", "b"), "R", ("S", "T"), (0.1, 0.1), (Guide("crank"), Guide(None, (0.0, 0.1), (0.0, 1.0))))
    with pytest.raises(MachineError, match=r"at a shaft angle of 90.0000 deg where the guides of 'a' and 'b' come par"):
        check_assembly(Linkage(O, (CRANK, crossing)))


def test_a_triad_is_refused_with_what_to_do() -> None:
    """Stephenson's third six-bar, driven on the side where it does not consist of dyads."""
    one = RRRDyad("l2", "l3", "A", "F", "B", (0.2, 0.2))
    two = RRRDyad("l4", "l5", "B", "C", "F", (0.2, 0.2))
    with pytest.raises(
        MachineError, match=r"groups 'l2-l3' and 'l4-l5' need points of each other: .* class III.*drive"
    ):
        _ = Linkage(C, (CRANK, one, two)).solved
    with pytest.raises(MachineError, match=r"put them in the order crank, block-lever, rod-ram"):
        ram = RRPDyad("rod", "ram", "B", "D", "E", (0.3, 0.1), (0.0, 0.1), (1.0, 0.0))
        _ = Linkage(C, (CRANK, ram, LEVER)).solved
    with pytest.raises(MachineError, match=r"no point 'X' is known before it; known points: O, C, A$"):
        _ = Linkage(C, (CRANK, RRRDyad("l2", "l3", "A", "X", "B", (0.2, 0.2)))).solved


def test_a_triad_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("points: {O: [0, 0]}\ngroups: [{type: rrr_triad, links: [a, b, c]}]\n", encoding="utf-8")
    with pytest.raises(MachineError, match=r"groups\[0\].type: no type 'rrr_triad'.*class III.*drive the chain from"):
        load_machine_file(path)


BODIES = tuple(Body(link, 0.7 + 0.2 * k, 2e-3, (0.4, 0.1)) for k, link in enumerate(("crank", "block", "lever")))
SHAPER = Machine(
    "shaper",
    C,
    (CRANK, LEVER, PRPDyad(("die", "ram"), "R", ("S", "E"), (0.02, 0.3), (Guide("lever"), Guide(None, (0.0, 0.1))))),
    (*BODIES, Body("die", 0.2, 1e-4), Body("ram", 3.0, 0.02)),
    (SliderFriction("block", 20.0), SliderFriction("die", 10.0), SliderFriction("ram", 30.0)),
    transmitted={"slot_moment_Nm": "block"},
)
GEARED = Machine(
    "geared",
    O | {"C": (0.2, 0.0)},
    (CRANK, gears(phase_rad=0.4), RRRDyad("coupler", "rocker", "A", "D", "B", (0.23, 0.2))),
    tuple(Body(link, 0.5, 1e-3, (0.4, 0.1)) for link in ("crank", "gear", "coupler", "rocker")),
)


def test_friction_in_moving_slots_costs_the_power_of_the_relative_speeds() -> None:
    theta = np.linspace(0.0, 6.2, 60)
    sliders = {"block": 20.0, "die": 10.0, "ram": 30.0}
    speeds = [f"joint_{name}_velocity" for name in sliders]
    v = ttc.compile(SHAPER, [*ROUTES, "torque_load_Nm", "slot_moment_Nm", *speeds]).evaluate(theta, -7.0, 20.0)
    peak = np.abs(v[ROUTES[0]]).max()
    assert np.abs(v[ROUTES[0]] - v[ROUTES[1]]).max() < 1e-12 * peak
    power = sum(force * np.abs(v[f"joint_{name}_velocity"]) for name, force in sliders.items())
    assert np.abs(v["torque_load_Nm"] * -7.0 - power).max() < 1e-12 * np.abs(power).max()
    assert np.isfinite(v["slot_moment_Nm"]).all()


@pytest.mark.parametrize("machine", [SHAPER, GEARED], ids=lambda machine: machine.name)
def test_two_linkages_tables_and_whole_turns(machine: Machine, tmp_path: Path) -> None:
    """Two linkages are the sum of both, the table holds its tolerance, and every turn is as the first."""
    theta = np.linspace(0.1, 6.1, 40)
    both = dataclasses.replace(machine, linkages=(ShaftPlace(), ShaftPlace(1.3)))
    (one,) = ttc.compile(machine, ROUTES[:1]).evaluate(theta, 9.0, 0.0).values()
    (other,) = ttc.compile(machine, ROUTES[:1]).evaluate(theta + 1.3, 9.0, 0.0).values()
    found = ttc.compile(both, ROUTES).evaluate(theta, 9.0, 0.0)
    peak = np.abs(one).max()
    for name in ROUTES:
        assert np.abs(found[name] - one - other).max() < 1e-12 * peak
    names = ["balancing_torque_Nm", *(f"theta_{link.name}_rad" for link in machine.links)]
    exact = ttc.compile(machine, names, method="exact")
    first, later = exact.evaluate(theta, 9.0, 0.0), exact.evaluate(theta + 14.0 * math.pi, 9.0, 0.0)
    assert np.abs(later[names[0]] - first[names[0]]).max() < 1e-11 * peak
    table = ttc.compile(dataclasses.replace(machine, loads=()), names, method="table", tolerance=1e-9)
    bare = ttc.compile(dataclasses.replace(machine, loads=()), names, method="exact")
    for name, values in bare.evaluate(theta, 9.0, 0.0).items():
        assert np.abs(table.evaluate(theta, 9.0, 0.0)[name] - values).max() < 1e-8 * max(np.abs(values).max(), 1.0)
    save_machine_file(machine, tmp_path / "m.yaml")
    assert load_machine_file(tmp_path / "m.yaml") == machine


def test_a_session_winds_the_gear_up_with_its_ratio() -> None:
    """The gear's angle goes on over the turns at -2 to 1, as samples of a wrapped encoder come in."""
    session = ttc.compile(GEARED, ["theta_gear_rad", "theta_crank_rad"]).session(shaft="causal")
    times = np.arange(4000) * 1_000_000
    wound = 25.0 * times * 1e-9
    found = session.step(times, np.mod(wound, 2.0 * math.pi))
    settled = found.settled
    gear, crank = found["theta_gear_rad"][settled], found["theta_crank_rad"][settled]
    assert np.ptp(crank) > 80.0
    assert np.abs(gear - (0.4 - 2.0 * crank)).max() < 1e-9


def test_a_ratio_that_is_no_whole_number_holds_over_a_part_of_a_turn() -> None:
    """A sector gear: 2 to 3, used over 100 degrees; shaft angles of other turns give the same places."""
    pair = gears(teeth=(20, 30), phase_rad=0.4)
    machine = Machine("sector", C, (CRANK, pair), (Body("gear", 1.0, 1e-3),), range_rad=(0.5, 2.2))
    twin = ttc.compile(machine, ["theta_gear_rad", "point_D_x_m"], method="exact")
    theta = np.linspace(0.5, 2.2, 9)
    first, later = twin.evaluate(theta, 0.0, 0.0), twin.evaluate(theta + 4.0 * math.pi, 0.0, 0.0)
    assert np.abs(first["theta_gear_rad"] - (0.4 - theta * 2.0 / 3.0)).max() < 1e-15 * 4
    assert np.abs(first["point_D_x_m"] - later["point_D_x_m"]).max() < 1e-14


def test_three_to_two_as_the_message_advises() -> None:
    """Both shafts make whole turns with a main shaft that turns once per cycle."""
    fast = GearPair("fast", "Z", "O", "A", 0.06, (60, 20), "main_shaft", internal=True, phase_rad=0.2)
    slow = GearPair("slow", "Z", "C", "D", 0.05, (40, 20), "main_shaft", internal=True, phase_rad=0.4, mesh="M")
    dyad = RRRDyad("coupler", "rocker", "A", "D", "B", (0.23, 0.2))
    points = O | {"C": (0.2, 0.0), "Z": (0.1, 0.3)}
    bodies = tuple(Body(link, 0.5, 1e-3, (0.4, 0.1)) for link in ("fast", "slow", "coupler", "rocker"))
    machine = Machine("cycle", points, (fast, slow, dyad), bodies)
    theta = np.linspace(-7.0, 9.0, 50)
    v = ttc.compile(machine, [*ROUTES, "point_B_x_m", "point_B_y_m"], method="exact").evaluate(theta, 3.0, 5.0)
    assert np.abs(v[ROUTES[0]] - v[ROUTES[1]]).max() < 1e-12 * np.abs(v[ROUTES[0]]).max()
    one, two = 0.06 * np.exp(1j * (3.0 * theta + 0.2)), 0.2 + 0.05 * np.exp(1j * (2.0 * theta + 0.4))
    places = [meeting(a, d, 0.23, 0.2, left=True) for a, d in zip(one.tolist(), two.tolist(), strict=True)]
    assert np.abs(v["point_B_x_m"] + 1j * v["point_B_y_m"] - np.array(places)).max() < 1e-14


def test_teeth_press_as_the_pressure_angle_says() -> None:
    """External teeth part the axes, a ring draws them together; the torque is the same."""
    theta, found = np.array([0.7, 2.0, 4.0]), {}
    names = ["reaction_P_x_N", "reaction_P_y_N", *ROUTES]
    for internal in (False, True):
        for angle in (0.0, math.radians(20.0)):
            pair = gears(internal=internal, pressure_angle_rad=angle)
            body = Body("gear", 2.0, 1e-2, (0.3, 0.2))
            machine = Machine("pair", O | {"C": (0.2, 0.0)}, (CRANK, pair), (body,))
            found[internal, angle] = ttc.compile(machine, names).evaluate(theta, 5.0, 40.0)
        plain, pressed = (found[internal, angle] for angle in (0.0, math.radians(20.0)))
        assert np.abs(plain["reaction_P_x_N"]).max() < 1e-12
        outward = np.abs(plain["reaction_P_y_N"]) * math.tan(math.radians(20.0)) * (-1.0 if internal else 1.0)
        assert np.abs(pressed["reaction_P_x_N"] - outward).max() < 1e-12 * np.abs(outward).max()
        for name in ROUTES:
            assert np.abs(pressed[name] - plain[ROUTES[0]]).max() < 1e-12 * np.abs(plain[ROUTES[0]]).max()
