"""Periodic tables: functions of the shaft angle as piecewise polynomials.

The polynomial around each node interpolates the function at the Chebyshev points of the interval, in powers of
the angle
from the node. Where a function is discontinuous, each piece has its own polynomial (see `pieces`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression import Expr
from textile_twin_core.expression.loop import Loop
from textile_twin_core.twin.phase_steps import DIRECTION, PHASE
from textile_twin_core.twin.pieces import AngleGrid, Pieces

MOST_NODES = 4096
_FEWEST_NODES = 32
_DEGREES = (1, 2, 3, 4, 5, 7)
_CACHED_BYTES = 500_000
"""Largest table that stays in the cache of a processor core."""
_REDUCTION, _NEAR, _FAR = 10.0, 20.0, 30.0
"""Times, relative to an addition, of the angle reduction and of a gather from within and beyond the cache."""
_ROUNDING = 4e-16
_MARGIN = 2.0
"""Margin for the angles between those checked, as in `accuracy`."""


@dataclass(frozen=True)
class AngleTable:
    """Piecewise polynomials: coefficients (functions, degree + 1, rows), lowest power first.

    `error` bounds the deviation of any output over its peak, at speeds from 0.1 to 10 times nominal. It is the
    weighted sum
    of the largest deviations of the functions.
    """

    pieces: Pieces
    coefficients: FloatArray
    error: float

    @property
    def grid(self) -> AngleGrid:
        """Grid of the nodes."""
        return self.pieces.grid

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return int(self.coefficients.shape[1]) - 1

    @property
    def cost(self) -> float:
        """Time per sample of `reading`, relative to an addition."""
        functions, points = int(self.coefficients.shape[0]), self.degree + 1
        near = 8 * functions * points * self.pieces.block <= _CACHED_BYTES
        gathers = functions * points + 2 * min(self.pieces.angles.size, 1)
        return _REDUCTION + gathers * (_NEAR if near else _FAR) + functions * self.degree

    def tables(self) -> dict[str, Any]:
        """Return the arrays that `reading` needs."""
        together = np.ascontiguousarray(self.coefficients.transpose(2, 0, 1)).reshape(-1)
        return {"coefficients": together, "ends": self.pieces.ends, "to_next": self.pieces.to_next}

    def reading(self) -> list[str]:
        """Return lines of Python that compute the functions f0, f1, .. from `theta` and `omega`."""
        functions, points, _ = self.coefficients.shape
        lines = [*self.grid.reduction(), *self.pieces.choice(), f"at = row * {functions * points}"]
        for f in range(functions):
            powers = [f"coefficients[at + {f * points + power}]" for power in range(points)]
            horner = powers.pop()
            for coefficient in reversed(powers):
                horner = f"({coefficient} + rest * {horner})"
            lines.append(f"f{f} = {horner}")
        return lines


def tabulate(functions: Sequence[Expr], weights: FloatArray, tolerance: float) -> AngleTable | None:
    """Build the cheapest table of functions of theta, phase and direction that meets the tolerance of the outputs.

    Args:
        functions: Functions to tabulate.
        weights: (outputs, functions) error of an output over its peak per error of a function.
        tolerance: Largest error of an output over its peak.

    Returns:
        The table; None if rounding or `MOST_NODES` prevent it.
    """
    program = Loop(functions, ["theta", str(PHASE.payload), str(DIRECTION.payload)])
    found = [_coarsest(program, functions, weights, tolerance, degree) for degree in _DEGREES]
    return min((table for table in found if table is not None), key=lambda table: table.cost, default=None)


def _coarsest(
    program: Loop, functions: Sequence[Expr], weights: FloatArray, tolerance: float, degree: int
) -> AngleTable | None:
    """Build the table of a degree with the fewest nodes."""
    nodes = _FEWEST_NODES
    while nodes <= MOST_NODES:
        table = _fit(program, Pieces.of(functions, AngleGrid(nodes)), weights, degree)
        excess = _MARGIN * table.error / max(tolerance, _ROUNDING)
        if excess <= 1.0:
            return table
        # Halving the interval divides the error by 2^(degree + 1): skip the sizes that cannot suffice.
        nodes <<= max(1, math.floor(math.log2(max(excess, 2.0)) / (degree + 1)))
    return None


def _fit(program: Loop, pieces: Pieces, weights: FloatArray, degree: int) -> AngleTable:
    step, points, count = pieces.grid.step, degree + 1, weights.shape[1]
    angles = (np.arange(points) + 0.5) * math.pi / points
    values = _evaluate(program, count, pieces, 0.5 * np.cos(angles) * step)
    orders = np.arange(points)
    to_chebyshev = np.where(orders > 0, 2.0, 1.0)[:, None] / points * np.cos(np.outer(orders, angles))
    to_powers = np.zeros((points, points))
    for order in orders:
        powers = chebyshev.cheb2poly(np.eye(points)[order][: order + 1])
        to_powers[: powers.size, order] = powers
    scale = (2.0 / step) ** orders
    coefficients = np.einsum("dc,cp,frp->fdr", to_powers, to_chebyshev, values) * scale[:, None]
    off = np.array([-0.5, -0.31, 0.0, 0.22, 0.5]) * step
    exact = _evaluate(program, count, pieces, off)
    approximate = np.zeros_like(exact)
    for power in reversed(orders):
        approximate = approximate * off + coefficients[:, power, :, None]
    errors = np.nanmax(np.abs(approximate - exact), axis=(1, 2))  # NaN where the direction is unknown
    return AngleTable(pieces, np.ascontiguousarray(coefficients), float((weights @ errors).max(initial=0.0)))


def _evaluate(program: Loop, count: int, pieces: Pieces, off: FloatArray) -> FloatArray:
    """Evaluate (functions, rows, points), with the piece of each row continued over the whole interval."""
    theta = pieces.centres[:, None] + off
    phase, direction = (np.broadcast_to(a[:, None], theta.shape) for a in (pieces.phases, pieces.directions))
    out = np.empty((count, *theta.shape))
    program([a.reshape(-1) for a in (theta, phase, direction)], [values.reshape(-1) for values in out])
    return out
