"""Meeting point of two links: rough assembly of a linkage, from which an outside engine starts its own search."""

from __future__ import annotations

import cmath
import math


def meeting(start: complex, end: complex, first: float, second: float, left: bool) -> complex:
    """The point at `first` from start and `second` from end, left or right of the direction start -> end."""
    way = end - start
    turn = math.acos((first**2 + abs(way) ** 2 - second**2) / (2.0 * first * abs(way)))
    return start + cmath.rect(first, cmath.phase(way) + (turn if left else -turn))
