"""Laws of motion made of strokes and dwells, each stroke by a standard law of cam design."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from textile_twin_core.errors import MachineError
from textile_twin_core.mechanism.motion_law import TURN, MotionLaw, Section

Parts = list[tuple[float, Section]]
LawName = Literal[
    "modified_sine", "cycloidal", "modified_trapezoid", "polynomial_345", "polynomial_4567", "simple_harmonic"
]


def _modified_sine(stroke: float, angle: float) -> Parts:
    """Build the standard modified sine, with quarter-periods of four times the frequency at its ends (peak 5.528)."""
    unit = stroke / (4.0 + math.pi)
    slope = math.pi * unit / angle
    eighth = angle / 8.0
    fast, slow = 4.0 * math.pi / angle, 4.0 * math.pi / (3.0 * angle)
    # each phase refers to the start of its section
    return [
        (0.0, Section((0.0, slope), -unit / 4.0, fast, 0.0)),
        (eighth, Section((2.0 * unit + slope * eighth, slope), -9.0 * unit / 4.0, slow, math.pi / 2.0)),
        (7.0 * eighth, Section((4.0 * unit + slope * 7.0 * eighth, slope), -unit / 4.0, fast, 3.5 * math.pi)),
    ]


def _cycloidal(stroke: float, angle: float) -> Parts:
    """Build the standard cycloidal law: one full sine of acceleration (peak 2 pi)."""
    return [(0.0, Section((0.0, stroke / angle), -stroke / TURN, TURN / angle, 0.0))]


def _modified_trapezoid(stroke: float, angle: float) -> Parts:
    """Build the modified trapezoid: constant acceleration between quarter sines (peak 4.888).

    Each quarter sine takes an eighth of the stroke. The first half is integrated from s'' = a sin(4 pi u), a, a cos(4
    pi (u - 3/8)); the second half mirrors the first.
    """
    peak = 8.0 * math.pi / (2.0 + math.pi)  # peak of s'' for a unit stroke over a unit turn
    w = 4.0 * math.pi
    amplitude = peak / (w * w)
    speed = peak / w
    parts: list[tuple[float, Section]] = [(0.0, Section((0.0, speed), -amplitude, w, 0.0))]
    at_1 = speed / 8.0 - amplitude
    parts.append((0.125, Section((at_1, speed, 0.5 * peak))))
    at_3, speed_3 = at_1 + 0.25 * speed + 0.5 * peak / 16.0, speed + 0.25 * peak
    parts.append((0.375, Section((at_3 + amplitude, speed_3), -amplitude, w, math.pi / 2.0)))
    at_5 = 1.0 - at_3
    parts.append((0.625, Section((at_5, speed_3, -0.5 * peak))))
    # 1 - s(1 - u) of the first section, past u = 7/8
    parts.append((0.875, Section((1.0 - speed / 8.0, speed), -amplitude, w, -math.pi / 2.0)))
    return [(start * angle, _stretched(section, stroke, angle)) for start, section in parts]


def _polynomial(*coefficients: float) -> Callable[[float, float], Parts]:
    return lambda stroke, angle: [(0.0, _stretched(Section(coefficients), stroke, angle))]


def _simple_harmonic(stroke: float, angle: float) -> Parts:
    """Build half a cosine; its acceleration is discontinuous at a dwell."""
    return [(0.0, Section((0.5 * stroke,), -0.5 * stroke, math.pi / angle, math.pi / 2.0))]


def _stretched(section: Section, stroke: float, angle: float) -> Section:
    """Scale a section of the unit stroke over a unit turn to this stroke and angle."""
    polynomial = tuple(stroke * c / angle**k for k, c in enumerate(section.polynomial))
    return Section(polynomial, stroke * section.amplitude, section.frequency / angle, section.phase)


_RISES: dict[str, Callable[[float, float], Parts]] = {
    "modified_sine": _modified_sine,
    "cycloidal": _cycloidal,
    "modified_trapezoid": _modified_trapezoid,
    "polynomial_345": _polynomial(0.0, 0.0, 0.0, 10.0, -15.0, 6.0),
    "polynomial_4567": _polynomial(0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0),
    "simple_harmonic": _simple_harmonic,
}
NAMES = tuple(_RISES)
"""Names of the standard laws (R. L. Norton, Cam Design and Manufacturing Handbook, 2nd ed. 2009, ch. 3)."""


@dataclass(frozen=True)
class Stroke:
    """A stroke from the shaft or cam angle `start_rad`, over `turn_rad`, to the position `to`, by a standard law."""

    start_rad: float
    turn_rad: float
    to: float
    law: LawName = "modified_sine"


def law_of_strokes(strokes: Sequence[Stroke], name: str = "strokes", rest: float = 0.0) -> MotionLaw:
    """Build a law that starts at the position `rest` at angle 0, follows the strokes, and dwells between them.

    Raises:
        MachineError: for an unknown law, strokes that overlap or leave the turn, and a last stroke that does not return
            to `rest`.
    """
    for stroke in strokes:
        if stroke.law not in _RISES:
            raise MachineError(f"motion_law is {stroke.law!r}; there are {', '.join(NAMES)}, or give a table")
        if not (stroke.turn_rad > 0.0 and math.isfinite(stroke.to)):
            raise MachineError(f"a stroke takes {stroke.turn_rad} rad to {stroke.to!r}; it must take some angle")
    ends = [(0.0, 0.0), *((s.start_rad, s.start_rad + s.turn_rad) for s in strokes), (TURN, TURN)]
    for (_, end), (start, _) in pairwise(ends):
        if not start >= end - 1e-12 * TURN:
            raise MachineError(
                f"a stroke ends at {end:.4f} rad, and the next part starts at {start:.4f} rad; strokes must follow one "
                f"another within one turn ({TURN:.4f} rad)"
            )
    if not strokes or abs(strokes[-1].to - rest) > 1e-12 * max(abs(s.to - rest) for s in strokes):
        raise MachineError(f"the last stroke must lead back to {rest:g}, where the turn begins")
    parts: Parts = []
    position, end = rest, 0.0
    for stroke in strokes:
        if end < stroke.start_rad:
            parts.append((end, Section((position,))))
        for start, section in _RISES[stroke.law](stroke.to - position, stroke.turn_rad):
            lifted = (section.polynomial[0] + position, *section.polynomial[1:])
            parts.append((stroke.start_rad + start, replace(section, polynomial=lifted)))
        position, end = stroke.to, stroke.start_rad + stroke.turn_rad
    if end < TURN:
        parts.append((end, Section((position,))))
    return MotionLaw(name, tuple(start for start, _ in parts), tuple(section for _, section in parts))
