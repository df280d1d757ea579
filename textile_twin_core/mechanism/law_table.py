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
_LOOKS = 4097
_MOST_RINGING = 1.5
"""Of what the points span; six of a sine curve show seven eighths of its height at least."""


@dataclass(frozen=True)
class LiftTable:
    """A position [m, or rad of what swings] at rising angles of a shaft or cam [rad], over one turn."""

    angle_rad: tuple[float, ...]
    lift: tuple[float, ...]

    @cached_property
    def law(self) -> MotionLaw:
        """The spline through it (see from_table)."""
        return from_table(np.array(self.angle_rad), np.array(self.lift))


def from_table(theta_rad: FloatArray, position_m: FloatArray, name: str = "table") -> MotionLaw:
    """Law through a user's own points over one turn: periodic quintic spline, continuous up to the fourth derivative.

    The angles increase from the first to at most one turn later; a last point one turn after the first repeats it.
    Raises MachineError when they do not, when values are not finite, when fewer than six points are given, or too few
    for their bends, so that the spline swings far beyond them.
    """
    angles = np.asarray(theta_rad, dtype=float)
    positions = np.array(position_m, dtype=float)  # a copy, whose last value is set
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
    """Raises MachineError where the spline spans more than `_MOST_RINGING` of what its points do."""
    over_turn = spline(np.linspace(angles[0], angles[-1], _LOOKS))
    least, most = float(positions.min()), float(positions.max())
    rounding = 1e-12 * max(abs(least), abs(most))
    if np.ptp(over_turn) > _MOST_RINGING * (most - least) + rounding:
        raise MachineError(
            f"the motion table lies from {least:g} to {most:g}, but the smooth curve through it from "
            f"{over_turn.min():.3g} to {over_turn.max():.3g}: give more points where it bends"
        )


def from_function(function: Callable[[float], float], name: str = "function") -> MotionLaw:
    """Law fitted to a user's periodic function of the shaft angle, halved until off its knots it errs below 1e-12.

    The error is relative to the function's range; where the function has kinks the finest fit is used as it is.
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
    """The spline's pieces as sections over [0, 2 pi), the piece that contains 2 pi split in two."""
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
    """Coefficients of p(offset + t) in powers of t, by repeated synthetic division."""
    result = list(polynomial)
    for start in range(len(result) - 1):
        for power in range(len(result) - 2, start - 1, -1):
            result[power] += offset * result[power + 1]
    return tuple(result)
