"""Error of an evaluation method, measured against extended precision at random angles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Numpy
from textile_twin_core.machine.machine import Machine

_ANGLES = 20_000
_MARGIN = 2.0
_DOUBLE_ROUNDING = float(np.finfo(np.float64).eps)


class Evaluator(Protocol):
    """Method of evaluation."""

    def fill(self, inputs: Sequence[FloatArray], out: Mapping[str, FloatArray]) -> None:
        """Evaluate one-dimensional inputs into `out`."""
        ...


def reached_errors(machine: Machine, outputs: Mapping[str, Expr], evaluator: Evaluator) -> dict[str, float]:
    """Measure the error over peak of each output: the maximum over random angles at nominal speed, times a
    margin of two.

    The reference is the same closed form in numpy's long double (19 digits where the processor has them). The
    margin covers
    other angles and the rounding of the declared constants. If all fixed points are far from the origin, the
    differences of
    their coordinates lose digits; this rounding, over the length of the shortest link, is added.
    """
    rng = np.random.default_rng(20_160_117)
    speed = machine.nominal_speed_rad_s
    low, high = machine.range_rad
    theta = rng.uniform(low, high, _ANGLES)
    omega = np.full(_ANGLES, speed)
    alpha = rng.uniform(-0.1, 0.1, _ANGLES) * speed**2
    found = {name: np.empty(_ANGLES) for name in outputs}
    with np.errstate(invalid="ignore", divide="ignore"):
        evaluator.fill((theta, omega, alpha), found)
    wide = {"theta": theta, "omega": omega, "alpha": alpha}
    inputs = {name: values.astype(np.longdouble) for name, values in wide.items()}
    reference = interpret(outputs.values(), inputs, Numpy)
    rounded = _coordinate_rounding(machine)
    errors = {}
    for name, exact in zip(outputs, reference, strict=True):
        peak = float(np.abs(exact).max())
        error = float(np.abs(found[name] - exact).max())
        relative = error / peak + rounded if peak > 0.0 else 0.0
        errors[name] = _MARGIN * max(relative, 0.5 * _DOUBLE_ROUNDING) if math.isfinite(relative) else math.inf
    return errors


def _coordinate_rounding(machine: Machine) -> float:
    """Return the rounding of the coordinates over the length of the shortest link; 0 if a fixed point is the origin."""
    distance = min((math.hypot(x, y) for x, y in machine.points.values()), default=0.0)
    shortest = min((abs(link.length) for link in machine.linkage.solved.links.values() if link.length), default=0.0)
    return _DOUBLE_ROUNDING * distance / shortest if shortest else 0.0
