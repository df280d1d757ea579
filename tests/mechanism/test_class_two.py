"""Machines of every class-II group against one dense Newton-Euler system per sample."""

from __future__ import annotations

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators.class_two_machines import KINDS, class_two_machine
from tests.generators.dense_planar import compare

THETA = np.array([0.3, 2.2, 4.4])


def check(kind: str, seed: int) -> None:
    machine = class_two_machine(kind, np.random.default_rng(seed))
    names = [o for o in machine.outputs if o.startswith(("point_", "theta_", "reaction_", "balancing_"))]
    found = ttc.compile(machine, names, method="exact").evaluate(THETA, 9.0, -31.0)
    worst = compare(machine, found, THETA, 9.0, -31.0)
    assert worst["place"] < 1e-12, (kind, seed)
    assert max(worst["torque"], worst["newton_euler"], worst["reaction"]) < 1e-12, (kind, seed, worst)


@pytest.mark.parametrize("kind", KINDS)
def test_places_torque_and_joint_forces_are_those_of_the_dense_equations(kind: str) -> None:
    for seed in range(2):
        check(kind, seed)


@pytest.mark.slow
@pytest.mark.campaign
def test_two_hundred_machines() -> None:
    for seed in range(200):
        check(KINDS[seed % len(KINDS)], 100 + seed)
