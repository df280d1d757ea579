"""What lives between two readings: counts and state of the recursion, and the bank of filters; and a row for each."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import records
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.settings import ShaftSettings

if TYPE_CHECKING:
    from typing import Any

    Records: TypeAlias = npt.NDArray[Any]
    Record: TypeAlias = Any
else:
    Records = Record = np.ndarray

STARTING, RUNNING, STANDSTILL = 0.0, 1.0, 2.0
MOTIONS = ("starting", "running", "standstill")

COUNTS = ("accepted", "repeats", "gaps", "jumps", "outliers", "reversals", "standstills", "losses")
_OF_SAMPLES = ("received", "not_finite", "duplicate", "older", "unit", "samples", "time", "interval", "longest")
"""Samples that came in, and those refused by cause; the stamps' unit [s]; samples since the estimator began; time [s]
since the first of them, usual one from each to the next, and the longest."""
_OF_MOTION = (
    "angle", "speed", "acceleration", "speed_sigma", "acceleration_sigma", "sensor_speed", "fastest", "motion", "sense",
    "still", "since", "lowest", "ripple_tried",
)  # fmt: skip
"""The state told and its sigmas, the speed that a sensor tells (NaN: none), full speed as far as it is known; what the
shaft does, its sense, samples at rest, samples since the motion was found; lowest order of ripple, 1 once it was looked
for."""
_OF_ANGLES = ("first", "origin", "period", "slips", "auto", "low", "high")
"""The first reading and its whole turns; what the angle wraps by, 0 where it counts its turns, and by how much it did;
whether that is for the readings to tell, which lay between these two."""
_OF_NOISE = (
    "edges", "resolution", "guessed", "correlated", "jitter", "jitter_told", "additive", "kept", "kept_at", "moved",
    "bent",
)  # fmt: skip
"""1 where readings are edges; the encoder's step, 1 until it is known, readings that count as one; variance of the
stamps, 1 where it was told; variance that neither of both accounts for, learnt from the last reading that was not set
aside, its time, what it had moved by in an interval and by how much more than the one before."""
_OF_REPEATS = ("read", "leapt", "leapt_after", "held", "holding", "longest_hold")
"""The last reading; the last leap, and the repetitions before it; part of the leaps that come after repetitions;
repetitions now, and at most of late."""
_OF_TROUBLE = ("rejected_run", "unconfirmed", "off_before", "off_last", "step_last", "motions", "clean")
"""Readings set aside in a row, and those that must fit until a state is settled again; by how much the last two were
off, and the time before the last; times that such were motion, and readings, since they were
outliers."""
KEPT = (
    *COUNTS, "received", "not_finite", "duplicate", "older", "longest", "interval", "jitter", "jitter_told", "unit",
    "motion", "speed", "leading", "best", "ripple", "guessed",
)  # fmt: skip
"""Counts, and what outlasts the end of a motion."""
_NUMBERS = (*_OF_SAMPLES, *_OF_MOTION, *_OF_ANGLES, *_OF_NOISE, *_OF_REPEATS, *_OF_TROUBLE)
_BY_FAMILY = ("mode_probability", "active", "travelled", "began", "rest", "pause", "log_memory")
"""Weight; 1 while it works; angle [rad] since it began, and the speed then; angle to turn until it wakes or, below 0,
turned since it had weight; cycles that it rests next; mean logarithm of its memory."""
_BY_LANE = (
    "logarithm", "jerk_strength", "scale", "scale_samples", "probability", "usage", "likelihood_ratio", "innovation",
    "prior_variance", "ripple_variance",
    "ripple_reading", "likelihood", "noise_variance",
)  # fmt: skip
"""Logarithm of the samples that the filter looks back, strength of its jerk; variance of the readings relative to what
is expected, and the innovations it was learnt from; probability, and its mean of late; likelihood ratio to the family
since it was best; what a reading told, see `kalman`."""
STATUS = np.dtype(
    [(name, np.float64) for name in (*COUNTS, *_NUMBERS, "basis_at", "basis_waves", "residual_variance")]
    + [("leading", np.int64), ("best", np.int64, (lanes.FAMILIES,))]
    + [(name, np.float64, (lanes.FAMILIES,)) for name in _BY_FAMILY]
    + [(name, np.float64, (lanes.COUNT,)) for name in _BY_LANE]
    + [
        ("clock", np.float64, (9, lanes.COUNT)),
        ("projected", np.float64, (3, lanes.COUNT)),
        ("gain", np.float64, (3, lanes.COUNT)),
        ("sensitivity", np.float64, (lanes.COUNT, 3, lanes.WIDEST)),
        ("regressor", np.float64, (lanes.COUNT, lanes.WIDEST)),
        ("projected_ripple", np.float64, (lanes.COUNT, lanes.WIDEST)),
        ("ripple", np.float64, (lanes.COUNT, lanes.WIDEST)),
        ("factor", np.float64, (lanes.COUNT, lanes.WIDEST, lanes.WIDEST)),
        ("second", np.float64, (lanes.FAMILIES, 2 * lanes.WIDEST)),
        ("basis", np.float64, (2 * lanes.WIDEST,)),
        ("change", np.float64, (lanes.WIDEST,)),
        ("order_sums", np.float64, (2 * lanes.WIDEST,)),
        ("part", np.float64, (2, lanes.WIDEST)),
        ("ripple_jacobian", np.float64, (3, lanes.WIDEST)),
        ("slopes", np.float64, (6,)),
        ("start", np.float64, (9,)),
        ("moments", np.float64, (4,)),
        ("products", np.float64, (6,)),
        ("covariance_part", np.float64, (6,)),
    ]
)
"""All in samples, seconds and radians. After the numbers above the leading family and the best lane of each. Of each
lane: state and factor of the clock, what a reading sees of the factor's columns, gains (see `kalman`); sensitivity
of the state to the coefficients of ripple; what an innovation feels of these and is shown of their factor's columns;
they and the factor (see `ripple`). Factors are in units of the root of the scale. Of each family the coefficients of g2
that follow from its best lane's ripple (see `clock`). Variance and orders of what is left of innovations of late (see
`unmodelled_orders`). The rest is room to work in."""

STATE = np.dtype(
    [(name, np.float64) for name in ("phase", "speed", "acceleration", "turns", "settled", "index")]
    + [("covariance", np.float64, (9,))]
)
"""Of each accepted sample: angle beyond whole turns, speed, acceleration, turns, settled (-1: too few samples for a
state), running number of the input sample, covariance."""
ROW = np.dtype(
    STATE.descr
    + [
        (name, "<f8")
        for name in (
            "reading",
            "noise",
            "unit",
            "theta",
            "origin",
            "correlated",
            "time",
            "step",
            "cut",
            "leading",
            "clock",
            "intensity",
        )
    ]
    + [("jerk", "<f8", (2,)), ("memory", "<f8", (lanes.FAMILIES,)), ("unmodelled", "<f8", (3,))]
)
"""And what smoothing works on: unwrapped reading; its variance (0: set aside), that before it was learnt how good
readings are; angle found; whole turns before both; time since the first sample and since the one before; 1 where a new
stretch begins, 2 where the readings set aside before were motion; leading family; reading of the clock; mean logarithm
of each family's memory; variances by orders that the state lacks."""


def new_status(settings: ShaftSettings, resolution: float) -> Records:
    """The status (1,) of an estimator that has seen nothing; `resolution` is the encoder's step, 0 while unknown."""
    record = records(STATUS)
    record["period"] = 0.0 if settings.wrapping == "unwrap_reading" else settings.period_rad
    record["auto"] = settings.wrapping == "auto"
    record["resolution"] = resolution
    record["guessed"] = settings.step_rad is None
    record["edges"] = settings.teeth > 0
    record["lowest"] = 1.0 / settings.cycle_turns
    record["logarithm"], record["jerk_strength"] = np.log(lanes.MEMORIES), lanes.MEMORIES**-3.0
    if settings.stamp_jitter_s is not None:
        record["jitter"], record["jitter_told"] = settings.stamp_jitter_s**2, 1.0
    return record


def ripple_amplitudes(record: Records) -> FloatArray:
    """Amplitude of the speed's ripple relative to the speed, by orders of the leading family; empty for a plain one."""
    now = record[0]
    waves = lanes.WAVES[int(now["leading"])]
    cosines, sines = now["ripple"][int(now["best"][int(now["leading"])]), : 2 * waves].reshape(-1, 2).T
    return np.asarray(np.hypot(cosines, sines) * now["lowest"] * np.arange(1, waves + 1))
