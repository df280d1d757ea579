"""Rows of a table: one per interval of the angle, further ones after discontinuities, for each direction of
rotation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.expression import Expr, topological_order
from textile_twin_core.twin.phase_steps import DIRECTION, PHASE

# 2 pi to 107 bits, as the sum of two doubles.
_TURN = 2.0 * math.pi
_TURN_LOW = 2.4492935982947064e-16
_DIRECTIONS: Final = (1.0, -1.0, 0.0, math.nan)
"""Blocks of rows: forward, reverse, standstill, and unknown speed."""


class AngleGrid:
    """Grid of `nodes` (a power of two) equally spaced over one turn.

    The spacing is stored in three `parts`, so that its products with a node number are exact.

    References:
        W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980.
    """

    def __init__(self, nodes: int) -> None:
        if nodes < 2 or nodes & (nodes - 1):
            raise ValueError(f"the number of nodes must be a power of two, not {nodes}")
        self.nodes = nodes
        self.step = _TURN / nodes
        first = _leading_bits(self.step, 14)
        second = _leading_bits(self.step - first, 14)
        self.parts = (first, second, (self.step - first - second) + _TURN_LOW / nodes)

    def reduction(self) -> list[str]:
        """Return lines of Python that compute from `theta` the nearest `node`, 0..nodes-1, and the offset `rest`
        from it.
        """
        rounder = 1.5 * 2.0**52  # adding it rounds a number to the nearest integer, in its last bits
        first, second, third = self.parts
        return [
            f"shifted = theta * {self.nodes / _TURN!r} + {rounder!r}",
            f"k = shifted - {rounder!r}",
            f"rest = ((theta - k * {first!r}) - k * {second!r}) - k * {third!r}",
            f"node = float64(shifted).view(int64) & {self.nodes - 1}",
            "far += 1 if abs(theta) > FARTHEST else 0",
        ]


def _leading_bits(value: float, bits: int) -> float:
    mantissa, exponent = math.frexp(value)
    return math.ldexp(math.floor(math.ldexp(mantissa, bits)), exponent - bits)


@dataclass(frozen=True)
class Pieces:
    """Rows of a table whose functions are discontinuous at `angles`, (m,) ascending [rad], and may depend on the
    direction.

    In a block of rows, row k < nodes is the interval around node k up to its first discontinuity, and row nodes
    + j is the
    piece after discontinuity j. If the functions are `directed`, there is one block per direction of rotation.
    """

    grid: AngleGrid
    angles: FloatArray
    directed: bool

    @classmethod
    def of(cls, functions: Iterable[Expr], grid: AngleGrid) -> Pieces:
        """Build the rows that functions of angle, phase and direction need on a grid."""
        order = topological_order(functions)
        compared = {node.args for node in order if node.op == "at_least"}
        angles = {angle.value for phase, angle in compared if phase is PHASE}
        lowest = -0.5 * grid.step
        within = sorted(a for a in angles if lowest < a < 2.0 * math.pi + lowest)
        return cls(grid, np.array(within), DIRECTION in order)

    @property
    def block(self) -> int:
        """Number of rows for one direction."""
        return self.grid.nodes + self.angles.size

    @property
    def rows(self) -> int:
        """Total number of rows."""
        return self.block * len(self._blocks)

    @property
    def _blocks(self) -> tuple[float, ...]:
        return _DIRECTIONS if self.directed else _DIRECTIONS[:1]

    @cached_property
    def nodes(self) -> IntArray:
        """(m,) node in whose interval each discontinuity lies."""
        return np.floor(self.angles / self.grid.step + 0.5).astype(np.int64)

    @cached_property
    def centres(self) -> FloatArray:
        """(rows,) angle of the node of each row [rad]."""
        node = np.concatenate((np.arange(self.grid.nodes), self.nodes))
        return np.tile(node * self.grid.step, len(self._blocks))

    @cached_property
    def phases(self) -> FloatArray:
        """(rows,) an angle within the piece of each row [rad]."""
        half = 0.5 * self.grid.step
        found = self.centres[: self.block].copy()
        for j, (angle, node) in enumerate(zip(self.angles, self.nodes, strict=True)):
            last = j + 1 == self.angles.size or self.nodes[j + 1] != node
            end = node * self.grid.step + half if last else self.angles[j + 1]
            found[self.grid.nodes + j] = max(0.5 * (angle + end), angle)
            if j == 0 or self.nodes[j - 1] != node:
                begin = node * self.grid.step - half
                found[node] = min(0.5 * (begin + angle), np.nextafter(angle, -math.inf))
        return np.tile(found, len(self._blocks))

    @cached_property
    def directions(self) -> FloatArray:
        """(rows,) direction of rotation of each row: 1, -1, 0, or NaN for unknown."""
        return np.repeat(self._blocks, self.block)

    def choice(self) -> list[str]:
        """Return lines of Python that compute the `row` from `node`, the offset `rest` from it and the speed
        `omega`.
        """
        most = int(np.unique(self.nodes, return_counts=True)[1].max(initial=0))
        lines = ["row = node", *["row = row + (to_next[row] if rest >= ends[row] else 0)"] * most]
        if self.directed:
            block = "0 if omega > 0.0 else 1 if omega < 0.0 else 2 if omega == 0.0 else 3"
            lines.append(f"row = row + {self.block} * ({block})")
        return lines

    @cached_property
    def ends(self) -> FloatArray:
        """(block,) offset from the node of a row to the discontinuity that ends its piece; inf where there is none."""
        ends = np.full(self.block, math.inf)
        ends[self._rows_before_steps] = self.angles - self.nodes * self.grid.step
        return ends

    @cached_property
    def to_next(self) -> IntArray:
        """(block,) number of rows from a row to the piece after its discontinuity."""
        steps = np.zeros(self.block, dtype=np.int64)
        before = self._rows_before_steps
        steps[before] = self.grid.nodes + np.arange(self.angles.size) - before
        return steps

    @cached_property
    def _rows_before_steps(self) -> IntArray:
        """(m,) row whose piece ends at each discontinuity."""
        follows = np.append(False, self.nodes[1:] == self.nodes[:-1]) if self.angles.size else np.zeros(0, bool)
        return np.where(follows, self.grid.nodes + np.arange(self.angles.size) - 1, self.nodes)
