"""Forward motion against exact solutions, an independent integration, and the energy account."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import textile_twin_core as ttc
from tests.dynamics.random_machines import closing_machine
from textile_twin_core.dynamics import Body, Load
from textile_twin_core.dynamics.loads import Backing, JointFriction, ShaftFriction, Spring, TorqueTable
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import Crank, RRRDyad

TURN = 2.0 * math.pi
TUFTING = ttc.machines.tufting()


def rotor(*loads: Load, inertia: float = 2.0, arm_kg: float = 0.0) -> Machine:
    """A flywheel; with `arm_kg` also a pendulum of 0.5 m."""
    bodies = (Body.flywheel(inertia), Body("arm", arm_kg, centroid=(1.0, 0.0)))
    return Machine("rotor", {"O": (0.0, 0.0)}, (Crank("arm", at="O", end="A", length_m=0.5),), bodies, loads)


def test_constant_torque_on_a_rotor() -> None:
    t = np.linspace(0.0, 3.0, 31)
    run = ttc.drive(rotor(), 5.0, 0.2, -4.0, t)
    assert np.allclose(run.omega_rad_s, -4.0 + 2.5 * t, atol=1e-12)
    assert np.allclose(run.theta_rad, 0.2 - 4.0 * t + 1.25 * t**2, atol=1e-12)
    assert np.allclose(run.alpha_rad_s2, 2.5)
    assert np.allclose(run.drive_work_J, 5.0 * (run.theta_rad - 0.2), atol=1e-11)
    (event,) = run.events
    assert event.kind == "reverses"
    assert event.time_s == pytest.approx(1.6, abs=1e-14)


def test_coast_down_by_viscous_and_dry_friction_ends_at_standstill() -> None:
    """J w' = -c w - M: w = (w0 + M/c) exp(-c t / J) - M/c, which ends at t = J/c ln(1 + c w0 / M)."""
    j, c, m, w0 = 2.0, 0.4, 1.5, 9.0
    t = np.linspace(0.0, 10.0, 101)
    run = ttc.drive(rotor(ShaftFriction(c, m)), 0.0, 0.0, w0, t, tolerance=1e-12)
    end = j / c * math.log1p(c * w0 / m)
    (stop,) = run.events
    assert stop.kind == "stops"
    assert stop.time_s == pytest.approx(end, abs=1e-11)
    moving = t < end
    exact = (w0 + m / c) * np.exp(-c * t[moving] / j) - m / c
    assert np.allclose(run.omega_rad_s[moving], exact, atol=1e-10)
    assert not run.omega_rad_s[~moving].any()
    assert run.load_work_J["shaft_friction"][-1] == pytest.approx(-0.5 * j * w0**2, rel=1e-11)


def test_dry_friction_holds_until_the_drive_breaks_it_loose() -> None:
    """Drive of 1 N m/s against 1.5 N m: it starts at 1.5 s, then w = (t - 1.5)^2 / (2 J)."""
    t = np.linspace(0.0, 4.0, 41)
    for sense in (1.0, -1.0):
        run = ttc.drive(rotor(ShaftFriction(0.0, 1.5)), lambda time, theta, omega, s=sense: s * time, 0.3, 0.0, t)
        assert [e.kind for e in run.events] == ["stops", "starts"]
        assert run.events[1].time_s == pytest.approx(1.5, abs=1e-14)
        assert np.allclose(run.omega_rad_s, sense * np.maximum(t - 1.5, 0.0) ** 2 / 4.0, atol=1e-9)


def test_a_swing_with_dry_friction_loses_its_work_each_half_and_sticks() -> None:
    """J w' = -3 sin a -+ M: between two dead points 3 (cos a2 - cos a1) = M |a2 - a1|."""
    angles = tuple(2.0 * math.pi * k / 48 for k in range(48))
    k_table = tuple(-3.0 * math.sin(a) for a in angles)
    run = ttc.drive(
        rotor(TorqueTable(angles, k_table), ShaftFriction(0.0, 0.2)), 0.0, 1.0, 0.0, np.linspace(0, 30, 301)
    )
    turns = [e.theta_rad for e in run.events]
    assert run.events[-1].kind == "stops"
    assert all(e.kind == "reverses" for e in run.events[:-1])
    for a, b in zip([1.0, *turns], turns, strict=False):
        assert 3.0 * (math.cos(b) - math.cos(a)) == pytest.approx(0.2 * abs(b - a), abs=1e-8)
    assert abs(3.0 * math.sin(turns[-1])) < 0.2


def test_pendulum_against_elliptic_functions() -> None:
    """A physical pendulum over its top: sin of half its angle from below is the Jacobi function sn."""
    run = ttc.drive(rotor(inertia=0.3, arm_kg=2.0), 0.0, -math.pi / 2, 8.0, np.linspace(0.0, 5.0, 51), tolerance=1e-13)
    inertia, moment = 0.3 + 2.0 * 0.25, 2.0 * 9.81 * 0.5
    frequency = mp.sqrt(mp.mpf(moment) / inertia)
    m = (mp.mpf(8.0) / (2 * frequency)) ** 2  # k^2 > 1: it turns round
    for time, theta in zip(run.time_s.tolist(), run.theta_rad.tolist(), strict=True):
        phase = mp.sqrt(m) * frequency * time
        half = (theta + math.pi / 2) / 2
        exact = mp.ellipfun("sn", phase, 1 / m)
        assert math.sin(half) == pytest.approx(float(exact), abs=2e-11)


@pytest.mark.parametrize(
    ("kind", "seed", "theta0", "omega0"), [("coupler dyad", 149, -1.555, -52.3), ("coupler dyad", 274, 2.6859, 44.99)]
)
def test_a_step_whose_error_the_integrator_does_not_see_is_repeated(
    kind: str, seed: int, theta0: float, omega0: float
) -> None:
    """DOP853 makes a step a hundred times less accurate than its estimate; the energy account shows it."""
    machine, t = closing_machine(kind, np.random.default_rng(seed)), np.linspace(0.0, 1.0, 11)
    run, exact = (ttc.drive(machine, 0.0, theta0, omega0, t, tolerance) for tolerance in (1e-10, 1e-13))
    assert np.abs(run.theta_rad - exact.theta_rad).max() < 1e-7
    assert np.abs(run.energy_error_J).max() < 1e-8 * run.kinetic_energy_J.max()
    assert run.evaluations < 5000


def test_run_up_of_the_tufting_machine_against_another_integrator() -> None:
    """Radau integrates the twin's own torque between the same load steps, with its own step control."""
    machine = dataclasses.replace(TUFTING, bodies=(*TUFTING.bodies, Body.flywheel(0.15)))
    t = np.linspace(0.0, 1.5, 151)
    run = ttc.drive(machine, lambda time, theta, omega: 20.0 - 0.8 * omega, 0.0, 0.0, t)
    twin = ttc.compile(machine, ["balancing_torque_Nm", "equivalent_inertia_kgm2"], method="exact")

    def slope(time: float, y: np.ndarray) -> list[float]:
        now = twin.evaluate(float(y[0]), float(y[1]), 0.0)
        return [y[1], (20.0 - 0.8 * y[1] - now["balancing_torque_Nm"]) / now["equivalent_inertia_kgm2"]]

    other = solve_ivp(slope, (0.0, 1.5), [0.0, 0.0], method="Radau", t_eval=t, rtol=1e-8, atol=1e-8, max_step=2e-3)
    assert run.omega_rad_s[-1] > 5.0
    assert np.abs(run.theta_rad - other.y[0]).max() < 2e-5
    assert np.abs(run.energy_error_J).max() < 1e-8 * run.kinetic_energy_J.max()
    assert {e.loads for e in run.events if e.kind == "leaps"} == {("backing",)}
    entries = [e.theta_rad % (2.0 * math.pi) for e in run.events if e.kind == "leaps"]
    known = sorted(e.angle_rad for e in machine.events())
    assert all(min(abs(a - b) for b in known) < 1e-12 for a in entries)


@pytest.mark.parametrize(
    "loads",
    [
        (),
        TUFTING.loads,
        (JointFriction("l3", 0.4), JointFriction("l5", 0.2, against="l4"), Spring("C", "E", 300.0, 0.1)),
    ],
    ids=["gravity alone", "backing", "joints and a spring"],
)
def test_energy_is_booked(loads: tuple[Load, ...]) -> None:
    machine = dataclasses.replace(TUFTING, loads=loads, bodies=(*TUFTING.bodies, Body.flywheel(0.3)))
    run = ttc.drive(machine, lambda time, theta, omega: 6.0 * math.cos(3.0 * time), 0.0, 16.0, 2.0)
    scale = run.kinetic_energy_J.max() + np.abs(run.drive_work_J).max()
    assert np.abs(run.energy_error_J).max() < 1e-8 * scale
    for work in run.load_work_J.values():
        assert work.shape == run.time_s.shape


def test_loads_of_two_phased_linkages_step_at_their_own_angles() -> None:
    phases = (0.0, math.pi / 3)
    machine = dataclasses.replace(
        TUFTING,
        linkages=tuple(ttc.machines.ShaftPlace(p) for p in phases),
        bodies=(*TUFTING.bodies, Body.flywheel(5.0)),
    )
    run = ttc.drive(machine, 30.0, 0.0, 16.0, 0.5)
    found = [e.theta_rad for e in run.events if e.theta_rad < 2.0 * math.pi]
    entries = [e.angle_rad for e in TUFTING.events() if "backing" in e.name]
    reached = [a for e in entries for p in phases if (a := (e - p) % (2.0 * math.pi)) < run.theta_rad[-1]]
    assert len(reached) >= 3
    for angle in reached:
        assert min(abs(angle - f) for f in found) < 1e-12


class TestTables:
    def test_torque_over_time(self) -> None:
        torque = ttc.TorqueOverTime((0.5, 1.0, 2.0), (0.0, 4.0, 1.0))
        run = ttc.drive(rotor(), torque, 0.0, 0.0, np.linspace(0.0, 3.0, 7))
        impulse = [0.0, 0.0, 1.0, 1.0 + 0.5 * (4.0 + 2.5) / 2, 3.5, 4.0, 4.5]
        assert np.allclose(run.omega_rad_s * 2.0, impulse, atol=1e-12)
        assert np.allclose(run.drive_torque_Nm, [0.0, 0.0, 4.0, 2.5, 1.0, 1.0, 1.0])

    def test_torque_over_angle(self) -> None:
        angles = tuple(2.0 * math.pi * k / 12 for k in range(12))
        torque = ttc.TorqueOverAngle(angles, tuple(2.0 + math.sin(a) for a in angles))
        run = ttc.drive(rotor(), torque, 0.0, 1.0, np.linspace(0.0, 3.0, 31), tolerance=1e-12)
        work = 2.0 * run.theta_rad + 1.0 - np.cos(run.theta_rad)
        assert np.allclose(run.drive_work_J, work, atol=1e-10)
        assert np.allclose(run.omega_rad_s**2, 1.0 + work, rtol=1e-10)

    @pytest.mark.parametrize(
        ("times", "torques", "message"),
        [
            ((0.0,), (1.0,), "two or more times"),
            ((0.0, 1.0), (1.0,), "as many torques"),
            ((0.0, 1.0, 1.0), (1.0, 2.0, 3.0), "point 2 at 1.0 s follows 1.0 s"),
            ((0.0, math.nan), (1.0, 2.0), "finite"),
        ],
    )
    def test_bad_tables(self, times: tuple[float, ...], torques: tuple[float, ...], message: str) -> None:
        with pytest.raises(ttc.MotionError, match=message):
            ttc.TorqueOverTime(times, torques)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"theta0": math.nan}, "theta0 must be a finite number"),
        ({"omega0": math.inf}, "omega0 must be a finite number"),
        ({"t": [0.0, 0.0]}, "rising times"),
        ({"t": -1.0}, "rising times"),
        ({"t": [1.0]}, "rising times"),
        ({"tolerance": 0.0}, "tolerance must lie between"),
        ({"drive_torque": "much"}, "must be a number or a function"),
        ({"drive_torque": math.nan}, "drive torque is nan at 0 s"),
        ({"machine": dataclasses.replace(TUFTING, bodies=(), loads=())}, "no inertia"),
    ],
)
def test_bad_arguments(arguments: dict[str, object], message: str) -> None:
    usual: dict[str, object] = {"machine": TUFTING, "drive_torque": 1.0, "theta0": 0.0, "omega0": 1.0, "t": 1.0}
    with pytest.raises(ttc.TwinError, match=message):
        ttc.drive(**(usual | arguments))  # type: ignore[arg-type]


@pytest.mark.parametrize("loads", [(), (JointFriction("l3", 0.01),)], ids=["free", "friction"])
def test_a_linkage_driven_into_its_toggle_says_where(loads: tuple[Load, ...]) -> None:
    dyad = RRRDyad("l2", "l3", "A", "C", "B", (2.0, 1.5))
    groups = (Crank("l1", at="O", end="A", length_m=2.0), dyad)
    points, bodies = {"O": (0.0, 0.0), "C": (3.0, 0.0)}, (Body("l1", 1.0, 0.3), Body("l3", 1.0, 0.2))
    machine = Machine("open", points, groups, bodies, loads, range_rad=(0.7, 1.4))
    with pytest.raises(ttc.MotionError, match=r"cannot close at a shaft angle of (8[67]|9\d)\.\d+ deg, reached at"):
        ttc.drive(machine, 5.0, 1.0, 3.0, 1.0)


def test_two_planes_of_the_backing_are_met_in_both_directions() -> None:
    """The needle enters at the exit plane when the shaft turns back: the planes exchange their roles."""
    backing = Backing("needle", 300.0, 0.5565, 0.5585, 20.0)
    machine = dataclasses.replace(TUFTING, loads=(backing,), bodies=(*TUFTING.bodies, Body.flywheel(0.5)))
    twin = ttc.compile(machine, ["needle_position_m"], method="exact")
    for omega in (16.0, -16.0):
        run = ttc.drive(machine, 0.0, 4.5, omega, 0.45)
        depths = [twin.evaluate(e.theta_rad, 0.0, 0.0)["needle_position_m"] for e in run.events if e.kind == "leaps"]
        planes = [d for d in depths if min(abs(d - 0.5565), abs(d - 0.5585)) < 1e-12]
        assert planes[:2] == pytest.approx([0.5565, 0.5585], abs=1e-12)
        assert len(depths) > len(planes)  # at its dead points free friction turns
        assert np.abs(run.energy_error_J).max() < 1e-8 * run.kinetic_energy_J.max()


def test_other_machines_have_no_drive() -> None:
    with pytest.raises(ttc.MachineError, match="no linkage machine"):
        ttc.drive("tufting", 1.0, 0.0, 0.0, 1.0)  # type: ignore[arg-type]


def test_a_machine_without_masses_says_which() -> None:
    with pytest.raises(ttc.MachineError, match="gear_1_kg"):
        ttc.drive(ttc.machines.elliptic_gear_beatup(), 1.0, 0.0, 0.0, 1.0)


def test_load_steps_near_each_other_against_an_integration_between_their_exact_angles() -> None:
    """Two linkages 0.1 deg apart and a second backing just behind the first: every plane is met, each on its own."""
    near, planes = math.radians(0.1), (0.55784, 0.557841)
    backings = tuple(Backing("needle", 400.0, plane, plane) for plane in planes)
    machine = dataclasses.replace(
        TUFTING,
        linkages=(ttc.machines.ShaftPlace(), ttc.machines.ShaftPlace(near)),
        loads=backings,
        bodies=(*TUFTING.bodies, Body.flywheel(0.5)),
    )
    run = ttc.drive(machine, 6.0, 0.0, 14.0, 0.45, tolerance=1e-11)
    leaps = [e.theta_rad for e in run.events if e.kind == "leaps"]
    single = [
        event.angle_rad
        for plane in planes
        for event in ttc.machines.tufting(entry_plane_m=plane, exit_plane_m=plane).events()
    ]
    known = sorted({round((a - phase) % TURN, 11) for a in single for phase in (0.0, near)})
    expected = [turn * TURN + a for turn in (0, 1) for a in known if turn * TURN + a < run.theta_rad[-1]]
    assert leaps == pytest.approx(expected, abs=1e-10)

    twin = ttc.compile(machine, ["balancing_torque_Nm", "equivalent_inertia_kgm2"], method="exact")

    def slope(theta: float, y: np.ndarray) -> list[float]:
        """Over the angle, (time, speed); so that a stretch ends exactly at its angle."""
        now = twin.evaluate(theta, float(y[1]), 0.0)
        return [1.0 / y[1], (6.0 - now["balancing_torque_Nm"]) / now["equivalent_inertia_kgm2"] / y[1]]

    state = np.array([0.0, 14.0])
    for low, high in pairwise([0.0, *expected, float(run.theta_rad[-1])]):
        inner = (low + 1e-13, high - 1e-13)  # slightly inside, so that both sides of a step stay apart
        state = solve_ivp(slope, inner, state, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert run.time_s[-1] == pytest.approx(state[0], abs=1e-10)
    assert run.omega_rad_s[-1] == pytest.approx(state[1], abs=1e-8)


@pytest.mark.parametrize("depth_m", [1e-12, 2e-9, 1e-6])
def test_a_needle_that_barely_enters_the_backing_is_not_missed(depth_m: float) -> None:
    """The lowest point goes through the plane by so little that the needle is inside for a thousandth of a degree."""
    twin = ttc.compile(TUFTING, ["needle_position_m"], method="exact")
    lowest = next(e.angle_rad for e in TUFTING.events() if e.name == "needle_largest")
    deepest = twin.evaluate(lowest, 0.0, 0.0)["needle_position_m"]
    plane = deepest - depth_m
    machine = dataclasses.replace(
        TUFTING, loads=(Backing("needle", 1000.0, plane, plane),), bodies=(*TUFTING.bodies, Body.flywheel(0.5))
    )
    for omega in (15.0, -15.0):
        run = ttc.drive(machine, 0.0, 0.0, omega, 0.4, tolerance=1e-11)
        leaps = [e for e in run.events if e.kind == "leaps"]
        inside = [e for e in leaps if abs(math.remainder(e.theta_rad - lowest, TURN)) < 0.05]
        assert len(inside) in (2, 3)  # in, the turn of the friction where it is felt, out
        assert run.load_work_J["backing"][-1] == pytest.approx(-2000.0 * depth_m, rel=1e-3, abs=1e-11)


@pytest.mark.parametrize("torque", [18.0, 300.0])
def test_a_racing_shaft_is_followed(torque: float) -> None:
    """Trial steps across many turns overflow, the motion does not: its energy is that of the work done."""
    run = ttc.drive(TUFTING, torque, 0.3, 3400.0, np.linspace(0.0, 0.02, 41))
    assert run.omega_rad_s[-1] > 3400.0
    energy = run.kinetic_energy_J + run.potential_energy_J
    work = run.drive_work_J + sum(run.load_work_J.values())
    assert energy - energy[0] == pytest.approx(work, rel=1e-7, abs=1e-7 * energy[0])
