"""A grid of nodes over one turn: the node nearest to an angle and the rest, without loss up to 1e9 rad."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.expression.blas import add_multiples, power

LARGEST_ANGLE: Final = 1.05e9
"""Up to here [rad] the reduction is exact to 5e-16 rad with 2048 nodes or fewer."""

# 2 pi to 107 bits, as the sum of two doubles
_TURN = 2.0 * math.pi
_TURN_REST = 2.4492935982947064e-16

_NEAR_BITS = 28
_ROUNDER = np.asarray(1.5 * 2.0**52)
"""Added to a number, it leaves the nearest integer in the last bits."""


class AngleGrid:
    """`nodes`, a power of two, equally spaced over one turn, or over `turns`, another power of two; both positive.

    Their distance is kept in three parts (Cody and Waite 1980), so that products with the number of a node are exact;
    near zero two parts do.
    """

    def __init__(self, nodes: int, turns: float = 1.0) -> None:
        if nodes < 2 or nodes & (nodes - 1):
            raise ValueError(f"the number of nodes must be a power of two, not {nodes}")
        self.nodes = nodes
        self.step = turns * _TURN / nodes
        self.inverse = nodes / (turns * _TURN)
        first = _leading_bits(self.step, 14)
        second = _leading_bits(self.step - first, 14)
        below = turns * _TURN_REST / nodes
        self.parts = (first, second, (self.step - first - second) + below)
        near = _leading_bits(self.step, _NEAR_BITS)
        self._near_rest = (self.step - near) + below
        self._inverse, self._first, self._near = np.asarray(self.inverse), np.asarray(first), np.asarray(near)
        self._near_limit = 2.0 ** (52 - _NEAR_BITS) * self.step
        self._limit = turns * LARGEST_ANGLE
        self._mask = np.asarray(nodes - 1)

    def reduce(self, theta: FloatArray, index: IntArray, rest: FloatArray, work: FloatArray) -> bool:
        """Nearest node, 0..nodes-1, and the angle from it, of (n,) angles, into `index` and `rest`.

        False, with nothing written, where one of the angles is beyond LARGEST_ANGLE (times the turns) or NaN.
        """
        squares = power(theta)  # one cheap pass, which bounds every angle
        near = squares < self._near_limit**2
        if not (near or squares < self._limit**2 or (theta.max() < self._limit and theta.min() > -self._limit)):
            return False
        np.multiply(theta, self._inverse, work)
        np.add(work, _ROUNDER, work)
        np.bitwise_and(work.view(np.int64), self._mask, index)
        np.subtract(work, _ROUNDER, work)
        np.multiply(work, self._near if near else self._first, rest)
        np.subtract(theta, rest, rest)
        if near:
            add_multiples(work, rest, -self._near_rest)
        else:
            add_multiples(work, rest, -self.parts[1], -self.parts[2])
        return True


def _leading_bits(value: float, bits: int) -> float:
    mantissa, exponent = math.frexp(value)
    return math.ldexp(math.floor(math.ldexp(mantissa, bits)), exponent - bits)
