"""Every load against its power computed by hand, and by both routes to the torque."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import Body, Load
from textile_twin_core.dynamics.loads import (
    Backing,
    ForceTable,
    JointDamping,
    JointFriction,
    PeriodicTable,
    PointDamping,
    ShaftFriction,
    SliderFriction,
    Spring,
    TorqueTable,
    TorsionSpring,
)
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import Crank, RRPDyad, RRRDyad

Values = dict[str, FloatArray]

MACHINE = ttc.machines.tufting()
TIP = ("point_T_x_m", "point_T_y_m")
THETA = np.linspace(-7.0, 9.0, 401)
OMEGA = np.linspace(-18.0, 21.0, 401)
ALPHA = 40.0 * np.sin(THETA)
ANGLES = tuple(2.0 * math.pi * k / 24 for k in range(24))
TABLE = tuple(1.0 + 3.0 * math.sin(a) - 2.0 * math.cos(3.0 * a + 0.2) for a in ANGLES)


def table(theta: FloatArray) -> FloatArray:
    return 1.0 + 3.0 * np.sin(theta) - 2.0 * np.cos(3.0 * theta + 0.2)


@lru_cache
def velocity(point: str) -> FloatArray:
    """Velocity of a point by central differences of its position over the angle, times the speed: (2, n)."""
    step = 1e-5
    names = [f"point_{point}_x_m", f"point_{point}_y_m"]
    twin = ttc.compile(MACHINE, names, method="exact")
    ahead, behind = twin.evaluate(THETA + step), twin.evaluate(THETA - step)
    return np.array([(ahead[o] - behind[o]) / (2.0 * step) for o in names]) * OMEGA


def place(v: Values, point: str) -> FloatArray:
    return np.array([v[f"point_{point}_x_m"], v[f"point_{point}_y_m"]])


def spring_power(v: Values, a: str, b: str, pull: Callable[[FloatArray], FloatArray]) -> FloatArray:
    way = place(v, b) - place(v, a)
    length = np.hypot(*way)
    return pull(length) * np.sum(way / length * (velocity(a) - velocity(b)), axis=0)


# load and its power on the machine [W]
CASES: dict[str, tuple[Load, Callable[[Values], FloatArray]]] = {
    "joint friction on the ground": (JointFriction("l3", 1.5), lambda v: -1.5 * np.abs(v["omega_3_rad_s"])),
    "joint friction of two links": (
        JointFriction("l2", 1.5, against="l3"),
        lambda v: -1.5 * np.abs(v["omega_2_rad_s"] - v["omega_3_rad_s"]),
    ),
    "joint friction on a slider": (JointFriction("l5", 2.0, against="l6"), lambda v: -2.0 * np.abs(v["omega_5_rad_s"])),
    "joint friction of an arm": (
        JointFriction("l4", 2.0, against="l5"),
        lambda v: -2.0 * np.abs(v["omega_4_rad_s"] - v["omega_5_rad_s"]),
    ),
    "slider friction": (SliderFriction("l6", 70.0), lambda v: -70.0 * np.abs(v["needle_velocity_m_s"])),
    "joint damping": (JointDamping("l2", 0.8), lambda v: -0.8 * v["omega_2_rad_s"] ** 2),
    "joint damping of two links": (
        JointDamping("l1", 0.8, against="l2"),
        lambda v: -0.8 * (v["omega_1_rad_s"] - v["omega_2_rad_s"]) ** 2,
    ),
    "damped slider": (PointDamping("F", 90.0), lambda v: -90.0 * v["needle_velocity_m_s"] ** 2),
    "damped joint": (PointDamping("B", 90.0), lambda v: -90.0 * np.sum(velocity("B") ** 2, axis=0)),
    "shaft friction": (ShaftFriction(0.3, 2.0), lambda v: -0.3 * OMEGA**2 - 2.0 * np.abs(OMEGA)),
    "spring on the ground": (
        Spring("O", "B", 4e3, 0.1, 5.0),
        lambda v: spring_power(v, "O", "B", lambda length: 4e3 * (length - 0.1) + 5.0),
    ),
    "spring of two points": (
        Spring("A", "E", 4e3, 0.2, -15.0),
        lambda v: spring_power(v, "A", "E", lambda length: 4e3 * (length - 0.2) - 15.0),
    ),
    "torsion spring": (
        TorsionSpring("l3", 50.0, 3.3, 2.0),
        lambda v: (50.0 * (3.3 - v["theta_3_rad"]) + 2.0) * v["omega_3_rad_s"],
    ),
    "torsion spring of two links": (
        TorsionSpring("l3", 50.0, 1.3, 2.0, against="l2"),
        lambda v: (50.0 * (1.3 - v["theta_3_rad"] + v["theta_2_rad"]) + 2.0)
        * (v["omega_3_rad_s"] - v["omega_2_rad_s"]),
    ),
    "torque table on the shaft": (TorqueTable(ANGLES, TABLE), lambda v: table(THETA) * OMEGA),
    "torque table on a link": (
        TorqueTable(ANGLES, TABLE, on="l3", scale=0.5),
        lambda v: 0.5 * table(THETA) * v["omega_3_rad_s"],
    ),
    "force table": (
        ForceTable("B", (3.0, -4.0), ANGLES, TABLE),
        lambda v: table(THETA) * (0.6 * velocity("B")[0] - 0.8 * velocity("B")[1]),
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def kinematics() -> Values:
    names = [n for n in MACHINE.outputs if n.startswith(("theta_", "omega_", "point_", "needle_velocity"))]
    return ttc.compile(MACHINE, names, method="exact").evaluate(THETA, OMEGA, ALPHA)


@pytest.mark.parametrize("name", CASES)
def test_power_by_hand(name: str, kinematics: Values) -> None:
    load, power = CASES[name]
    machine = dataclasses.replace(MACHINE, loads=(load,))
    torque = ttc.compile(machine, ["torque_load_Nm"], method="exact").evaluate(THETA, OMEGA, ALPHA)["torque_load_Nm"]
    expected = power(kinematics)
    by_differences = any(word in name for word in ("joint", "point", "spring", "force"))
    rounding = 1e-9 if by_differences else 1e-13
    assert np.abs(torque * OMEGA + expected).max() < rounding * np.abs(expected).max()


@pytest.mark.parametrize("name", CASES)
def test_both_routes(name: str) -> None:
    machine = dataclasses.replace(
        MACHINE,
        loads=(CASES[name][0], *MACHINE.loads),
        linkages=(ttc.machines.ShaftPlace(0.3),),
    )
    both = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]
    one, two = ttc.compile(machine, both, method="exact").evaluate(THETA, OMEGA, ALPHA).values()
    assert np.abs(one - two).max() < 1e-13 * np.abs(one).max()


def test_flywheel_and_counterweight() -> None:
    """A rotor adds its inertia; a point mass on the crank behind the shaft turns with its own weight and inertia."""
    arm, mass = 0.4, 2.0  # of the crank's length, kg
    bodies = (Body.flywheel(0.7, mass_kg=30.0), Body("l1", mass, centroid=(-arm, 0.0)))
    machine = dataclasses.replace(MACHINE, bodies=(*MACHINE.bodies, *bodies))
    wanted = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm", "equivalent_inertia_kgm2", "reaction_O_y_N"]
    more = ttc.compile(machine, wanted).evaluate(THETA, OMEGA, ALPHA)
    less = ttc.compile(MACHINE, wanted).evaluate(THETA, OMEGA, ALPHA)
    radius = arm * 0.015
    inertia = 0.7 + mass * radius**2
    assert np.allclose(more["equivalent_inertia_kgm2"] - less["equivalent_inertia_kgm2"], inertia, rtol=1e-13)
    torque = inertia * ALPHA - mass * 9.81 * radius * np.cos(THETA)
    for route in wanted[:2]:
        assert np.abs(more[route] - less[route] - torque).max() < 1e-13 * np.abs(more[route]).max()
    lift = radius * (np.sin(THETA) * OMEGA**2 - np.cos(THETA) * ALPHA)  # upward acceleration of the mass
    added = mass * (9.81 + lift)
    assert np.abs(more["reaction_O_y_N"] - less["reaction_O_y_N"] - added).max() < 1e-11 * np.abs(added).max()


def test_standstill_has_no_friction() -> None:
    machine = dataclasses.replace(MACHINE, loads=(JointFriction("l3", 5.0), ShaftFriction(1.0, 4.0), *MACHINE.loads))
    assert ttc.compile(machine, ["torque_load_Nm"]).evaluate(0.5, 0.0, 0.0) == {"torque_load_Nm": 0.0}


class TestPeriodicTable:
    @pytest.mark.parametrize("start", [0.0, 0.1])
    def test_evenly_spaced_values_of_few_harmonics_are_exact(self, start: float) -> None:
        angles = np.array(ANGLES) + start
        found = PeriodicTable("t", tuple(angles), tuple(table(angles)))
        assert np.allclose(found.coefficients, [1.0, -3.0j, 0.0, -2.0 * np.exp(0.2j)], atol=1e-14)

    def test_harmonics_cut_the_series(self) -> None:
        assert np.allclose(PeriodicTable("t", ANGLES, TABLE, harmonics=1).coefficients, [1.0, -3.0j], atol=1e-14)

    def test_uneven_measured_angles_are_met(self) -> None:
        rng = np.random.default_rng(5)
        angles = np.sort(rng.uniform(0.3, 6.2, 60))
        angles = angles[np.concatenate([[True], np.diff(angles) > 0.02])]
        values = np.exp(np.sin(angles)) + 0.3 * np.cos(5.0 * angles)
        found = PeriodicTable("t", tuple(angles), tuple(values))
        waves = np.exp(1j * np.outer(angles, np.arange(len(found.coefficients))))
        miss = np.abs((waves @ np.array(found.coefficients)).real - values).max()
        assert miss <= 1e-3 * np.ptp(values)

    def test_steep_edges_between_plateaus_do_not_ring(self) -> None:
        """The true curve is 0 and 100 on the plateaus and between them on the edges."""
        found = PeriodicTable("t", (0.0, 1.0, 1.1, 3.0, 3.1, 5.0), (0.0, 0.0, 100.0, 100.0, 0.0, 0.0), harmonics=300)
        theta = np.linspace(0.0, 2.0 * math.pi, 5001)
        waves = np.exp(1j * np.outer(theta, np.arange(len(found.coefficients))))
        series = (waves @ np.array(found.coefficients)).real
        high, low = (theta > 1.1) & (theta < 3.0), (theta < 1.0) | (theta > 3.1)
        assert np.abs(series[high] - 100.0).max() < 0.2
        assert np.abs(series[low]).max() < 0.2
        assert ((series > -0.2) & (series < 100.2)).all()

    @pytest.mark.parametrize(
        ("angles", "values", "message"),
        [
            ((0.0, 1.0), (1.0, 2.0), "at least three angles"),
            ((0.0, 1.0, 2.0), (1.0, 2.0), "as many values"),
            ((0.0, 2.0, 1.0), (1.0, 2.0, 3.0), "angles must rise"),
            ((0.0, 2.0, 2.0 * math.pi), (1.0, 2.0, 1.0), "within one turn"),
            ((0.0, 2.0, 6.283185307), (1.0, 2.0, 1.0), "the first not repeated"),
            ((0.0, 1e-300, 3.0), (1.0, 2.0, 1.0), "angles must rise"),
            ((0.0, 1.0, 2.0), (1.0, math.nan, 3.0), "finite"),
            (tuple(k * 0.01 for k in range(600)), (0.0,) * 300 + (1.0,) * 300, "harmonics miss a value by"),
        ],
    )
    def test_bad_tables(self, angles: tuple[float, ...], values: tuple[float, ...], message: str) -> None:
        with pytest.raises(ttc.MachineError, match=message):
            PeriodicTable("torque table", angles, values)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: JointFriction("l3", -1.0), "torque_Nm must be zero or positive"),
        (lambda: JointFriction("l3", 1.0, against="l3"), "friction of 'l3': against must be another link"),
        (lambda: JointDamping("l3", 1.0, against="l3"), "damping of 'l3': against must be another link"),
        (lambda: TorsionSpring("l3", 1.0, 0.0, against="l3"), "spring on 'l3': against must be another link"),
        (lambda: SliderFriction("l6", math.nan), "force_N must be zero or positive"),
        (lambda: JointDamping("l3", -0.1), "viscous_Nms must be zero or positive"),
        (lambda: PointDamping("B", math.inf), "viscous_Ns_m must be zero or positive"),
        (lambda: ShaftFriction(-1.0), "viscous_Nms must be zero or positive"),
        (lambda: Spring("A", "B", 0.0, 0.1), "stiffness must be positive"),
        (lambda: Spring("A", "A", 1.0, 0.1), "two different points"),
        (lambda: TorsionSpring("l3", 1.0, math.nan), "must be finite"),
        (lambda: Backing("needle", math.nan, 0.5, 0.5), "finite number"),
        (lambda: Backing("needle", -1.0, 0.5, 0.5), "force_N must be zero or positive, not -1"),
        (lambda: ForceTable("B", (0.0, 0.0), ANGLES, TABLE), "not zero"),
        (lambda: Body("l1", -1.0), "mass_kg must be zero or positive"),
        (lambda: Body("l1", 1.0, math.nan), "inertia_kgm2 must be zero or positive"),
    ],
)
def test_bad_numbers(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ttc.MachineError, match=message):
        make()


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (JointFriction("l9", 1.0), "'l9', which is not there; links: l1, l2"),
        (JointDamping("l2", 1.0, against="x"), "'x', which is not there"),
        (SliderFriction("needle", 1.0), "'needle', which is not there"),
        (SliderFriction("l3", 1.0), "friction of 'l3': this link is no slider"),
        (Spring("A", "Z", 1.0, 0.1), "no point 'Z'"),
        (PointDamping("Z", 1.0), "no point 'Z'"),
        (TorqueTable(ANGLES, TABLE, on="l7"), "'l7', which is not there"),
        (TorsionSpring("l1", 1.0, 0.0), "wind up for ever"),
    ],
)
def test_unknown_names(load: Load, message: str) -> None:
    with pytest.raises(ttc.MachineError, match=message):
        dataclasses.replace(MACHINE, loads=(load,))


@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 2, 2.5, -1.9, *np.radians([1, 2, 5, 118, -30])])
def test_friction_of_a_slider_on_any_guide(angle: float) -> None:
    """The friction force acts along the slider: the torque is slider speed per shaft speed times the force."""
    guide = (math.cos(angle), math.sin(angle))
    groups = (Crank("l1", "O", "A", 0.05), RRPDyad("rod", "slider", "A", "B", "T", (0.2, 0.1), (0.0, 0.01), guide))
    machine = Machine(
        "press", {"O": (0.0, 0.0)}, groups, loads=(SliderFriction("slider", 30.0),), bodies=(Body("l1", 0.0),)
    )
    twin, theta, step = ttc.compile(machine, ["balancing_torque_Nm", *TIP]), np.linspace(0.1, 6.0, 50), 1e-6
    after, before = twin.evaluate(theta + step, 2.0), twin.evaluate(theta - step, 2.0)
    speed = np.hypot(*(after[k] - before[k] for k in TIP)) / (2 * step)
    np.testing.assert_allclose(twin.evaluate(theta, 2.0)["balancing_torque_Nm"], 30.0 * speed, atol=1e-7)


def test_a_link_that_translates_in_a_circle_is_no_slider() -> None:
    dyad = RRRDyad("l2", "l3", "A", "C", "B", (0.3, 0.06), "left_passing")
    with pytest.raises(ttc.MachineError, match="friction of 'l2': this link is no slider"):
        Machine(
            "parallelogram",
            {"O": (0.0, 0.0), "C": (0.3, 0.0)},
            (Crank("l1", "O", "A", 0.06), dyad),
            loads=(SliderFriction("l2", 1.0),),
        )
