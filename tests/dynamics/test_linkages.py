"""Several linkages on one shaft: the sum of one linkage turned by hand, and no work done twice."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.expression import topological_order
from textile_twin_core.machine import Machine, ShaftPlace
from textile_twin_core.mechanism import Crank, RRRDyad

SUMS = [
    "balancing_torque_Nm",
    "balancing_torque_newton_euler_Nm",
    "torque_inertial_Nm",
    "torque_gravity_Nm",
    "torque_load_Nm",
    "equivalent_inertia_kgm2",
    "kinetic_energy_J",
    "potential_energy_J",
]
THETA = np.linspace(-4.0, 9.0, 301)
OMEGA, ALPHA = 17.0, np.linspace(-60.0, 60.0, 301)
ONE = ttc.machines.tufting()


def on_one_shaft(phases: list[float], machine: ttc.Machine = ONE) -> ttc.Machine:
    return dataclasses.replace(machine, linkages=tuple(ShaftPlace(p) for p in phases))


@pytest.mark.parametrize("count", [2, 5, 64])
def test_sums_of_linkages_turned_by_hand(count: int) -> None:
    phases = [2.0 * math.pi * k * 7 / count for k in range(count)]
    outputs = SUMS if count < 64 else SUMS[:1]
    together = ttc.compile(on_one_shaft(phases), outputs, method="exact").evaluate(THETA, OMEGA, ALPHA)
    single = ttc.compile(ONE, outputs, method="exact")
    apart = [single.evaluate(THETA + phase, OMEGA, ALPHA) for phase in phases]
    for name in outputs:
        by_hand = np.array([values[name] for values in apart])
        # one sample on the wrong side of the backing would be 16.7 N m
        assert np.abs(together[name] - by_hand.sum(axis=0)).max() < 2e-13 * np.abs(by_hand).max() * count, name


DRAG_LINK = Machine(
    "drag-link",
    {"O": (0.0, 0.0), "C": (0.2, 0.2)},
    (Crank("l1", at="O", end="A", length_m=1.1), RRRDyad("l2", "l3", "A", "C", "B", (0.9, 1.2))),
    (Body("l3", 1.0, 0.1),),
)


@pytest.mark.parametrize("machine", [ONE, DRAG_LINK], ids=["tufting", "drag-link"])
def test_the_first_linkage_is_drawn_at_its_phase(machine: Machine) -> None:
    """All that speaks of it is what the linkage alone gives further on; angles may count whole turns more."""
    kinds = ("theta_", "omega_", "point_", "joint_", "needle_", "reaction_")
    names = [name for name in machine.outputs if name.startswith(kinds)]
    shifted = ttc.compile(on_one_shaft([0.8, 2.0], machine), names, method="exact").evaluate(THETA, OMEGA, ALPHA)
    plain = ttc.compile(machine, names, method="exact").evaluate(THETA + 0.8, OMEGA, ALPHA)
    for name in names:
        difference = shifted[name] - plain[name]
        if name.startswith("theta_") or name.endswith("_position"):
            difference = difference - 2.0 * math.pi * round(float(difference[0]) / (2.0 * math.pi))
        scale = max(1.0, float(np.abs(plain[name]).max()))
        assert np.abs(difference).max() < 1e-12 * scale, name


def test_equal_phases_share_their_work() -> None:
    def work(phases: list[float]) -> int:
        return len(topological_order([on_one_shaft(phases).model.output("balancing_torque_Nm")]))

    assert work([0.3] * 64) <= work([0.3]) + 4
    assert work([0.0, 1.0]) < 2 * work([1.0])


def test_what_sits_on_the_shaft_itself_counts_once() -> None:
    machine = dataclasses.replace(
        ONE, loads=(*ONE.loads, ShaftFriction(0.2, 1.5)), bodies=(*ONE.bodies, Body.flywheel(0.4))
    )
    phases = [0.0, 2.0, 4.0]
    more = ttc.compile(on_one_shaft(phases, machine), SUMS, method="exact").evaluate(THETA, OMEGA, ALPHA)
    less = ttc.compile(on_one_shaft(phases), SUMS, method="exact").evaluate(THETA, OMEGA, ALPHA)
    peak = np.abs(more["balancing_torque_Nm"]).max()
    for route in SUMS[:2]:
        added = more[route] - less[route]
        assert np.abs(added - (0.4 * ALPHA + 0.2 * OMEGA + 1.5)).max() < 1e-13 * peak
    assert np.allclose(more["equivalent_inertia_kgm2"] - less["equivalent_inertia_kgm2"], 0.4, rtol=1e-13)
