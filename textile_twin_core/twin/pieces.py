"""Rows of a table: one for each interval of the angle, more where a function leaps, for each direction of turning."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.expression import Expr, topological_order
from textile_twin_core.twin.angle_grid import AngleGrid
from textile_twin_core.twin.phase_steps import DIRECTION, PHASE

_DIRECTIONS: Final = (1.0, -1.0, 0.0, math.nan)
"""The blocks of rows: forward, reversed, at rest, and where the speed is not known."""


@dataclass(frozen=True)
class Pieces:
    """The rows of a table whose functions leap at `angles`, (m,) ascending [rad], and may depend on the direction.

    In a block of rows, row k < nodes is the interval around node k up to its first leap, and row nodes + j the
    piece after leap j. Where functions are `directed`, such a block stands for each direction of turning.
    """

    grid: AngleGrid
    angles: FloatArray
    directed: bool

    @classmethod
    def of(cls, functions: Iterable[Expr], grid: AngleGrid) -> Pieces:
        """The rows that functions of angle, phase and direction need on a grid."""
        order = topological_order(functions)
        compared = {node.args for node in order if node.op == "at_least"}
        angles = {angle.value for phase, angle in compared if phase is PHASE}
        lowest = -0.5 * grid.step
        within = sorted(a for a in angles if lowest < a < 2.0 * math.pi + lowest)
        return cls(grid, np.array(within), DIRECTION in order)

    @property
    def block(self) -> int:
        """Rows for one direction."""
        return self.grid.nodes + self.angles.size

    @property
    def rows(self) -> int:
        """Rows in all."""
        return self.block * len(self._blocks)

    @property
    def _blocks(self) -> tuple[float, ...]:
        return _DIRECTIONS if self.directed else _DIRECTIONS[:1]

    @cached_property
    def nodes(self) -> IntArray:
        """(m,) the node in whose interval each leap lies."""
        return np.floor(self.angles / self.grid.step + 0.5).astype(np.int64)

    @cached_property
    def centres(self) -> FloatArray:
        """(rows,) angle of each row's node [rad]."""
        node = np.concatenate((np.arange(self.grid.nodes), self.nodes))
        return np.tile(node * self.grid.step, len(self._blocks))

    @cached_property
    def phases(self) -> FloatArray:
        """(rows,) an angle within each row's piece [rad]."""
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
        """(rows,) direction of turning of each row: 1, -1, 0, or NaN for none known."""
        return np.repeat(self._blocks, self.block)

    def choice(self) -> list[str]:
        """Lines of Python: from `node`, the angle `rest` from it and the speed `omega` the `row`."""
        most = int(np.unique(self.nodes, return_counts=True)[1].max(initial=0))
        lines = ["row = node", *["row = row + (to_next[row] if rest >= ends[row] else 0)"] * most]
        if self.directed:
            block = "0 if omega > 0.0 else 1 if omega < 0.0 else 2 if omega == 0.0 else 3"
            lines.append(f"row = row + {self.block} * ({block})")
        return lines

    @cached_property
    def ends(self) -> FloatArray:
        """(block,) angle from the row's node at which its piece ends by a leap, inf where by none."""
        ends = np.full(self.block, math.inf)
        ends[self._rows_before_leaps] = self.angles - self.nodes * self.grid.step
        return ends

    @cached_property
    def to_next(self) -> IntArray:
        """(block,) how many rows further the piece after such a leap stands."""
        steps = np.zeros(self.block, dtype=np.int64)
        before = self._rows_before_leaps
        steps[before] = self.grid.nodes + np.arange(self.angles.size) - before
        return steps

    @cached_property
    def _rows_before_leaps(self) -> IntArray:
        """(m,) the row whose piece ends at each leap."""
        follows = np.append(False, self.nodes[1:] == self.nodes[:-1]) if self.angles.size else np.zeros(0, bool)
        return np.where(follows, self.grid.nodes + np.arange(self.angles.size) - 1, self.nodes)
