"""Logged readings before any model: unit of the angle, samples per turn, gaps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.stamp_timing import StampTiming
from textile_twin_core.errors import RecordingError

FEWEST_TURNS = 1.0
"""Fewest turns of the shaft that determine any setting."""
FEWEST_TORQUES_PER_TURN = 12
"""Fewest torques in a turn that the monitor watches."""
_FEWEST = 16
"""Fewest samples for a comparison."""
ANGLE_TURNS = {"rad": TURN, "deg": 360.0, "rev": 1.0, "gon": 400.0}
"""Size of a turn in each unit of an angle."""
_NAMES = {"rad": "radians", "deg": "degrees", "rev": "revolutions", "gon": "gradians"}
_NEAR = 0.03
_MANY, _COUNTS = 5, 2.0
"""Fewest turns that show all counts of an encoder, and the largest error of its steps and wraps in counts."""
_OFTEN = 2
"""Fewest wraps that show a unit: a single one may be a reset of the encoder."""
_MOST, _ALIKE = 0.7, 0.1
"""Share of the wraps that must lie near their median, and the largest relative distance from it."""


@dataclass(frozen=True)
class SecondAngle:
    """Angles (n,) of the second encoder of an elastic shaft as logged [rad], with their stamps in ns."""

    stamps_ns: IntArray
    angle: FloatArray


@dataclass(frozen=True)
class Readings:
    """One recording: angles and torque as logged, each with its stamps.

    Attributes:
        angle_stamps_ns: (n,) stamps of the angles [ns].
        angle: (n,) angles, in the unit of the log.
        torque_stamps_ns: (m,) stamps of the torque [ns], on the same clock.
        torque: (m,) torque, in the unit of the log.
        velocities: (n,) speed as logged, None where there is none.
        stamped: topics with stamps in bursts, whose times are reconstructed.
        second: of the encoder at `second_encoder_at` of an elastic shaft; None without one.
        as_rigid: the torque is that of a rigid shaft, although the machine's is elastic (see `without_elasticity`).

    Examples:
        >>> import numpy as np
        >>> from textile_twin_core.comparison import Readings
        >>> stamps = np.arange(1000) * 2_000_000  # [ns]
        >>> Readings(stamps, 0.03 * np.arange(1000.0), stamps, np.zeros(1000)).angle.size
        1000
    """

    angle_stamps_ns: IntArray
    angle: FloatArray
    torque_stamps_ns: IntArray
    torque: FloatArray
    velocities: FloatArray | None = None
    stamped: tuple[StampTiming, ...] = ()
    second: SecondAngle | None = None
    as_rigid: bool = False

    def __post_init__(self) -> None:
        for values, what in ((self.angle, "shaft angles"), (self.torque, "torque samples")):
            finite = np.count_nonzero(np.isfinite(values))
            if values.size >= _FEWEST > finite:
                share = f"only {finite} finite" if finite else "none finite"
                raise RecordingError(
                    f"{values.size} {what}, {share}: is the sensor connected, and does its driver read it?"
                )
            if finite < _FEWEST:
                raise RecordingError(f"only {finite} {what}: record longer")


@dataclass(frozen=True)
class AngleUnit:
    """Unit of a logged angle: `turn` is the size of one turn of the encoder.

    wrapped: true if the angle wraps each turn, which shows the unit; otherwise `turn` is assumed.
    times: number of wraps.
    """

    name: str
    turn: float
    wrapped: bool
    times: int = 0

    @property
    def to_radians(self) -> float:
        """Radians per unit."""
        return TURN / self.turn

    @property
    def option(self) -> str:
        """The unit as a value of `--angle-unit`: deg, rev, gon, or the counts of a turn."""
        return next((short for short, name in _NAMES.items() if name == self.name), shown_turn(self.turn))

    @property
    def is_other(self) -> bool:
        """True if the angle is not in radians, as more than one wrap shows."""
        return self.name != "radians" and self.times >= _OFTEN

    @property
    def instead(self) -> str:
        """Description of the angle's apparent unit where radians are expected."""
        return f"the angle wraps at {shown_turn(self.turn)} and looks like {self.name}, not radians"


def other_unit(angle: FloatArray) -> AngleUnit | None:
    """Return the unit of angles (n,) configured as radians that wrap, more than once, at a turn of another unit.

    None if they are radians or show no unit.
    """
    seen = angle_unit(angle)
    return seen if seen.is_other else None


def shown_turn(turn: float) -> str:
    """Format the size of a turn for display: whole counts with every digit."""
    return f"{turn:.0f}" if turn == round(turn) else f"{turn:g}"


def radians_of(unit: str) -> float:
    """Radians in a unit: rad, deg, rev, gon, or the counts of a turn as a number. Raises ValueError."""
    turn = ANGLE_TURNS.get(unit) or float(unit)
    if not 0.0 < turn < math.inf:
        raise ValueError(unit)
    return TURN / turn


def angle_unit(angle: FloatArray) -> AngleUnit:
    """Return the unit of logged angles (n,), from the size of the steps at which a wrapped angle wraps.

    An angle that never wraps shows no unit; it counts as radians.
    """
    finite = angle[np.isfinite(angle)]
    span = float(np.ptp(finite)) if finite.size else 0.0
    turns = _turns_leapt(finite, span)
    unseen = AngleUnit("radians", TURN, wrapped=False)
    if not turns.size:
        return unseen
    turn = float(np.median(turns))
    if np.mean(np.abs(turns / turn - 1.0) < _ALIKE) < _MOST:
        return unseen
    # Between two samples the shaft may turn further than usual, but no reading exceeds a turn.
    for short, known in ANGLE_TURNS.items():
        if abs(turn / known - 1.0) < _NEAR and span <= known * (1.0 + 1e-6) and not _whole_turns(turn, known):
            return AngleUnit(_NAMES[short], known, True, turns.size)
    if turn > 64.0 and bool(np.all(finite == np.rint(finite))):
        counts = _count_of_a_turn(turn, finite, turns.size)
        return AngleUnit("counts", counts, True, turns.size) if span <= counts * (1.0 + _NEAR) else unseen
    return unseen


def _turns_leapt(angle: FloatArray, span: float) -> FloatArray:
    """Size of a turn by each wrap of the angles (n,); empty without wraps."""
    step = np.diff(angle)
    wrap = np.abs(step) > 0.5 * span
    usual = float(np.median(step[~wrap])) if (~wrap).any() else 0.0
    # At a wrap the angle steps against its direction, by a turn less its usual step, taken from the step before.
    against = wrap & (np.sign(step) != np.sign(usual)) if usual else wrap
    at = np.flatnonzero(against)
    if span == 0.0 or at.size > 0.4 * step.size:
        return step[:0]
    before = step[np.maximum(at - 1, 0)]
    before[wrap[np.maximum(at - 1, 0)]] = usual
    return np.asarray(np.abs(step[at]) + np.abs(before))


def _whole_turns(turn: float, known: float) -> bool:
    """Return true if a wrap is of several turns in radians, as of a multi-turn encoder, and of no other unit."""
    whole = TURN * round(turn / TURN)
    return known > 2.0 * TURN and abs(turn - whole) < abs(turn - known)


def _count_of_a_turn(turn: float, readings: FloatArray, times: int) -> float:
    """Return the counts of a turn, near `turn`, of whole readings (n,) that wrap a number of times.

    Readings that show each count over many turns give it directly. Otherwise it is the nearest power of two, thousand
    times a power of two, or number of two digits and zeros. No reading exceeds a turn, except one rounded up.
    """
    seen = float(np.ptp(readings)) + 1.0
    power = 2.0 ** round(math.log2(turn))
    digits = 10.0 ** (math.floor(math.log10(turn)) - 1)
    usual, tens = (power, power * 1000.0 / 1024.0), round(turn / digits) * digits
    by_count = times >= _MANY and float(np.median(np.abs(np.diff(readings)))) <= _COUNTS
    if by_count and abs(turn - seen) <= _COUNTS:
        known = min(usual, key=lambda each: abs(seen - each))
        return next((each for each in (known, tens) if -1.0 <= each - seen <= _COUNTS), seen)
    near = [each for each in usual if abs(turn / each - 1.0) < _NEAR and each >= seen - 1.0]
    return min(near, key=lambda each: abs(turn - each)) if near else tens


def samples_per_turn(angle_stamps_ns: IntArray, speed_rad_s: float) -> float:
    """Number of angle samples in a turn of the shaft at a speed."""
    period = float(np.median(np.diff(angle_stamps_ns))) * 1e-9
    return TURN / (abs(speed_rad_s) * period) if period > 0.0 and speed_rad_s else math.inf
