"""Ratios of times within each round, which hold on any computer, even while its clock speed changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.bench.run import Row
from textile_twin_core.bench.yardsticks import YARDSTICK

COMPILED = ("casadi", "jax", "numba")
"""Peers that compile the same closed form."""
RIGID_BODIES = ("pinocchio", "mujoco", "drake", "exudyn")
"""Peers that are engines for general systems of rigid bodies."""
_EXACT, _TABLE = "exact", "table 1e-13"
_C = "C, vectorised"
_TORQUE, _POSITION, _EVERYTHING = "torque", "position", "everything"


@dataclass(frozen=True)
class Ratio:
    """Time per sample of `above` over that of `below` in the same round: median and quartiles of the rounds."""

    above: str
    below: str
    median: float
    quartile_1: float
    quartile_3: float


def quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Return first quartile, median, third quartile."""
    first, median, third = np.percentile(values, (25.0, 50.0, 75.0))
    return float(first), float(median), float(third)


def ratios(rows: Sequence[Row]) -> list[Ratio]:
    """Compare batches of the torque: ours over compiled code and yardsticks, engines over ours; then other outputs."""
    return [
        ratio(row_name(above), row_name(below), above.ns_per_round, below.ns_per_round)
        for above, below in _pairs(rows)
        if above.ns_per_round and below.ns_per_round
    ]


def ratio(above: str, below: str, times_above: Sequence[float], times_below: Sequence[float]) -> Ratio:
    """Return the ratio of two candidates timed in the same rounds."""
    first, median, third = quartiles([a / b for a, b in zip(times_above, times_below, strict=True)])
    return Ratio(above, below, median, first, third)


def row_name(row: Row) -> str:
    """Return the name of the row, with its outputs unless they are the torque."""
    return row.name if row.outputs == _TORQUE else f"{row.name}, {row.outputs}"


def _pairs(rows: Sequence[Row]) -> Iterator[tuple[Row, Row]]:
    by_name = {(row.outputs, row.name): row for row in rows}
    exact, table = by_name.get((_TORQUE, _EXACT)), by_name.get((_TORQUE, _TABLE))
    if exact is None:
        return
    torque = [row for row in rows if row.outputs == _TORQUE]
    for row in torque:
        if row.peer == "C":
            yield from ((ours, row) for ours in (exact, table) if ours is not None)
        elif row.peer in (*COMPILED, YARDSTICK):
            yield exact, row
    for row in torque:
        if row.peer in RIGID_BODIES:
            yield row, exact
    position, everything = by_name.get((_POSITION, _EXACT)), by_name.get((_EVERYTHING, _EXACT))
    if position is not None:
        yield position, exact
    if everything is not None and (_EVERYTHING, _C) in by_name:
        yield everything, by_name[_EVERYTHING, _C]
