"""Stated error of machines far from the origin, against the same machine at the origin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from textile_twin_core.expression import interpret
from textile_twin_core.expression.loop import Numpy
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import RRPDyad

ANGLES = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, 4000)
SPEED = 10.0
OUTPUTS = (
    *("needle_position_m", "sley_position_m", "theta_5_rad", "theta_6_rad", "omega_5_rad_s", "alpha_5_rad_s2"),
    *("reaction_C_x_N", "reaction_E_x_N", "balancing_torque_Nm", "torque_load_Nm"),
)
"""Outputs that do not depend on the position of the machine."""


def there(machine: Machine, distance_m: float) -> Machine:
    """Return the machine moved by a distance whose coordinates are exact at both places."""

    def moved(point: tuple[float, float]) -> tuple[float, float]:
        x, y = (round(part * 2**24) / 2**24 for part in point)
        return x + distance_m, y - distance_m

    groups = tuple(
        replace(group, guide_point_m=moved(group.guide_point_m)) if isinstance(group, RRPDyad) else group
        for group in machine.groups
    )
    return replace(machine, points={name: moved(point) for name, point in machine.points.items()}, groups=groups)


@pytest.mark.parametrize("distance_m", [0.0, 1024.0, *more(1.0, 16.0)])
@pytest.mark.parametrize("machine", [ttc.machines.tufting(), ttc.load_machine("examples/six_bar_loom.yaml")])
def test_the_stated_error_holds_far_from_the_origin(machine: Machine, distance_m: float) -> None:
    here, far = there(machine, 0.0), there(machine, distance_m)
    names = [name for name in here.outputs if name in OUTPUTS]
    assert len(names) == len(OUTPUTS) - 1
    inputs = {"theta": ANGLES, "omega": np.full(ANGLES.size, SPEED), "alpha": np.zeros(ANGLES.size)}
    wide = {name: values.astype(np.longdouble) for name, values in inputs.items()}
    right = interpret([here.model.output(name) for name in names], wide, Numpy)
    twin = ttc.compile(far, names)
    found, told = twin.evaluate(ANGLES, SPEED, 0.0), twin.reached_errors
    for name, exact in zip(names, right, strict=True):
        peak = float(np.abs(exact).max())
        if peak > 0.0:
            assert float(np.abs(found[name] - exact).max()) / peak <= told[name], name
    assert distance_m or twin.reached_error < 1e-13
