"""Periodic tables: smooth functions of the shaft angle as piecewise polynomials, all gathered at once.

Around each node stands the polynomial through the function's values at the Chebyshev points of the interval,
in powers of the angle from the node. The coefficients of up to four functions lie side by side, so that
one gather fetches all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.expression import Expr
from textile_twin_core.expression.aligned import aligned_rows
from textile_twin_core.expression.angle_grid import AngleGrid
from textile_twin_core.expression.blocks import BlockProgram

MOST_NODES = 4096
_FEWEST_NODES = 32
_DEGREES = (1, 2, 3, 4, 5, 7)
_CHEAP_NODES = 2048
_ROUNDING = 4e-16


@dataclass(frozen=True)
class PeriodicTable:
    """Piecewise polynomials: coefficients (degree + 1, nodes, functions), lowest power first.

    `errors` are the largest deviations found off the nodes, each over its function's largest value.
    """

    grid: AngleGrid
    coefficients: FloatArray
    errors: FloatArray

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return int(self.coefficients.shape[0]) - 1

    @cached_property
    def groups(self) -> tuple[tuple[int, int, list[FloatArray]], ...]:
        """(first function, width, tables by power): functions in groups of four, two or one."""
        count = self.coefficients.shape[2]
        found = []
        start = 0
        while start < count:
            left = count - start
            width = 4 if left >= 3 else left
            padded = np.zeros((*self.coefficients.shape[:2], width))
            taken = min(width, left)
            padded[:, :, :taken] = self.coefficients[:, :, start : start + taken]
            found.append((start, width, [np.ascontiguousarray(level) for level in padded]))
            start += taken
        return tuple(found)

    def rows(self) -> list[tuple[float, ...]]:
        """Per interval the coefficients, function by function, lowest power first."""
        table = self.coefficients.transpose(1, 2, 0).reshape(self.grid.nodes, -1)
        return [tuple(row) for row in table.tolist()]


class TableReader:
    """Buffers to evaluate a table in chunks of at most `chunk` samples."""

    def __init__(self, table: PeriodicTable, chunk: int) -> None:
        self.table = table
        self._sums = [aligned_rows(1, chunk * width)[0].reshape(chunk, width) for _, width, _ in table.groups]
        self._powers = [aligned_rows(1, chunk * width)[0].reshape(chunk, width) for _, width, _ in table.groups]
        widest = max(width for _, width, _ in table.groups)
        self._rest = np.empty((chunk, widest))
        self._ones = {width: np.ones((1, width)) for _, width, _ in table.groups}

    def read(self, index: IntArray, rest: FloatArray) -> list[FloatArray]:
        """Values of all functions, strided views of (n,), at node and angle from it."""
        n, columns = index.shape[0], []
        spread: dict[int, FloatArray] = {1: rest}
        for (_, width, levels), total, power in zip(self.table.groups, self._sums, self._powers, strict=True):
            if width not in spread:
                wide = self._rest.reshape(-1)[: n * width].reshape(n, width)
                np.dot(rest[:, None], self._ones[width], out=wide)
                spread = {1: rest, width: wide}
            flat_rest = spread[width].reshape(-1)
            flat_total, flat_power = total[:n].reshape(-1), power[:n].reshape(-1)
            levels[-1].take(index, axis=0, out=total[:n], mode="clip")
            for level in reversed(levels[:-1]):
                np.multiply(flat_total, flat_rest, flat_total)
                level.take(index, axis=0, out=power[:n], mode="clip")
                np.add(flat_total, flat_power, flat_total)
            columns += [total[:n, j] for j in range(width)]
        return self._without_padding(columns)

    def _without_padding(self, columns: list[FloatArray]) -> list[FloatArray]:
        kept, position, count = [], 0, self.table.coefficients.shape[2]
        for start, width, _ in self.table.groups:
            kept += columns[position : position + min(width, count - start)]
            position += width
        return kept


def tabulate(functions: Sequence[Expr], weights: FloatArray, tolerance: float) -> PeriodicTable | None:
    """The cheapest table of functions of theta that keeps outputs within the tolerance, off the nodes.

    `weights` (outputs, functions) is what an error of a function, over its own largest value, does to an
    output. None when rounding or `MOST_NODES` forbid it.
    """
    program = BlockProgram(functions, ["theta"])
    for most in (_CHEAP_NODES, MOST_NODES):
        for degree in _DEGREES:
            nodes = _FEWEST_NODES
            while nodes <= most:
                table = _fit(program, len(functions), nodes, degree)
                excess = float((weights @ table.errors).max(initial=0.0)) / max(tolerance, _ROUNDING)
                if excess <= 1.0:
                    return table
                nodes = _next_nodes(nodes, excess, degree)
    return None


def _next_nodes(nodes: int, excess: float, degree: int) -> int:
    """Halving the interval divides the error by 2^(degree + 1): jump, but never past what may suffice."""
    doublings = max(1, math.floor(math.log2(max(excess, 2.0)) / (degree + 1)))
    return nodes << doublings


def _fit(program: BlockProgram, count: int, nodes: int, degree: int) -> PeriodicTable:
    grid = AngleGrid(nodes)
    points = degree + 1
    angles = (np.arange(points) + 0.5) * math.pi / points
    node = np.arange(nodes)[:, None] * grid.step
    values = _evaluate(program, count, node + 0.5 * np.cos(angles) * grid.step)
    orders = np.arange(points)
    to_chebyshev = np.where(orders > 0, 2.0, 1.0)[:, None] / points * np.cos(np.outer(orders, angles))
    to_powers = np.zeros((points, points))
    for order in orders:
        powers = chebyshev.cheb2poly(np.eye(points)[order][: order + 1])
        to_powers[: powers.size, order] = powers
    scale = (2.0 / grid.step) ** orders
    coefficients = np.einsum("dc,cp,npf->dnf", to_powers, to_chebyshev, values) * scale[:, None, None]
    off = np.array([-0.5, -0.31, 0.0, 0.22, 0.5]) * grid.step
    exact = _evaluate(program, count, node + off)
    approximate = np.zeros_like(exact)
    for level in coefficients[::-1]:
        approximate = approximate * off[None, :, None] + level[:, None, :]
    size = np.abs(exact).max(axis=(0, 1))
    errors = np.abs(approximate - exact).max(axis=(0, 1)) / np.where(size > 0.0, size, 1.0)
    return PeriodicTable(grid, np.ascontiguousarray(coefficients), errors)


def _evaluate(program: BlockProgram, count: int, theta: FloatArray) -> FloatArray:
    """(nodes, points, functions)."""
    out = np.empty((count, theta.size))
    program([np.ascontiguousarray(theta.reshape(-1))], list(out))
    return out.reshape(count, *theta.shape).transpose(1, 2, 0)
