"""A law of motion as the drive of a contact model, cut into pieces in time as the shaft turns."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.drive import DrivePiece
from textile_twin_core.contact.polynomials import first_crossing, move
from textile_twin_core.mechanism.motion_law import TURN, MotionLaw

_ANGLE_NOISE = 1e-14
"""rad, besides rounding: two sections join so smoothly that their ends need no better accuracy"""


def law_pieces(law: MotionLaw, start_s: float, end_s: float, theta: Sequence[float]) -> Iterator[DrivePiece]:
    """Yield the pieces in time of a law of motion, for a shaft angle that is a polynomial in time.

    `theta` are its coefficients in seconds past start, lowest first. The pieces are cut where the shaft passes, in
    either direction, from one section of the law into another.
    """
    turns = math.floor(theta[0] / TURN)
    angle = theta[0] - turns * TURN
    k = bisect_right(law.starts_rad, angle) - 1
    base = law.starts_rad[k]
    time = start_s
    stalled = 0
    while time < end_s:
        past, width = np.array((angle - base, *theta[1:])), law.width(k)
        noise = _ANGLE_NOISE + 2.0 * math.ulp(base), 2.0 * math.ulp(time)
        u, step = _leaves(past, time - start_s, end_s - time, width, noise)
        if stalled >= 3:
            u, step = 1.0, 0
        leave = end_s if step == 0 else min(time + u * (end_s - time), end_s)
        if leave > time:
            yield DrivePiece(time, leave, law.sections[k], tuple(past.tolist()))
            stalled = 0
        else:
            stalled += 1
        time = leave
        if step > 0:
            base += width
        k = (k + step) % len(law.sections)
        if step < 0:
            base -= law.width(k)


@compiled
def _leaves(
    angle: FloatArray, later_s: float, span_s: float, width: float, rounding: tuple[float, float]
) -> tuple[float, int]:
    """Find where an angle, a polynomial in seconds, leaves [0, width] within a span, and to which side (0: it stays).

    The span begins `later_s` after the polynomial's origin, which is moved there; the place is a share of the span. At
    the start the angle may lie outside by the rounding of angle [rad] and time [s].
    """
    move(angle, later_s)
    noise = rounding[0] + (rounding[1] * abs(angle[1]) if angle.size > 1 else 0.0)
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
