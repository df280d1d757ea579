"""Piecewise polynomials of an expression, found by search among their edges.

The graph has them as a tree of choices, which every back end evaluates. Single samples and compiled loops search the
piece instead: a loop without branches would evaluate all pieces for every sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from hashlib import blake2b
from typing import Any, Final, NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.expression.graph import Expr, const, node
from textile_twin_core.expression.operations import at_least, select
from textile_twin_core.expression.real import Symbolic
from textile_twin_core.expression.traversal import topological_order

DEGREE: Final = 3
"""Highest degree of a piece that is searched."""
_TOGETHER: Final = 16
"""Samples that are evaluated by the piece of the first one, and again where another lies in a different piece."""
Row = tuple[float, ...]
"""Origin of a piece, then the coefficients of the powers of the distance from it, lowest first."""


class Rows(NamedTuple):
    """Pieces by number of the edges at or below a place, where a condition holds and where not."""

    edges: tuple[float, ...]
    yes: tuple[Row, ...]
    no: tuple[Row, ...]

    @property
    def degree(self) -> int:
        """Highest degree of the pieces."""
        return max(k for row in (*self.yes, *self.no) for k in range(DEGREE + 1) if row[k + 1] or not k)

    @property
    def name(self) -> str:
        """Name of their arrays in compiled code."""
        return f"rows_{blake2b(repr(self).encode(), digest_size=12).hexdigest()}"

    def arrays(self) -> dict[str, FloatArray]:
        """Return edges (n,) and coefficients (2 (n + 1), 2 + DEGREE), where the condition does not hold first."""
        return {f"edges_{self.name}": np.array(self.edges), self.name: np.array([*self.no, *self.yes])}


def piecewise(place: Expr, condition: Expr, edges: Sequence[float], yes: Sequence[Row], no: Sequence[Row]) -> Expr:
    """Express a polynomial of `place` that changes at edges (n,): a row of `yes` (n + 1,) where the condition is not 0.

    At an edge the row above it holds.
    """
    yes, no = [_plain(row) for row in yes], [_plain(row) for row in no]
    changes = [k for k in range(len(edges)) if yes[k] != yes[k + 1] or no[k] != no[k + 1]]
    edges = [edges[k] for k in changes]
    yes, no = ([rows[0], *(rows[k + 1] for k in changes)] for rows in (yes, no))
    leaves = [select(condition, _value(a, place), _value(b, place)) for a, b in zip(yes, no, strict=True)]
    tree = _tree(place, edges, leaves)
    numbers = [*edges, *(number for row in (*yes, *no) for number in row)]
    longest = max(len(row) for row in (*yes, *no))
    flat = tree.op != "select" or condition.is_constant
    over_another = any(each.op == "piecewise" for each in topological_order([place, condition]))
    if flat or over_another or longest > DEGREE + 2 or any(isinstance(number, Symbolic) for number in numbers):
        return tree
    rows = Rows(tuple(edges), *(tuple((*row, *(0.0,) * (DEGREE + 2 - len(row))) for row in way) for way in (yes, no)))
    return node("piecewise", (place, condition, tree), rows)


def searched(outputs: Iterable[Expr]) -> list[Expr]:
    """Leave out the trees of the piecewise polynomials, which the outputs then name by place and condition alone."""
    outputs = list(outputs)
    new: dict[Expr, Expr] = {}
    for each in topological_order(outputs):
        args = tuple(new[a] for a in each.args[: 2 if each.op == "piecewise" else None])
        new[each] = each if args == each.args else node(each.op, args, each.payload)
    return [new[each] for each in outputs]


def rows_of(each: Expr) -> Rows:
    """Return the rows of a piecewise polynomial."""
    assert isinstance(each.payload, Rows)
    return each.payload


def _plain(row: Row) -> Row:
    """Return the row with origin 0 if it is constant."""
    last = max((k for k, number in enumerate(row[1:], 1) if isinstance(number, Symbolic) or number), default=1)
    return (0.0, row[1]) if last == 1 else row[: last + 1]


def _value(row: Row, place: Expr) -> Expr:
    distance = place - row[0]
    value = const(0.0)
    for coefficient in reversed(row[1:]):
        value = value * distance + coefficient
    return value


def _tree(place: Expr, edges: Sequence[float], leaves: Sequence[Expr]) -> Expr:
    """Choose among leaves by bisection of the edges between them."""
    if len(leaves) == 1:
        return leaves[0]
    middle = len(edges) // 2
    upper = _tree(place, edges[middle + 1 :], leaves[middle + 1 :])
    return select(at_least(place, edges[middle]), upper, _tree(place, edges[:middle], leaves[: middle + 1]))


@partial(compiled, inlined=True, counted=False)
def piece(place: Any, condition: Any, edges: Any, rows: Any) -> Any:
    """Evaluate the polynomial at one place."""
    low, high = 0, edges.shape[0]
    while low < high:
        middle = (low + high) // 2
        if place >= edges[middle]:
            low = middle + 1
        else:
            high = middle
    r = low + (edges.shape[0] + 1 if condition != 0.0 else 0)
    t = place - rows[r, 0]
    return rows[r, 1] + t * (rows[r, 2] + t * (rows[r, 3] + t * rows[r, 4]))


@partial(compiled, noalias=True, interleave=1, counted=False)
def along(places: Any, conditions: Any, count: int, edges: Any, rows: Any, values: Any) -> None:
    """Evaluate the polynomial at places one after the other, of which neighbours mostly lie in one piece."""
    n, k = edges.shape[0], 0
    for first in range(0, count, _TOGETHER):
        end = min(first + _TOGETHER, count)
        near, way, found = places[first:end], conditions[first:end], values[first:end]
        x, condition = near[0], way[0]
        while k < n and x >= edges[k]:
            k += 1
        while k > 0 and x < edges[k - 1]:
            k -= 1
        below, above = edges[k - 1] if k > 0 else -np.inf, edges[k] if k < n else np.inf
        r = k + (n + 1 if condition != 0.0 else 0)
        origin, a, b, c, d = rows[r, 0], rows[r, 1], rows[r, 2], rows[r, 3], rows[r, 4]
        outside = 0
        for i in range(near.shape[0]):
            x = near[i]
            t = x - origin
            found[i] = a + t * (b + t * (c + t * d))
            outside += 1 if (x < below) | (x >= above) | (way[i] != condition) else 0
        for i in range(near.shape[0] if outside else 0):
            x = near[i]
            while k < n and x >= edges[k]:
                k += 1
            while k > 0 and x < edges[k - 1]:
                k -= 1
            r = k + (n + 1 if way[i] != 0.0 else 0)
            t = x - rows[r, 0]
            found[i] = rows[r, 1] + t * (rows[r, 2] + t * (rows[r, 3] + t * rows[r, 4]))
