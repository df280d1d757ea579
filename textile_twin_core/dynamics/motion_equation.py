"""The equation of motion of a shaft, smooth between the angles at which its loads leap."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.expression import Expr, sign, substitute, topological_order, variable
from textile_twin_core.expression.blocks import BlockProgram
from textile_twin_core.expression.scalar import compile_scalar

TURN = 2.0 * math.pi
_STATE = ("theta", "omega")
_LEAPING = ("sign", "at_least")
_SAMPLES = 2880
_SHIFT = 0.377  # of a sample, so that no sample lies on a round angle


@dataclass(frozen=True)
class Stretch:
    """A range of the shaft angle [rad] over which no load leaps, and the leaping factors' values in it."""

    lower: float
    upper: float
    values: tuple[float, ...]

    def bound(self, direction: int) -> float:
        """The end that the shaft turns towards."""
        return self.upper if direction > 0 else self.lower


class MotionEquation:
    """J alpha + J'/2 omega^2 + V' = drive torque + sum of the loads' torques on the shaft.

    `load_torques` may hold steps (sign, at_least) that depend on the shaft angle and the direction of rotation;
    each is found over one turn, to the rounding of the angle. Two of them within a third of a degree that
    cancel each other are not seen.
    """

    def __init__(
        self, inertia: Expr, half_slope: Expr, potential: Expr, potential_slope: Expr, load_torques: Sequence[Expr]
    ) -> None:
        loads = _without_absolutes(list(load_torques))
        self._leaps = [node for node in topological_order(loads) if node.op in _LEAPING]
        names = [f"leap_{k}" for k in range(len(self._leaps))]
        smooth = substitute(loads, {node: variable(name) for node, name in zip(self._leaps, names, strict=True)})
        self.load_count = len(smooth)
        self.terms = compile_scalar([inertia, half_slope, potential_slope, *smooth], [*_STATE, *names])
        """J, J'/2, V' and each load's torque at (theta, omega, leaping factors)."""
        self._energy = compile_scalar([inertia, potential], ["theta"])
        needed = [set(topological_order([load])) for load in loads]
        self._owners = [{i for i, nodes in enumerate(needed) if leap in nodes} for leap in self._leaps]

    def is_open(self, stretch: Stretch) -> bool:
        """Whether the chain does not close over a stretch."""
        return len(stretch.values) < len(self._leaps)

    def energies(self, theta: float, omega: float) -> tuple[float, float]:
        """Kinetic and potential energy [J]."""
        inertia, potential = self._energy(theta)
        return 0.5 * inertia * omega * omega, potential

    def stretch(self, theta: float, direction: int) -> Stretch:
        """The stretch that the shaft is in, or on whose beginning it stands, turning in a direction (1 or -1)."""
        angles, values = self._forward if direction > 0 else self._backward
        if not angles:
            return Stretch(-math.inf, math.inf, values[0])
        turn = math.floor(theta / TURN)
        base = turn * TURN
        bounds = [base + a for a in (angles[-1] - TURN, *angles, angles[0] + TURN, angles[0] + 2.0 * TURN)]
        near = 1e-13 + 4.0 * math.ulp(theta)
        if direction > 0:
            i = max(k for k in range(len(bounds) - 1) if bounds[k] <= theta + near or k == 0)
        else:
            i = min(k for k in range(len(bounds) - 1) if bounds[k + 1] >= theta - near)
        return Stretch(bounds[i], bounds[i + 1], values[(i - 1) % len(angles)])

    def leaping_loads(self, before: Stretch, after: Stretch) -> tuple[int, ...]:
        """Numbers of the loads that leap between two neighbouring stretches."""
        changed = [k for k, pair in enumerate(zip(before.values, after.values, strict=False)) if pair[0] != pair[1]]
        return tuple(sorted(set().union(*(self._owners[k] for k in changed))))

    @cached_property
    def _forward(self) -> tuple[list[float], list[tuple[float, ...]]]:
        return self._survey(1.0)

    @cached_property
    def _backward(self) -> tuple[list[float], list[tuple[float, ...]]]:
        return self._survey(-1.0)

    def _survey(self, omega: float) -> tuple[list[float], list[tuple[float, ...]]]:
        """Angles in [0, 2 pi) of the leaps, rising, and the factors' values after each."""
        if not self._leaps:
            return [], [()]
        step = TURN / _SAMPLES
        theta = np.linspace(_SHIFT * step, TURN + _SHIFT * step, _SAMPLES + 1)
        sampled = np.empty((len(self._leaps), theta.size))
        with np.errstate(invalid="ignore", divide="ignore"):  # where the chain is open
            BlockProgram(self._leaps, list(_STATE))([theta, np.full_like(theta, omega)], list(sampled))
        function = compile_scalar(self._leaps, list(_STATE))

        def at(angle: float) -> tuple[float, ...]:
            try:
                return tuple(float(v) for v in function(angle, omega))
            except (ValueError, ZeroDivisionError):  # the chain is open there
                return ()

        found: list[float] = []
        for i in np.flatnonzero((sampled[:, 1:] != sampled[:, :-1]).any(axis=0)):
            low, high = float(theta[i]), float(theta[i + 1])
            while at(low) != at(high):
                low = _first_change(at, low, high)
                found.append(low % TURN)
        angles = _apart(sorted(found))
        if not angles:
            return [], [at(float(theta[0]))]
        ends = [*angles[1:], angles[0] + TURN]
        return angles, [at(0.5 * (a + b)) for a, b in zip(angles, ends, strict=True)]


def _first_change(at: Callable[[float], tuple[float, ...]], low: float, high: float) -> float:
    """The first double after `low` at which the values differ from those at `low`, by bisection."""
    begin = at(low)
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        if at(middle) == begin:
            low = middle
        else:
            high = middle


def _apart(angles: list[float]) -> list[float]:
    """Angles with those of one leap, which differ by rounding, taken as one."""
    kept: list[float] = []
    for angle in angles:
        if not kept or angle - kept[-1] > 1e-12:
            kept.append(angle)
    return kept


def _without_absolutes(expressions: list[Expr]) -> list[Expr]:
    while found := [node for node in topological_order(expressions) if node.op == "abs"]:
        innermost = found[0]
        argument = innermost.args[0]
        expressions = substitute(expressions, {innermost: argument * sign(argument)})
    return expressions
