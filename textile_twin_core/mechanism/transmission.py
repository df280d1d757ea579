"""Transmission: how near a group comes to opening and at which angle it passes its force on."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Transmission:
    """Of one group, over the range of the shaft angle.

    distance_m: how far it is, at its nearest, from where it opens. range_rad: smallest and largest transmission angle.
    grashof: class of a four-bar linkage, by which links turn fully; None elsewhere. passes: whether its branch goes on
    smoothly where all links come into one line; passing: the branches that would.
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
    """Smallest and largest transmission angle of a dyad [rad].

    Its two closure values add up to the constant `whole`: over that they are cos^2 and sin^2 of half the angle. Given
    are the smallest value of each.
    """
    smallest, rest = (2.0 * math.asin(min(1.0, math.sqrt(v / whole))) for v in (folded, stretched))
    return smallest, math.pi - rest
