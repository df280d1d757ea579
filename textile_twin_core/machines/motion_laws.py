"""Laws of motion of a cam-like drive over one turn of the shaft: modified sine, cycloidal, a table or a function."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.drive import DrivePiece, Section
from textile_twin_core.contact.polynomials import first_crossing, moved
from textile_twin_core.errors import MachineError

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

TURN = 2.0 * math.pi
_FIT_KNOTS_LARGEST = 8192
_ANGLE_NOISE = 1e-14
"""rad, besides rounding: two sections join so smoothly that the place where one ends need not be known better"""


@dataclass(frozen=True)
class MotionLaw:
    """Position [m] of the driven element over one turn of the shaft, in sections that are analytic each.

    Section k holds from starts_rad[k] to starts_rad[k+1] (the last one to 2 pi), as a function of the angle past its
    start. Angles of any turn are accepted.
    """

    name: str
    starts_rad: tuple[float, ...]
    sections: tuple[Section, ...]

    def evaluate(self, theta_rad: float, derivative: int = 0) -> float:
        """Position [m] at a shaft angle, or its derivative with respect to the angle [m/rad^n]."""
        angle = theta_rad % TURN
        k = bisect_right(self.starts_rad, angle) - 1
        return self.sections[k].value(angle - self.starts_rad[k], derivative)

    def pieces(self, start_s: float, end_s: float, theta: Sequence[float]) -> Iterator[DrivePiece]:
        """The motion in time while the shaft angle is the polynomial `theta` (in seconds past start, lowest first).

        It is cut where the shaft, forwards or backwards, passes from one section of the law into another.
        """
        turns = math.floor(theta[0] / TURN)
        angle = theta[0] - turns * TURN
        k = bisect_right(self.starts_rad, angle) - 1
        base = self.starts_rad[k]
        time = start_s
        stalled = 0
        while time < end_s:
            past = moved(np.array((angle - base, *theta[1:])), time - start_s)
            width, speed = self._width(k), abs(float(past[1])) if past.size > 1 else 0.0
            noise = _ANGLE_NOISE + 2.0 * (math.ulp(base) + math.ulp(time) * speed)
            u, step = _leaves(past, end_s - time, width, noise) if stalled < 3 else (1.0, 0)
            leave = end_s if step == 0 else min(time + u * (end_s - time), end_s)
            if leave > time:
                yield DrivePiece(time, leave, self.sections[k], tuple(past.tolist()))
                stalled = 0
            else:
                stalled += 1
            time = leave
            if step > 0:
                base += width
            k = (k + step) % len(self.sections)
            if step < 0:
                base -= self._width(k)

    def _width(self, k: int) -> float:
        end = self.starts_rad[k + 1] if k + 1 < len(self.starts_rad) else TURN
        return end - self.starts_rad[k]


@compiled
def _leaves(angle: FloatArray, span_s: float, width: float, noise: float) -> tuple[float, int]:
    """Where within a span an angle, a polynomial in seconds, leaves [0, width], and to which side (0: it stays).

    The place is a share of the span. At its start the angle may lie outside by `noise`, which the rounding of time and
    angle make.
    """
    series = angle.copy()
    swing, factor = 0.0, 1.0
    for k in range(1, series.size):
        factor *= span_s
        series[k] *= factor
        swing += abs(series[k])
    if swing < series[0] < width - swing:
        return 1.0, 0
    below = first_crossing(series, noise)
    series *= -1.0
    series[0] += width
    above = first_crossing(series, noise)
    if min(below, above) > 1.0:
        return 1.0, 0
    return (below, -1) if below <= above else (above, 1)


def _modified_sine(stroke: float, angle: float) -> list[tuple[float, Section]]:
    """Standard modified sine: a quarter-period of acceleration four times as fast at each end (peak 5.528)."""
    unit = stroke / (4.0 + math.pi)
    slope = math.pi * unit / angle
    eighth = angle / 8.0
    fast, slow = 4.0 * math.pi / angle, 4.0 * math.pi / (3.0 * angle)
    # phases are given at the start of each section
    return [
        (0.0, Section((0.0, slope), -unit / 4.0, fast, 0.0)),
        (eighth, Section((2.0 * unit + slope * eighth, slope), -9.0 * unit / 4.0, slow, math.pi / 2.0)),
        (7.0 * eighth, Section((4.0 * unit + slope * 7.0 * eighth, slope), -unit / 4.0, fast, 3.5 * math.pi)),
    ]


def _cycloidal(stroke: float, angle: float) -> list[tuple[float, Section]]:
    """Standard cycloidal law: one full sine of acceleration (peak 2 pi)."""
    return [(0.0, Section((0.0, stroke / angle), -stroke / TURN, TURN / angle, 0.0))]


_RISES: dict[str, Callable[[float, float], list[tuple[float, Section]]]] = {
    "modified_sine": _modified_sine,
    "cycloidal": _cycloidal,
}
NAMES = tuple(_RISES)
"""Names of the laws that can be chosen by name."""


def rise_dwell_fall(name: str, stroke_m: float, rise_rad: float, fall_start_rad: float, fall_rad: float) -> MotionLaw:
    """Forward by a named law from angle 0, dwell, back by the same law, dwell to the end of the turn.

    Raises MachineError when the law is unknown or the four parts do not fit into one turn.
    """
    if name not in _RISES:
        raise MachineError(f"motion_law is {name!r}; there are {', '.join(NAMES)}, or give a table or a function")
    if not rise_rad > 0.0 or not fall_rad > 0.0:
        raise MachineError(f"the motion takes {min(rise_rad, fall_rad)} rad; forward and return must take some angle")
    if rise_rad > fall_start_rad or fall_start_rad + fall_rad > TURN:
        raise MachineError(
            f"forward ends at {rise_rad:.4f} rad, return runs from {fall_start_rad:.4f} to "
            f"{fall_start_rad + fall_rad:.4f} rad; they must follow one another within one turn (6.2832 rad)"
        )
    rise, fall = _RISES[name](stroke_m, rise_rad), _RISES[name](-stroke_m, fall_rad)
    parts = list(rise)
    if rise_rad < fall_start_rad:
        parts.append((rise_rad, Section((stroke_m,))))
    for start, section in fall:
        lifted = (section.polynomial[0] + stroke_m, *section.polynomial[1:])
        parts.append((fall_start_rad + start, Section(lifted, section.amplitude, section.frequency, section.phase)))
    if fall_start_rad + fall_rad < TURN:
        parts.append((fall_start_rad + fall_rad, Section((0.0,))))
    return MotionLaw(name, tuple(start for start, _ in parts), tuple(section for _, section in parts))


def from_table(theta_rad: FloatArray, position_m: FloatArray, name: str = "table") -> MotionLaw:
    """Law through a user's own points over one turn: periodic quintic spline, continuous up to the fourth derivative.

    The angles increase from the first to at most one turn later; a last point one turn after the first repeats it.
    Raises MachineError when they do not, when values are not finite or fewer than six points are given.
    """
    angles = np.asarray(theta_rad, dtype=float)
    positions = np.asarray(position_m, dtype=float)
    if angles.ndim != 1 or angles.shape != positions.shape or angles.size < 6:
        raise MachineError(
            f"the motion table has shapes {angles.shape} and {positions.shape}; give two lists of at least 6 values"
        )
    if not (np.isfinite(angles).all() and np.isfinite(positions).all()):
        raise MachineError("the motion table has a value that is not finite; remove it")
    wrong = np.flatnonzero(np.diff(angles) <= 0.0)
    if wrong.size:
        raise MachineError(f"the motion table's angle does not increase at row {int(wrong[0]) + 1}; sort the table")
    if angles[-1] - angles[0] > TURN * (1 + 1e-12):
        raise MachineError("the motion table covers more than one turn; cut it to 2 pi rad")
    if angles[-1] - angles[0] < TURN * (1 - 1e-12):
        angles = np.append(angles, angles[0] + TURN)
        positions = np.append(positions, positions[0])
    elif abs(positions[-1] - positions[0]) > 1e-12 * max(float(np.abs(positions).max()), 1e-300):
        raise MachineError("the motion table's first and last row are one turn apart but differ in position")
    positions[-1] = positions[0]
    from scipy.interpolate import PPoly, make_interp_spline  # slow to import, and only tables need it

    spline = PPoly.from_spline(make_interp_spline(angles, positions, k=5, bc_type="periodic"))
    return _from_spline(spline, angles, name)


def from_function(function: Callable[[float], float], name: str = "function") -> MotionLaw:
    """Law fitted to a user's periodic function of the shaft angle, halved until off its knots it errs below 1e-12.

    The error is relative to the function's range; where the function has kinks the finest fit is used as it is.
    """
    count = 64
    while True:
        angles = np.linspace(0.0, TURN, count + 1)
        values = np.array([float(function(angle)) for angle in angles])
        if not np.isfinite(values).all():
            raise MachineError("the motion function gives a value that is not finite")
        law = from_table(angles[:-1], values[:-1], name)
        between = angles[:-1] + 0.5 * np.diff(angles)
        error = max(abs(law.evaluate(angle) - float(function(angle))) for angle in between.tolist())
        if error <= 1e-12 * max(float(np.ptp(values)), 1e-9) or count >= _FIT_KNOTS_LARGEST:
            return law
        count *= 2


def _from_spline(spline: PPoly, angles: FloatArray, name: str) -> MotionLaw:
    """The spline's pieces as sections over [0, 2 pi), the piece that contains 2 pi split in two."""
    wrapped: list[tuple[float, Section]] = []
    for k in range(angles.size - 1):
        coefficients = spline.c[::-1, spline.x.searchsorted(angles[k], side="right") - 1].tolist()
        start, width = float(angles[k]) % TURN, float(angles[k + 1] - angles[k])
        wrapped.append((start, Section(tuple(coefficients))))
        if start + width > TURN * (1 + 1e-15):
            wrapped.append((0.0, Section(tuple(moved(np.array(coefficients), TURN - start).tolist()))))
    wrapped.sort(key=lambda part: part[0])
    return MotionLaw(name, tuple(start for start, _ in wrapped), tuple(section for _, section in wrapped))
