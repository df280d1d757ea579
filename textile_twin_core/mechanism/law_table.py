"""Laws of motion from a user's own points or function: a periodic quintic spline through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MachineError
from textile_twin_core.mechanism.motion_law import TURN, MotionLaw, Section

_FIT_KNOTS_LARGEST = 8192
_SAMPLES = 4097
_LARGEST_OVERSHOOT = 1.5
"""Largest range of the spline over that of its points; six points on a sine span at least 7/8 of its range."""


@dataclass(frozen=True)
class LiftTable:
    """A position [m, or rad for a swinging follower] at increasing angles of a shaft or cam [rad], over one turn."""

    angle_rad: tuple[float, ...]
    lift: tuple[float, ...]

    @cached_property
    def law(self) -> MotionLaw:
        """The spline through the table (see `from_table`)."""
        return from_table(np.array(self.angle_rad), np.array(self.lift))


def from_table(theta_rad: FloatArray, position_m: FloatArray, name: str = "table") -> MotionLaw:
    """Fit a law through the points of a table over one turn: a periodic quintic spline, C4 continuous.

    Args:
        theta_rad: (n,) increasing angles [rad] within one turn; a last point one turn after the first repeats the
            first.
        position_m: (n,) positions [m, or rad for an angle].
        name: name of the law.

    Raises:
        MachineError: for fewer than six points, angles that do not increase or exceed one turn, values that are not
            finite, and points so sparse that the spline overshoots them.
    """
    angles = np.asarray(theta_rad, dtype=float)
    positions = np.array(position_m, dtype=float)  # a copy, as the last value is overwritten
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
    spline = _periodic_spline(angles, positions)
    _check_between(spline, angles, positions)
    return _from_spline(spline, angles, name)


def _periodic_spline(angles: FloatArray, positions: FloatArray) -> scipy.interpolate.PPoly:
    return scipy.interpolate.PPoly.from_spline(
        scipy.interpolate.make_interp_spline(angles, positions, k=5, bc_type="periodic")
    )


def _check_between(spline: scipy.interpolate.PPoly, angles: FloatArray, positions: FloatArray) -> None:
    """Raise MachineError if the range of the spline exceeds `_LARGEST_OVERSHOOT` times that of its points."""
    over_turn = spline(np.linspace(angles[0], angles[-1], _SAMPLES))
    lowest, highest = float(positions.min()), float(positions.max())
    rounding = 1e-12 * max(abs(lowest), abs(highest))
    if np.ptp(over_turn) > _LARGEST_OVERSHOOT * (highest - lowest) + rounding:
        raise MachineError(
            f"the motion table lies from {lowest:g} to {highest:g}, but the smooth curve through it from "
            f"{over_turn.min():.3g} to {over_turn.max():.3g}: give more points where it bends"
        )


def from_function(function: Callable[[float], float], name: str = "function") -> MotionLaw:
    """Fit a law to a periodic function of the shaft angle, halving the spacing until the error is below 1e-12.

    The error is measured between the knots, relative to the function's range. If the function has kinks, the finest fit
    is used as it is.
    """
    count = 64
    while True:
        angles = np.linspace(0.0, TURN, count + 1)
        values = np.array([float(function(angle)) for angle in angles])
        values[-1] = values[0]
        if not np.isfinite(values).all():
            raise MachineError("the motion function gives a value that is not finite")
        law = _from_spline(_periodic_spline(angles, values), angles, name)
        between = angles[:-1] + 0.5 * np.diff(angles)
        error = max(abs(law.evaluate(angle) - float(function(angle))) for angle in between.tolist())
        if error <= 1e-12 * max(float(np.ptp(values)), 1e-9) or count >= _FIT_KNOTS_LARGEST:
            return law
        count *= 2


def _from_spline(spline: scipy.interpolate.PPoly, angles: FloatArray, name: str) -> MotionLaw:
    """Convert the spline to sections over [0, 2 pi); the piece that contains 2 pi is split."""
    wrapped: list[tuple[float, Section]] = []
    for k in range(angles.size - 1):
        coefficients = spline.c[::-1, spline.x.searchsorted(angles[k], side="right") - 1].tolist()
        start, width = float(angles[k]) % TURN, float(angles[k + 1] - angles[k])
        wrapped.append((start, Section(tuple(coefficients))))
        if start + width > TURN * (1 + 1e-15):
            wrapped.append((0.0, Section(_shifted(coefficients, TURN - start))))
    wrapped.sort(key=lambda part: part[0])
    return MotionLaw(name, tuple(start for start, _ in wrapped), tuple(section for _, section in wrapped))


def _shifted(polynomial: list[float], offset: float) -> tuple[float, ...]:
    """Expand p(offset + t) in powers of t by repeated synthetic division."""
    result = list(polynomial)
    for start in range(len(result) - 1):
        for power in range(len(result) - 2, start - 1, -1):
            result[power] += offset * result[power + 1]
    return tuple(result)
