"""What lives between two readings: counts and state of the recursion, and the bank of filters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import records
from textile_twin_core.shaft.settings import ShaftSettings

if TYPE_CHECKING:
    from typing import Any

    StatusArray: TypeAlias = npt.NDArray[Any]
    Record: TypeAlias = Any
else:
    StatusArray = Record = np.ndarray

WAVES: Final = (0, 2, 6, 12)
"""Orders of ripple of the families of filters that stand side by side."""
FAMILIES: Final = len(WAVES)
WIDEST: Final = 2 * WAVES[-1]
FIRST: Final = (0, 16, 32, 40)
END: Final = (16, 32, 40, 44)
LANES: Final = END[-1]
"""Each family's filters, in lanes side by side."""
_MEMORIES = np.concatenate(
    [0.5 * 2.0 ** np.arange(16.0), 0.5 * 2.0 ** np.arange(16.0), 4.0 ** np.arange(8.0), 4.0 * 8.0 ** np.arange(4.0)]
)
"""In samples, up to longer than any record is steady. Twice too long or too short costs little: the error of the speed
goes with the root of the memory; where there are many coefficients, fewer filters must do."""

STARTING, RUNNING, STANDSTILL = 0.0, 1.0, 2.0
MOTIONS = ("starting", "running", "standstill")

_FIELDS = (
    "unit", "received", "accepted", "not_finite", "duplicate", "older", "samples", "since", "time", "interval",
    "longest", "angle", "speed", "acceleration", "first", "origin", "period", "slips", "auto", "low", "high",
    "rounding", "jitter", "jitter_told", "speed_noise", "aside", "off_before", "off_last", "step_last", "motion",
    "sense", "still", "judged", "outliers", "jumps", "gaps", "losses", "reversals", "standstills", "lowest", "basis_at",
    "basis_waves", "sharp", "read",
)  # fmt: skip
COUNTS = ("accepted", "gaps", "jumps", "outliers", "reversals", "standstills", "losses")
KEPT = (
    *COUNTS, "received", "not_finite", "duplicate", "older", "longest", "interval", "jitter", "jitter_told", "unit",
    "motion", "speed", "lead", "best", "ripple",
)  # fmt: skip
"""Counts, and what outlasts the end of a motion."""
_BY_FAMILY = ("weight", "active", "travelled", "rest", "log_memory")
_BY_LANE = (
    "memory", "logarithm", "weakness", "scale", "learnt", "probability", "standing", "clock_acceleration", "clock_rate",
    "clock_angle",
    "l00", "l10", "l20", "l11", "l21", "l22", "seen0", "seen1", "seen2", "gain0", "gain1", "gain2", "innovation",
    "spread", "common", "told", "none", "likelihood", "own_noise",
)  # fmt: skip
STATUS = np.dtype(
    [(name, np.float64) for name in _FIELDS]
    + [("lead", np.int64), ("best", np.int64, (FAMILIES,))]
    + [(name, np.float64, (FAMILIES,)) for name in _BY_FAMILY]
    + [(name, np.float64, (LANES,)) for name in _BY_LANE]
    + [
        ("sensitivity", np.float64, (LANES, 3, WIDEST)),
        ("felt", np.float64, (LANES, WIDEST)),
        ("ripple", np.float64, (LANES, WIDEST)),
        ("factor", np.float64, (LANES, WIDEST, WIDEST)),
        ("second", np.float64, (FAMILIES, 2 * WIDEST)),
        ("basis", np.float64, (2 * WIDEST,)),
        ("regressor", np.float64, (WIDEST,)),
        ("change", np.float64, (WIDEST,)),
        ("owed", np.float64, (3, WIDEST)),
        ("slopes", np.float64, (6,)),
        ("kinematic", np.float64, (6,)),
        ("moments", np.float64, (10,)),
        ("common_part", np.float64, (6,)),
    ]
)
"""All in samples, seconds and radians. `unit` is that of the stamps [s]; `period` what the angle wraps by, 0 when it
counts its turns; `rounding` the encoder's step; `jitter` the variance of the stamps; `lowest` order of the ripple.

Of each family: its weight; 1 while it works; angle [rad] since it began; angle to turn until it wakes or, below 0,
turned since it had weight; mean logarithm of its memory; its best lane, and the coefficients of g2 that follow from
that one's ripple (see `clock`).

Of each lane: samples that the filter looks back, the inverse of its bandwidth; variance of the readings relative to
what is expected, and the innovations it was learnt from; probability; likelihood ratio to the family since it was best;
state and factor of the clock (see `kinematics`), and its sensitivity to the coefficients of ripple; those and their
factor (see `ripple`). Factors are in units of the root of the scale. The rest is room to work in."""

PHASE, SPEED, ACCELERATION, TURNS, SETTLED, COVARIANCE = range(6)
INDEX, READING, NOISE, UNIT, THETA, ORIGIN, TIME, STEP, CUT, LEAD, CLOCK, MEMORY = range(14, 26)
WIDTH = MEMORY + FAMILIES
"""Columns of a table with a row for each accepted sample. The state: angle beyond whole turns, speed, acceleration,
turns, settled, nine of covariance. Then what smoothing works on: running number of the input sample; unwrapped reading,
its variance (0: set aside), that before it was learnt how good readings are, angle found, whole turns before both; time
since the first sample and since the one before; 1 where a new stretch begins, 2 where the readings set aside before
were motion; leading family; reading of the clock; mean logarithm of each family's
memory."""


def new_status(settings: ShaftSettings, rounding: float) -> StatusArray:
    """The status (1,) of an estimator that has seen nothing; `rounding` is the encoder's step, 0 while unknown."""
    record = records(STATUS)
    record["period"] = 0.0 if settings.wrapping == "unwrapped" else settings.period_rad
    record["auto"] = settings.wrapping == "auto"
    record["rounding"] = rounding
    record["lowest"] = 1.0 / settings.cycle_turns
    record["memory"], record["logarithm"], record["weakness"] = _MEMORIES, np.log(_MEMORIES), _MEMORIES**-3.0
    if settings.stamp_jitter_s is not None:
        record["jitter"], record["jitter_told"] = settings.stamp_jitter_s**2, 1.0
    return record


def ripple_amplitudes(record: StatusArray) -> FloatArray:
    """Amplitude of the speed's ripple relative to the speed, by orders of the leading family; empty for a plain one."""
    now = record[0]
    waves = WAVES[int(now["lead"])]
    cosines, sines = now["ripple"][int(now["best"][int(now["lead"])]), : 2 * waves].reshape(-1, 2).T
    return np.asarray(np.hypot(cosines, sines) * now["lowest"] * np.arange(1, waves + 1))
