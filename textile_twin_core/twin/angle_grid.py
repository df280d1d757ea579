"""A grid of nodes over one turn: the node nearest to an angle and the rest, without loss up to 1e9 rad."""

from __future__ import annotations

import math

# 2 pi to 107 bits, as the sum of two doubles
_TURN = 2.0 * math.pi
_TURN_REST = 2.4492935982947064e-16


class AngleGrid:
    """`nodes`, a power of two, equally spaced over one turn.

    Their distance is kept in three `parts` (Cody and Waite 1980), so that products with the number of a node are exact.
    """

    def __init__(self, nodes: int) -> None:
        if nodes < 2 or nodes & (nodes - 1):
            raise ValueError(f"the number of nodes must be a power of two, not {nodes}")
        self.nodes = nodes
        self.step = _TURN / nodes
        first = _leading_bits(self.step, 14)
        second = _leading_bits(self.step - first, 14)
        self.parts = (first, second, (self.step - first - second) + _TURN_REST / nodes)

    def reduction(self) -> list[str]:
        """Lines of Python: from `theta` the nearest `node`, 0..nodes-1, and the angle `rest` from it."""
        rounder = 1.5 * 2.0**52  # added to a number, it leaves the nearest integer in the last bits
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
