"""Colours of the views, the same in the viewer and in pictures, and distinguishable for colour-blind readers."""

from __future__ import annotations

from typing import Final

Colour = tuple[int, int, int]

MEASURED: Final[Colour] = (255, 166, 48)
PREDICTED: Final[Colour] = (64, 190, 255)
RESIDUAL: Final[Colour] = (255, 110, 160)
OVER_LIMIT: Final[Colour] = (255, 70, 70)
LIMIT: Final[Colour] = (130, 135, 145)
MEASURES: Final[tuple[Colour, ...]] = ((150, 214, 110), (64, 190, 255), (214, 150, 230), (236, 222, 170))
NOW: Final[Colour] = (255, 255, 255)

IN_BACKING: Final[Colour] = (46, 160, 98)
FREE: Final[Colour] = (62, 70, 84)
ADVANCING: Final[Colour] = (70, 104, 168)
RETURNING: Final[Colour] = (120, 88, 160)

BACKGROUND: Final[Colour] = (16, 19, 24)
GRID: Final[Colour] = (48, 54, 64)
FRAME: Final[Colour] = (96, 104, 118)
TEXT: Final[Colour] = (205, 211, 220)

STEEL: Final[Colour] = (196, 202, 210)
DARK_STEEL: Final[Colour] = (96, 104, 116)
GROUND: Final[Colour] = (72, 79, 90)
NEEDLE: Final[Colour] = (236, 222, 170)
LINKS: Final[tuple[Colour, ...]] = (
    (214, 92, 74),
    (78, 140, 214),
    (92, 178, 120),
    (110, 196, 138),
    (206, 160, 76),
    (170, 178, 190),
    (164, 120, 204),
    (86, 184, 190),
)


def dim(colour: Colour, share: float) -> Colour:
    """Return the colour blended over the background at this opacity; views of lines have no transparency."""
    mixed = [round(share * c + (1.0 - share) * b) for c, b in zip(colour, BACKGROUND, strict=True)]
    return mixed[0], mixed[1], mixed[2]
