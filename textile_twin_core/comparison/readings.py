"""What was logged, looked at before any model: in which unit the angle is, how often it comes, what is missing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.errors import RecordingError

FEWEST_TURNS = 1.0
"""Turns of the shaft without which nothing can be told of the settings."""
_KNOWN_TURNS = {"radians": TURN, "degrees": 360.0, "revolutions": 1.0, "gradians": 400.0}
_NEAR = 0.03


@dataclass(frozen=True)
class Readings:
    """One recording: angles (n,) as logged and torque (m,) as logged, each with its stamps in ns.

    velocities: (n,) speed as logged, None where there is none.
    """

    angle_stamps_ns: IntArray
    angle: FloatArray
    torque_stamps_ns: IntArray
    torque: FloatArray
    velocities: FloatArray | None = None

    def __post_init__(self) -> None:
        if np.count_nonzero(np.isfinite(self.angle)) < 16:
            raise RecordingError(f"only {np.count_nonzero(np.isfinite(self.angle))} shaft angles: record longer")
        if np.count_nonzero(np.isfinite(self.torque)) < 16:
            raise RecordingError(f"only {np.count_nonzero(np.isfinite(self.torque))} torque samples: record longer")


@dataclass(frozen=True)
class AngleUnit:
    """The unit in which an angle is logged: `turn` is what one turn of the encoder counts.

    wrapped: whether the angle begins anew each turn, which is how the unit was seen; else `turn` is assumed.
    """

    name: str
    turn: float
    wrapped: bool

    @property
    def to_radians(self) -> float:
        """Radians per unit."""
        return TURN / self.turn


def angle_unit(angle: FloatArray) -> AngleUnit:
    """The unit of logged angles (n,), from the size of the leaps with which a wrapped angle begins anew.

    An angle that never begins anew shows no unit; it counts as radians.
    """
    finite = angle[np.isfinite(angle)]
    step = np.diff(finite)
    span = float(np.ptp(finite))
    leap = np.abs(step) > 0.5 * span
    usual = float(np.median(step[~leap])) if (~leap).any() else 0.0
    # A wrapped angle leaps against its way, by a turn less the step it would have made.
    leaps = step[leap & (np.sign(step) != np.sign(usual))] if usual else step[leap]
    if leaps.size < 1 or span == 0.0 or leaps.size > 0.4 * step.size:
        return AngleUnit("radians", TURN, wrapped=False)
    turn = float(np.median(np.abs(leaps))) + abs(usual)
    # Between two samples the shaft may have gone further than usual, but no reading lies beyond a turn.
    for name, known in _KNOWN_TURNS.items():
        if abs(turn / known - 1.0) < _NEAR and span <= known * (1.0 + 1e-6):
            return AngleUnit(name, known, wrapped=True)
    if turn > 64.0 and bool(np.all(finite == np.rint(finite))):
        return AngleUnit("counts", _round_count(turn), wrapped=True)
    return AngleUnit("radians", TURN, wrapped=False)


def _round_count(turn: float) -> float:
    """The power of two, or the number of two digits and zeros, that is near a turn's counts."""
    power = 2.0 ** round(math.log2(turn))
    if abs(turn / power - 1.0) < _NEAR:
        return power
    digits = 10.0 ** (math.floor(math.log10(turn)) - 1)
    return round(turn / digits) * digits


def samples_per_turn(angle_stamps_ns: IntArray, speed_rad_s: float) -> float:
    """Angle samples in a turn of the shaft at a speed."""
    period = float(np.median(np.diff(angle_stamps_ns))) * 1e-9
    return TURN / (abs(speed_rad_s) * period) if period > 0.0 and speed_rad_s else math.inf
