"""What lives between two readings beside the banks, and the columns of the table that readings are turned into."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from textile_twin_core.shaft.settings import ShaftSettings

if TYPE_CHECKING:
    from typing import Any

    StatusArray: TypeAlias = npt.NDArray[Any]
else:
    StatusArray = np.ndarray

ORDERS = (0, 2, 6, 12)
"""Orders of ripple of the banks that stand side by side."""

STARTING, RUNNING, STANDSTILL = 0.0, 1.0, 2.0
MOTIONS = ("starting", "running", "standstill")

_FIELDS = (
    "unit", "received", "accepted", "not_finite", "duplicate", "older", "samples", "since", "time", "interval",
    "longest",
    "angle", "speed", "acceleration", "first", "origin", "period", "slips", "auto", "low", "high", "rounding", "jitter",
    "jitter_told", "speed_noise", "aside", "off_before", "off_last", "step_last", "motion", "sense", "still",
    "lead_bank",
    "judged", "outliers", "jumps", "gaps", "losses", "reversals", "standstills",
)  # fmt: skip
_BY_BANK = ("weight", "active", "travelled", "rest", "best", "top", "scale", "memory")
COUNTS = ("accepted", "gaps", "jumps", "outliers", "reversals", "standstills", "losses")
KEPT = (
    *COUNTS,
    "received",
    "not_finite",
    "duplicate",
    "older",
    "longest",
    "interval",
    "jitter",
    "jitter_told",
    "unit",
    "motion",
    "lead_bank",
    "speed",
)
"""Counts, and what outlasts the end of a motion."""
STATUS = np.dtype(
    [(name, np.float64) for name in _FIELDS]
    + [(name, np.float64, (len(ORDERS),)) for name in _BY_BANK]
    + [("moments", np.float64, (10,)), ("about", np.float64, (3,))]
)
"""All in samples, seconds and radians. `unit` is that of the stamps [s]; `period` what the angle wraps by, 0 when it
counts
its turns; `rounding` the encoder's step; `jitter` the variance of the stamps. Of each bank: its weight; 1 while it
works; angle
[rad] since it began; angle to turn until it wakes or, below 0, turned since it had weight; its best model, that one's
probability
and scale of the noise; mean logarithm of its memory."""

PHASE, SPEED, ACCELERATION, TURNS, SETTLED, COVARIANCE = range(6)
INDEX, READING, NOISE, UNIT, THETA, ORIGIN, TIME, STEP, CUT, LEAD, OFF, MEMORY = range(14, 26)
WIDTH = MEMORY + len(ORDERS)
"""Columns of a table with a row for each accepted sample. The state: angle beyond whole turns, speed, acceleration,
turns, settled, nine of covariance. Then what smoothing works on: running number of the input sample; unwrapped reading,
its variance (0: set aside), that before it was learnt how good readings are, angle found, whole turns before both; time
since the first sample and since the one before; 1 where a new stretch begins, 2 where the readings set aside before
were motion; leading bank; how far the reading was off; mean logarithm of each bank's memory."""


def new_status(settings: ShaftSettings, rounding: float) -> StatusArray:
    """The status (1,) of an estimator that has seen nothing; `rounding` is the encoder's step, 0 while unknown."""
    record = np.zeros(1, STATUS)
    record["period"] = 0.0 if settings.wrapping == "unwrapped" else settings.period_rad
    record["auto"] = settings.wrapping == "auto"
    record["rounding"] = rounding
    if settings.stamp_jitter_s is not None:
        record["jitter"], record["jitter_told"] = settings.stamp_jitter_s**2, 1.0
    return record
