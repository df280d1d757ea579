"""Transmission: distance of a group from opening, and the angle at which it transmits force."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Transmission:
    """Transmission quality of one group over the range of the shaft angle.

    Attributes:
        distance_m: smallest distance from the position in which the group opens.
        range_rad: smallest and largest transmission angle.
        grashof: Grashof class of a four-bar linkage; None for other groups.
        passes: whether the branch continues smoothly through the position with all links in one line.
        passing: the branches that would continue smoothly there.
    """

    distance_m: float
    range_rad: tuple[float, float]
    grashof: str | None = None
    passes: bool = False
    passing: tuple[str, ...] = ()

    @property
    def worst_rad(self) -> float:
        """The transmission angle that is farthest from a right angle, folded to 0 .. 90 deg."""
        smallest, largest = self.range_rad
        return min(smallest, math.pi - largest)


def transmission_angles(stretched: float, folded: float, whole: float) -> tuple[float, float]:
    """Compute the smallest and largest transmission angle of a dyad [rad].

    The two closure values add up to the constant `whole`; their shares are cos^2 and sin^2 of half the angle.

    Args:
        stretched: smallest value of the first closure.
        folded: smallest value of the second closure.
        whole: sum of the two closures at any angle.
    """
    smallest, supplement = (2.0 * math.asin(min(1.0, math.sqrt(v / whole))) for v in (folded, stretched))
    return smallest, math.pi - supplement
