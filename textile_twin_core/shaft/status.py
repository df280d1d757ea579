"""What the recursion keeps between two readings (status), and what it gives for each accepted one (row)."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from textile_twin_core.compiling import aligned_records
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.encoder import UNKNOWN_STEP_RAD
from textile_twin_core.shaft.settings import ShaftSettings

Records: TypeAlias = npt.NDArray[Any]
Record: TypeAlias = Any
Stamps: TypeAlias = npt.NDArray[Any]  # int64 nanoseconds or float64 seconds

STARTING, RUNNING, STANDSTILL = 0.0, 1.0, 2.0
MOTIONS = ("starting", "running", "standstill")

MANOEUVRE, STRETCH, TRACK = 1.0, 2.0, 3.0
"""Of a row: it and the readings rejected just before are a manoeuvre; the angle begins anew here; all does."""

COUNTS = ("accepted", "repeats", "gaps", "jumps", "outliers", "reversals", "standstills", "losses")
KEPT = (
    *COUNTS, "received", "not_finite", "duplicate_stamp", "older_stamp", "longest", "interval", "jitter", "jitter_told",
    "unit", "motion", "speed", "leading", "best", "waves", "ripple", "sensor_ripple", "guessed", "resolution",
)  # fmt: skip
"""Fields that outlast the end of a record."""

_NUMBERS = (
    "received", "not_finite", "duplicate_stamp", "older_stamp",  # samples received, and rejected by cause
    "unit", "samples", "used", "time",  # unit of the stamps [s]; since the begin: samples accepted, used; time [s]
    "interval", "longest", "move",  # mean interval of samples, longest one [s]; mean move of readings [rad]
    "bunched",  # samples in a row that came late, together
    "angle", "speed", "acceleration", "speed_sigma", "acceleration_sigma",  # estimate, standard deviations [rad, s]
    "sensor_speed", "fastest",  # speed by the sensor (NaN: none), full speed as far as known [rad/s]
    "motion", "sense", "still", "since",  # STARTING ..; +-1; samples at rest, and since the motion was initialised
    "lowest", "ripple_tried",  # lowest order of ripple; 1 once a family with ripple has entered the comparison
    "origin",  # whole turns of the first reading
    "period", "slips",  # angle at which readings wrap, 0 if they do not; what unwrapping adds [rad]
    "auto", "low", "high",  # 1 if wrapping is found from the readings, and their range [rad]
    "encoder_zero",  # angle at which the encoder reads 0 [rad]
    "edges", "resolution", "guessed",  # 1 for edges of teeth; encoder's step [rad], 1 if it is not known yet
    "lone",  # last move if it ended a rest, else 0 [rad]
    "correlated",  # readings that count as one, as their rounding errors are correlated
    "noise_of_late",  # measurement variance that the process noise is relative to [rad^2]
    "jitter", "jitter_told",  # variance of the stamps [s^2], 1 if it is a setting
    "additive", "noise_at_rest",  # variance of other noise [rad^2], of late and as seen at rest
    "kept", "kept_at", "moved", "bent",  # last reading not rejected, its time, first and second difference per interval
    "second_difference", "third_difference", "differences",  # the same of all readings; the third; how many there were
    "white", "speed_squared",  # decaying sums of the noise that bounds jitter [rad^2], and of the speed squared
    "read", "leapt", "leapt_after",  # last reading; last move beyond rounding, and the repetitions before it
    "held", "holding", "longest_hold",  # part of such moves after repetitions; repetitions in a row, and the most
    "rejected_run", "unconfirmed",  # readings rejected in a row; those that must fit until the state is settled
    "off_before", "off_last", "step_last",  # prediction errors of the last two rejected [rad], the last's step [s]
    "clean", "slip", "since_slip",  # readings since the last outlier; last slip of the encoder [rad], readings since
    "travel", "runaway",  # mean move from sample to sample [rad]; samples for which the speed was far beyond it
    "abrupt", "doubtful",  # above 0 where what left the gate was motion; 1 after such a reading until the next
    "basis_at", "basis_waves",  # angle and orders for which `basis` is evaluated
    "heard", "heard_since", "listened",  # leading family of late, `used` when it began to lead; weight of the averages
    "tail_heard", "tail_expected",  # of the power beyond the modelled orders that the highest of these foretell
    "high_orders",  # part of the time in which orders above USUAL_WAVES were heard
    "reading_variance", "sensor_power",  # mean, and of the sensor's errors in each order [rad^2], see `residual_orders`
)  # fmt: skip
_BY_FAMILY = (
    "density", "mode_probability",  # predictive density of the latest reading
    "active", "began", "began_at",  # 1 if active; speed and angle where it started
    "travelled",  # furthest angle from there: a shaft that goes to and fro shows no order of the turn
    "ample",  # angle turned [rad] with readings enough for more orders
    "rest", "pause",  # angle [rad] left to rest, or if negative turned since it was probable; cycles of its next rest
    "log_memory",  # mean logarithm of its memory
)  # fmt: skip
_BY_LANE = (
    "logarithm", "jerk_strength",  # log N; N^-3, root of the process noise intensity relative to other memories
    "scale", "scale_samples",  # factor on the measurement variance, and the innovations it is averaged over
    "recent_scale", "scale_before",  # the same of the latest alone; when the unit of variance was last rescaled
    "probability", "usage", "likelihood_ratio",  # within the family, its mean; ratio to the family since its peak
    "innovation", "prior_variance", "ripple_variance",  # variances of the predicted reading, in all and by ripple
    "ripple_reading", "likelihood", "noise_variance",  # ripple in the reading; measurement variance, robust
)  # fmt: skip
_WIDTH = lanes.WIDEST
_ARRAYS = {
    "clock": (9, lanes.COUNT),  # state and covariance factor of each lane, rows as in `lanes`
    "projected": (3, lanes.COUNT), "gain": (3, lanes.COUNT),  # L' h; gains
    "sensitivity": (3, _WIDTH, lanes.COUNT),  # of the state to the ripple coefficients, see `ripple`
    "regressor": (_WIDTH, lanes.COUNT),  # of the innovation on the coefficients
    "projected_ripple": (_WIDTH, lanes.COUNT),  # transposed factor of the coefficients times the regressor
    "ripple": (_WIDTH, lanes.COUNT), "factor": (_WIDTH, _WIDTH, lanes.COUNT),  # coefficients of g1; factor L'
    "parts": (2, lanes.COUNT), "clock_variance": (lanes.COUNT,),  # work space of `ripple`
    "ripple_change": (_WIDTH, lanes.COUNT),
    "second": (lanes.FAMILIES, 2 * _WIDTH),  # coefficients of g2, see `clock`
    "basis": (2 * _WIDTH,), "change": (_WIDTH,),  # cosines and sines; change of the coefficients
    "sensor_ripple": (lanes.FAMILIES, _WIDTH),  # part of g1 that is the sensor's, no motion, see `residual_orders`
    "doubt": (lanes.FAMILIES, 3),  # variance [rad^2] by orders in doubt, times their squares and fourth powers
    "shaft_second": (lanes.FAMILIES, 2 * _WIDTH),  # coefficients of g2 less that part
    "order_sums": (2 * _WIDTH,),  # Fourier coefficients of the residuals
    "ripple_jacobian": (3, _WIDTH), "slopes": (5,),  # work space
}  # fmt: skip
STATUS = np.dtype(
    [(name, np.float64, (lanes.COUNT,)) for name in _BY_LANE]
    + [(name, np.float64, shape) for name, shape in _ARRAYS.items()]
    + [(name, np.float64, (lanes.FAMILIES,)) for name in _BY_FAMILY]
    + [("leading", np.int64), ("best", np.int64, (lanes.FAMILIES,)), ("waves", np.int64, (lanes.FAMILIES,))]
    + [(name, np.float64) for name in (*COUNTS, *_NUMBERS)]
)
"""In seconds and radians; arrays by lane first, so that no vector of lanes lies on two lines of the processor's cache.
`leading` is the family of the most probable filter, `best` the most probable lane of each family, `waves` its orders of
ripple. Covariance factors and variances of lanes are in units of `scale`."""

STATE = np.dtype(
    [(name, np.float64) for name in ("phase", "speed", "acceleration", "turns", "settled", "index")]
    + [("covariance", np.float64, (9,))]
)
"""State at an accepted sample: angle beyond whole turns, speed, acceleration, whole turns, 1 if settled (-1: no state
yet), number of the input sample, covariance."""
_FOR_SMOOTHING = (
    "reading", "noise", "unit",  # unwrapped reading [rad]; its variance (0: rejected), and that without noise scale
    "angle", "origin",  # estimated angle [rad]; whole turns to add to both
    "correlated", "interval", "time", "step",  # as in the status; time since the first sample and the last one [s]
    "cut",  # MANOEUVRE .., or 0
    "leading", "clock", "residual",  # leading family; reading of the clock, and less the smoothed one [rad]
    "intensity",  # process noise intensity [rad^2/s^5]
)  # fmt: skip
ROW = np.dtype(
    STATE.descr
    + [(name, "<f8") for name in _FOR_SMOOTHING]
    + [("jerk", "<f8", (2,)), ("memory", "<f8", (lanes.FAMILIES,)), ("systematic", "<f8", (3,))]
)
"""State, and what smoothing needs; also `jerk`, see `process_noise`, each family's mean log memory, and variances that
no residual shows, see `residual_orders`."""


def new_status(settings: ShaftSettings, count: int = 1) -> Records:
    """So many times the status before the first sample."""
    record = aligned_records(STATUS, count)
    record["period"] = 0.0 if settings.wrapping == "unwrapped" else settings.period_rad
    record["auto"] = settings.wrapping == "auto"
    record["resolution"] = UNKNOWN_STEP_RAD if settings.step_rad is None else settings.step_rad
    record["guessed"] = settings.step_rad is None
    record["edges"], record["encoder_zero"] = settings.teeth > 0, settings.tooth_zero_rad
    record["lowest"] = 1.0 / settings.cycle_turns
    record["logarithm"], record["jerk_strength"] = np.log(lanes.MEMORIES), lanes.MEMORIES**-3.0
    if settings.stamp_jitter_s is not None:
        record["jitter"], record["jitter_told"] = settings.stamp_jitter_s**2, 1.0
    return record
