"""Laws of every machine: equal torque by both routes, the power balance, exact derivatives."""

from __future__ import annotations

import cmath
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings

import textile_twin_core as ttc
from tests.dynamics.random_machines import machines, motions, nearly_stretched
from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Loop
from textile_twin_core.machine import Machine, ShaftPlace

Motion = tuple[FloatArray, FloatArray, FloatArray]
ROUTES = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]
STEP = 1e-30

several = settings(
    max_examples=30,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


def published(name: str) -> Machine | None:
    """Return a published linkage machine, with added masses where the paper gives none; None for other machines."""
    machine = ttc.machines.create(name)
    if not isinstance(machine, Machine):
        return None
    masses = {missing: 0.7 if missing.endswith("_kg") else 0.003 for missing in machine.missing_for_torque}
    return ttc.machines.create(name, **masses) if masses else machine


LINKAGES = [name for name in ttc.machines.NAMES if published(name) is not None]


def peak_of(twin: ttc.Twin, motion: Motion) -> float:
    """Compute the largest torque over a turn at the motion's largest speed and acceleration."""
    theta = np.linspace(0.0, 2.0 * math.pi, 361)
    omega, alpha = (float(np.abs(a).max()) for a in motion[1:])
    signs = [(w, a) for w in (omega, -omega) for a in (alpha, -alpha)]
    return max(float(np.abs(twin.evaluate(theta, w, a)[ROUTES[0]]).max()) for w, a in signs)


def disagreement(machine: Machine, motion: Motion) -> float:
    """Compute the largest difference of the two routes over the peak."""
    twin = ttc.compile(machine, ROUTES, method="exact")
    one, two = twin.evaluate(*motion).values()
    return float(np.abs(one - two).max()) / max(peak_of(twin, motion), float(np.abs(one).max()))


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("phases", [(0.0,), (0.4, 2.0)])
def test_both_routes_of_the_published_machines(name: str, phases: tuple[float, ...]) -> None:
    machine = published(name)
    assert machine is not None
    machine = dataclasses.replace(machine, linkages=tuple(ShaftPlace(p) for p in phases))
    rng = np.random.default_rng(1)
    theta = rng.uniform(-20.0, 20.0, 2000)
    for scale in (0.0, 1.0):
        motion = theta, rng.uniform(-40.0, 40.0, 2000), scale * rng.uniform(-900.0, 900.0, 2000)
        assert disagreement(machine, motion) < 1e-12


@several
@given(machines(), motions())
def test_both_routes_of_random_machines(machine: Machine, motion: Motion) -> None:
    assert disagreement(machine, motion) < 1e-12


@settings(several, max_examples=15)
@given(nearly_stretched(), motions())
def test_both_routes_near_toggles_by_conditioning(machine: Machine, motion: Motion) -> None:
    """Below 5 deg the agreement is weaker as 1/sin of the transmission angle, by which joint forces grow."""
    (closeness,) = machine.closeness
    assert closeness.transmission_angle_rad < math.radians(5.0)
    steeper = math.sin(math.radians(5.0)) / math.sin(closeness.transmission_angle_rad)
    near = (closeness.theta_rad + np.array([-1e-3, -1e-5, -1e-7, 1e-7, 1e-5, 1e-3]))[:, None]
    theta = np.concatenate([motion[0], (near + np.zeros(8)).ravel()])
    speeds = (np.resize(a, theta.size) for a in motion[1:])
    assert disagreement(machine, (theta, *speeds)) < 1e-12 * steeper


def energy_rate(machine: Machine, theta: float, omega: float, alpha: float) -> float:
    """Compute the rate of kinetic and potential energy by a complex step along the motion [W]."""
    outputs = [machine.model.output("kinetic_energy_J"), machine.model.output("potential_energy_J")]
    ahead = {
        "theta": complex(theta, STEP * omega),
        "omega": complex(omega, STEP * alpha),
        "alpha": complex(alpha, 0.0),
    }
    return float(sum(interpret(outputs, ahead, cmath)).imag / STEP)


def check_power(machine: Machine, motion: Motion) -> None:
    wanted = ["balancing_torque_Nm", "torque_load_Nm"]
    twin = ttc.compile(machine, wanted, method="exact")
    values = twin.evaluate(*motion)
    power = (values[wanted[0]] - values[wanted[1]]) * motion[1]
    rates = np.array([energy_rate(machine, *state) for state in zip(*(a.tolist() for a in motion), strict=True)])
    assert np.abs(power - rates).max() < 1e-12 * peak_of(twin, motion) * np.abs(motion[1]).max()


@pytest.mark.parametrize("name", LINKAGES)
def test_power_balance_of_the_published_machines(name: str) -> None:
    machine = published(name)
    assert machine is not None
    rng = np.random.default_rng(2)
    check_power(machine, (rng.uniform(-9.0, 9.0, 60), rng.uniform(-40.0, 40.0, 60), rng.uniform(-900.0, 900.0, 60)))


@settings(several, max_examples=12)
@given(machines(), motions(count=5))
def test_power_balance_of_random_machines(machine: Machine, motion: Motion) -> None:
    check_power(machine, motion)


def derivative_pairs(machine: Machine) -> list[tuple[str, Expr, Expr]]:
    """List (name, function of theta, its declared derivative) over the machine's first linkage."""
    model = machine.model
    motion = model.first.motion
    pairs = [
        ("J", model.output("equivalent_inertia_kgm2"), model.output("equivalent_inertia_slope_kgm2")),
        ("V", model.output("potential_energy_J"), model.output("torque_gravity_Nm")),
    ]
    for name, link in motion.links.items():
        normal = link.direction.turned_left()
        pairs += [
            (f"{name} x", link.direction.x, link.first * normal.x),
            (f"{name} y", link.direction.y, link.first * normal.y),
            (f"{name} rate", link.first, link.second),
        ]
    for name, point in motion.points.items():
        pairs += [
            (f"{name} x", point.position.x, point.first.x),
            (f"{name} y", point.position.y, point.first.y),
            (f"{name} dx", point.first.x, point.second.x),
            (f"{name} dy", point.first.y, point.second.y),
        ]
    for name, measure in model.first.displacements.items():
        pairs.append((f"{name} rate", measure.first, measure.second))
    return pairs


def check_derivatives(machine: Machine, thetas: FloatArray) -> None:
    pairs = derivative_pairs(machine)
    declared_slopes = Loop([d for _, _, d in pairs], ["theta"])
    declared = [np.empty_like(thetas) for _ in pairs]
    declared_slopes([thetas], declared)
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    range_of = [np.empty_like(turn) for _ in pairs]
    declared_slopes([turn], range_of)
    for i, theta in enumerate(thetas.tolist()):
        exact = interpret([f for _, f, _ in pairs], {"theta": complex(theta, STEP)}, cmath)
        for (name, _, _), value, ours, whole in zip(pairs, exact, declared, range_of, strict=True):
            slope = complex(value).imag / STEP
            scale = max(float(np.abs(whole).max()), abs(slope))
            assert abs(ours[i] - slope) <= 1e-12 * scale, name


@pytest.mark.parametrize("name", LINKAGES)
def test_derivatives_of_the_published_machines(name: str) -> None:
    machine = published(name)
    assert machine is not None
    check_derivatives(machine, np.random.default_rng(3).uniform(-9.0, 9.0, 12))


@settings(several, max_examples=12)
@given(machines(), motions(count=3))
def test_derivatives_of_random_machines(machine: Machine, motion: Motion) -> None:
    check_derivatives(machine, motion[0])
