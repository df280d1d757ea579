"""Equation of motion of a shaft, smooth between the angles at which its loads are discontinuous."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.expression import Expr, derivative, sign, substitute, topological_order, variable
from textile_twin_core.expression.loop import Loop
from textile_twin_core.expression.scalar import compile_scalar

TURN = 2.0 * math.pi
_STATE = ("theta", "omega")
_LEAPING = ("sign", "at_least")
_SAMPLES = 2880
_OPEN = 2.0
"""Value of a load's step where the chain is open."""
_BEND = 1e-9
"""Largest change of a load's torque, over its size, at a bend of its law; a larger one is a step."""
_SHIFT = 0.377  # share of a sample spacing, so that no sample lies on a round angle


@dataclass(frozen=True)
class Stretch:
    """A range of the shaft angle [rad] without a load step, and the values of the stepping factors in it."""

    lower: float
    upper: float
    values: tuple[float, ...]

    def bound(self, direction: int) -> float:
        """Return the end of the range in the direction of rotation."""
        return self.upper if direction > 0 else self.lower


class MotionEquation:
    """The equation J alpha + J'/2 omega^2 + V' = drive torque + sum of the loads' torques on the shaft.

    `load_torques` may hold steps (sign, at_least, the corner of an absolute value) that depend on the shaft angle and
    the direction of rotation. Each is located over one turn, to the rounding of the angle.
    """

    def __init__(
        self, inertia: Expr, half_slope: Expr, potential: Expr, potential_slope: Expr, load_torques: Sequence[Expr]
    ) -> None:
        loads = list(load_torques)
        self._leaps, smooth, corners = split_leaps(loads)
        names = [f"leap_{k}" for k in range(len(self._leaps))]
        self.load_torques: tuple[Expr, ...] = tuple(smooth)
        """Torque of each load on the shaft, with its stepping factors as the variables `leaps`."""
        self.leaps: tuple[Expr, ...] = tuple(variable(name) for name in names)
        self.load_count = len(smooth)
        self.terms = compile_scalar([inertia, half_slope, potential_slope, *smooth], [*_STATE, *names])
        """J, J'/2, V' and each load's torque at (theta, omega, stepping factors)."""
        self._energy = compile_scalar([inertia, potential], ["theta"])
        reached = [topological_order([load]) for load in loads]
        needed = [set(topological_order([*nodes, *(corners[n] for n in nodes if n in corners)])) for nodes in reached]
        self._owners = [{i for i, nodes in enumerate(needed) if leap in nodes} for leap in self._leaps]

    def is_open(self, stretch: Stretch) -> bool:
        """Return whether the chain fails to close over a stretch."""
        return len(stretch.values) < len(self._leaps)

    def energies(self, theta: float, omega: float) -> tuple[float, float]:
        """Compute kinetic and potential energy [J]."""
        inertia, potential = self._energy(theta)
        return 0.5 * inertia * omega * omega, potential

    def stretch(self, theta: float, direction: int) -> Stretch:
        """Return the stretch that contains the angle, or begins there in the direction of rotation (1 or -1)."""
        angles, values = self.survey(direction)
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

    def survey(self, direction: int) -> tuple[list[float], list[tuple[float, ...]]]:
        """Locate the load steps: increasing angles in [0, 2 pi), and the values of the stepping factors after each.

        The values are empty where the chain does not close. Without steps there is one stretch and no angle.
        """
        return self._forward if direction > 0 else self._backward

    def leaping_loads(self, before: Stretch, after: Stretch, theta: float, omega: float) -> tuple[int, ...]:
        """Return the numbers of the loads that step or reverse between two stretches that meet at an angle.

        A load that only bends there, as a force curve at a knot, is not among them.
        """
        changed = [k for k, pair in enumerate(zip(before.values, after.values, strict=False)) if pair[0] != pair[1]]
        owners = set().union(*(self._owners[k] for k in changed))
        if not owners or self.is_open(before) or self.is_open(after):
            return tuple(sorted(owners))
        reversed_ones = set().union(*(self._owners[k] for k in changed if self._leaps[k].op == "sign"))
        one, other = (self.terms(theta, omega, *stretch.values)[3:] for stretch in (before, after))
        stepped = {i for i in owners if abs(one[i] - other[i]) > _BEND * max(abs(one[i]), abs(other[i]))}
        return tuple(sorted(reversed_ones | stepped))

    @cached_property
    def _forward(self) -> tuple[list[float], list[tuple[float, ...]]]:
        return self._survey(1.0)

    @cached_property
    def _backward(self) -> tuple[list[float], list[tuple[float, ...]]]:
        return self._survey(-1.0)

    def _survey(self, omega: float) -> tuple[list[float], list[tuple[float, ...]]]:
        """Locate the load steps at a speed, as `survey` does."""
        if not self._leaps:
            return [], [()]
        levels = [level(leap) for leap in self._leaps]
        steps_and_levels = _sampler([*self._leaps, *levels], omega)
        slopes = _sampler(derivative(levels, variable("theta")), omega)

        def values(angle: FloatArray) -> FloatArray:
            steps, level = np.split(steps_and_levels(angle), 2)
            return np.where(np.isnan(level).any(axis=0), _OPEN, steps)

        step = TURN / _SAMPLES
        theta = np.linspace(_SHIFT * step, TURN + _SHIFT * step, _SAMPLES + 1)
        sampled = values(theta)
        between = np.diff(sampled, axis=1) != 0.0
        # a level may touch its threshold between two equal samples: a third sample at its turning point shows that
        with np.errstate(invalid="ignore"):
            approach = np.split(steps_and_levels(theta), 2)[1] * slopes(theta)
            row, place = np.nonzero((approach[:, :-1] < 0.0) & (approach[:, 1:] > 0.0) & ~between)
        turning = _first_change(lambda angle: slopes(angle) > 0.0, row, theta[place], theta[place + 1])
        rows, places = np.nonzero(between)
        rows = np.concatenate([rows, row, row])
        low = np.concatenate([theta[places], theta[place], turning])
        high = np.concatenate([theta[places + 1], turning, theta[place + 1]])
        found = _first_change(values, rows, low, high)
        angles = _merged(sorted((found[~np.isnan(found)] % TURN).tolist()))
        ends = [*angles[1:], angles[0] + TURN] if angles else []
        middles = [0.5 * (a + b) for a, b in zip(angles, ends, strict=True)] or [float(theta[0])]
        columns = values(np.array(middles)).T.tolist()
        return angles, [() if _OPEN in column else tuple(column) for column in columns]


def split_leaps(loads: Sequence[Expr], name: str = "leap_{}") -> tuple[list[Expr], list[Expr], dict[Expr, Expr]]:
    """Split loads into their steps and smooth expressions of variables that stand for the steps.

    Args:
        loads: torques of the loads.
        name: format of the variables' names, by number.

    Returns:
        The steps (sign, at_least), the loads in terms of the variables, and the signs that stand for the corners of
        absolute values.
    """
    corners = {node: sign(node.args[0]) for node in topological_order(loads) if node.op == "abs"}
    leaps = [node for node in topological_order([*loads, *corners.values()]) if node.op in _LEAPING]
    new = {node: variable(name.format(k)) for k, node in enumerate(leaps)}
    for node, side in corners.items():  # innermost first, with |x| = sign(x) x
        argument, value = substitute([node.args[0], side], new)
        new[node] = argument * value
    return leaps, substitute(loads, new), corners


def level(leap: Expr) -> Expr:
    """Express the quantity that is zero where a step occurs."""
    return leap.args[0] if leap.op == "sign" else leap.args[0] - leap.args[1]


def _sampler(expressions: Sequence[Expr], omega: float) -> Callable[[FloatArray], FloatArray]:
    """Return a function that evaluates the expressions (rows) at shaft angles (columns); NaN for an open chain."""
    program = Loop(expressions, list(_STATE))

    def look(theta: FloatArray) -> FloatArray:
        found = np.empty((len(expressions), theta.size))
        if theta.size:
            with np.errstate(invalid="ignore", divide="ignore"):
                program([theta, np.full_like(theta, omega)], list(found))
        return found

    return look


def _first_change(
    function: Callable[[FloatArray], NDArray[Any]], rows: IntArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Find the first double after each `low` at which its row of the function changes its value; NaN if none.

    All rows are bisected at once, up to each `high`.
    """
    column = np.arange(rows.size)
    begin = function(low)[rows, column]
    changed = function(high)[rows, column] != begin
    while True:
        middle = 0.5 * (low + high)
        inside = (low < middle) & (middle < high)
        if not inside.any():
            return np.where(changed, high, math.nan)
        same = function(middle)[rows, column] == begin
        low, high = np.where(inside & same, middle, low), np.where(inside & ~same, middle, high)


def _merged(angles: list[float]) -> list[float]:
    """Merge angles of the same step, which differ by rounding."""
    kept: list[float] = []
    for angle in angles:
        if not kept or angle - kept[-1] > 1e-12:
            kept.append(angle)
    return kept
