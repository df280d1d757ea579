"""Sine and cosine together over arrays: a table of nodes and a short series, faster than a call of each.

sin(x) = S + (S (cos r - 1) + C sin r) with the nearest node's sine S and cosine C and the rest r (Gal 1986).
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression.angle_grid import AngleGrid
from textile_twin_core.expression.blas import add_multiples

_NODES: Final = 2048
_TURN: Final = 2 * (np.longdouble(np.pi) + np.longdouble(1.2246467991473532e-16))


def _node_table() -> tuple[FloatArray, FloatArray]:
    """Sines and cosines of the nodes, rounded from extended precision; exact where they are 0 or 1."""
    quarter = _NODES // 4
    first = np.sin(np.arange(quarter + 1) * (_TURN / _NODES)).astype(np.float64)
    first[0], first[quarter] = 0.0, 1.0
    half = np.concatenate((first, first[-2::-1]))
    sines = np.concatenate((half[:-1], -half[:-1]))
    return sines, np.roll(sines, -quarter)


_SINES, _COSINES = _node_table()
# sin r = r + r^3 CUBE and cos r - 1 = -(r^2 + r^4 FOURTH) / 2, to 1e-17 for |r| <= pi / 2048
_CUBE: Final = -1.0 / 6.0 + 0.87 / 120.0 * (np.pi / _NODES) ** 2
_FOURTH: Final = -1.0 / 12.0


@cache
def _grid(factor: float) -> AngleGrid:
    return AngleGrid(_NODES, 1.0 / factor)


def sincos(x: FloatArray, sine: FloatArray, cosine: FloatArray, work: list[FloatArray], factor: float = 1.0) -> None:
    """Sine and cosine of `factor`, a power of two, times (n,) numbers x into `sine` and `cosine`.

    `work` is four arrays of (n,). Errors stay below 1.2 units in the last place of 1. Angles beyond 1e9 rad, infinite
    ones and NaN go the way of numpy's functions.
    """
    rest, square, power, index = work[0], work[1], work[2], work[3].view(np.int64)
    if not _grid(factor).reduce(x, index, rest, square):  # r / factor
        np.multiply(x, factor, rest)
        np.sin(rest, sine)
        np.cos(rest, cosine)
        return
    np.multiply(rest, rest, square)
    np.multiply(square, rest, power)
    add_multiples(power, rest, _CUBE * factor**2)  # sin r / factor
    np.multiply(square, square, power)
    add_multiples(power, square, _FOURTH * factor**2)  # (2 - 2 cos r) / factor^2
    _SINES.take(index, out=sine, mode="clip")
    _COSINES.take(index, out=cosine, mode="clip")
    away = work[3]
    np.multiply(sine, rest, power)
    np.multiply(cosine, square, away)
    add_multiples(away, power, 0.5 * factor)
    np.multiply(cosine, rest, rest)
    add_multiples(power, cosine, -factor)
    np.multiply(sine, square, square)
    add_multiples(square, rest, -0.5 * factor)
    add_multiples(rest, sine, factor)
