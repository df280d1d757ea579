"""Grid of nodes over one turn: nearest node and offset of an angle, without loss of digits up to 1e9 rad."""

from __future__ import annotations

import math

# 2 pi to 107 bits, as the sum of two doubles.
_TURN = 2.0 * math.pi
_TURN_LOW = 2.4492935982947064e-16


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
