"""Data of the recursion: the state kept between two readings (status), and the result at each accepted one (row)."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from textile_twin_core.compiling import aligned_records
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.encoder import UNKNOWN_STEP_RAD
from textile_twin_core.shaft.settings import ShaftSettings

Records: TypeAlias = npt.NDArray[Any]
Record: TypeAlias = Any
Stamps: TypeAlias = npt.NDArray[Any]  # int64 nanoseconds or float64 seconds

STARTING, RUNNING, STANDSTILL = 0.0, 1.0, 2.0
MOTIONS = ("starting", "running", "standstill")

OPEN, WRAPPED, UNWRAPPED = 0.0, 1.0, 2.0  # whether the angle is wrapped
WRAPPINGS = ("open", "wrapped", "unwrapped")

MANOEUVRE, STRETCH, TRACK = 1.0, 2.0, 3.0
"""Cuts of a row: end of a manoeuvre that began with the rejected readings before; restart of angle; of the track."""

COUNTS = ("accepted", "repeats", "gaps", "jumps", "outliers", "reversals", "standstills", "losses")
PERSISTENT = (
    *COUNTS, "received", "not_finite", "duplicate_stamp", "older_stamp", "longest", "interval", "jitter",
    "jitter_configured", "unit", "motion", "speed", "leading", "best", "waves", "ripple", "sensor_ripple", "guessed",
    "resolution", "wrapping",
)  # fmt: skip
"""Fields that persist beyond the end of a record."""

_NUMBERS = (
    "received", "not_finite", "duplicate_stamp", "older_stamp",  # samples received, and rejected by cause
    "unit", "samples", "used", "time",  # unit of the stamps [s]; since the start: samples accepted, used; time [s]
    "interval", "longest", "move",  # mean interval of samples, longest one [s]; mean move of readings [rad]
    "bunched",  # samples in a row that arrived late, together
    "angle", "speed", "acceleration", "speed_sigma", "acceleration_sigma",  # estimate, standard deviations [rad, s]
    "sensor_speed", "fastest",  # speed by the sensor (NaN: none), highest speed so far [rad/s]
    "motion", "sense", "still", "since",  # STARTING ..; +-1; samples at standstill, and since the initiation
    "lowest", "ripple_tried",  # lowest order of ripple; 1 once a model with ripple was compared
    "origin",  # whole turns of the first reading
    "period", "slips",  # period of wrapped readings, 0 if unwrapped; sum added by unwrapping [rad]
    "auto", "low", "high",  # 1 if wrapping is decided by the readings, and their range [rad]
    "wrapping",  # OPEN, WRAPPED or UNWRAPPED
    "encoder_zero",  # angle at which the encoder reads 0 [rad]
    "edges", "resolution", "guessed",  # 1 for edges of teeth; encoder's step [rad], 1 if unknown
    "lone_move",  # last move if it ended a standstill, else 0 [rad]
    "correlated",  # readings that count as one, as their rounding errors are correlated
    "recent_noise",  # measurement variance that the process noise is relative to [rad^2]
    "jitter", "jitter_configured",  # variance of the stamps [s^2], 1 if it is a setting
    "additive", "standstill_noise",  # variance of other noise [rad^2], recent and at standstill
    "last_used", "last_used_at",  # last reading that was not rejected, and its time
    "moved", "bent",  # first and second difference of such readings, per interval
    "second_difference", "third_difference", "differences",  # of all readings, per interval; number of them
    "white", "speed_squared",  # decaying sums of the noise that bounds jitter [rad^2], and of the speed squared
    "last_reading",
    "large_move", "large_move_repeats",  # last move beyond rounding [rad], and the repetitions before it
    "repeat_share",  # part of large moves that follow repetitions
    "repeat_run", "longest_repeat",  # repetitions in a row, and their maximum
    "rejected_run", "unconfirmed",  # readings rejected in a row; readings that must fit until the state has converged
    "innovation_before", "last_innovation",  # of the last two rejected readings [rad] ..
    "last_rejected_step",  # .. and the step to the last [s]
    "clean", "slip", "since_slip",  # readings since the last outlier; last slip of the encoder [rad], readings since
    "travel", "runaway",  # mean move from sample to sample [rad]; samples for which the speed was far beyond it
    "abrupt",  # above 0 where recent innovations outside the gate were motion
    "provisional",  # 1 after a reading accepted at once, until the next one confirms it
    "basis_at", "basis_waves",  # angle and orders for which `basis` is evaluated
    "averaged_model", "averaged_since",  # recent leading model, `used` when it began to lead
    "average_weight",  # of the order averages
    "tail_observed", "tail_expected",  # power beyond the modelled orders, observed and predicted by the highest ones
    "high_orders",  # part of the time with orders above USUAL_WAVES
    "reading_variance", "sensor_power",  # mean, and that of the sensor's errors in each order, see `residual_orders`
)  # fmt: skip
_BY_MODEL = (
    "density", "mode_probability",  # predictive density of the latest reading
    "active", "start_speed", "start_angle",  # 1 if active; speed and angle at its start
    "travelled",  # furthest angle from there: a shaft that oscillates shows no order of the turn
    "resolved_angle",  # angle turned [rad] with readings enough for more orders
    "idle",  # remaining angle of its suspension [rad]; negative: turned since it was probable
    "next_idle",  # cycles of its next suspension
    "log_memory",  # mean logarithm of its memory
)  # fmt: skip
_BY_FILTER = (
    "logarithm", "jerk_strength",  # log N; N^-3, root of the process noise intensity relative to other memories
    "scale", "scale_samples",  # factor on the measurement variance, and the innovations it is averaged over
    "recent_scale", "scale_before",  # the same of the latest alone; when the unit of variance was last rescaled
    "probability", "usage", "likelihood_ratio",  # within the model, its mean; ratio to the model since its peak
    "innovation", "prior_variance", "ripple_variance",  # variances of the predicted reading, in all and by ripple
    "ripple_reading", "likelihood", "noise_variance",  # ripple in the reading; measurement variance, robust
)  # fmt: skip
_WIDTH = layout.WIDEST
_ARRAYS = {
    "clock": (9, layout.COUNT),  # state and covariance factor of each filter, rows as in `layout`
    "projected": (3, layout.COUNT), "gain": (3, layout.COUNT),  # L' h; gains
    "sensitivity": (3, _WIDTH, layout.COUNT),  # of the state to the ripple coefficients, see `ripple`
    "regressor": (_WIDTH, layout.COUNT),  # of the innovation on the coefficients
    "projected_ripple": (_WIDTH, layout.COUNT),  # transposed factor of the coefficients times the regressor
    "ripple": (_WIDTH, layout.COUNT), "factor": (_WIDTH, _WIDTH, layout.COUNT),  # coefficients of g1; factor L'
    "parts": (2, layout.COUNT), "clock_variance": (layout.COUNT,),  # work space of `ripple`
    "ripple_change": (_WIDTH, layout.COUNT),
    "second": (layout.MODELS, 2 * _WIDTH),  # coefficients of g2, see `clock`
    "basis": (2 * _WIDTH,), "change": (_WIDTH,),  # cosines and sines; change of the coefficients
    "sensor_ripple": (layout.MODELS, _WIDTH),  # part of g1 that is the sensor's, see `residual_orders`
    "uncertain_power": (layout.MODELS, 3),  # variance [rad^2] by uncertain orders, times order^2, order^4
    "shaft_second": (layout.MODELS, 2 * _WIDTH),  # coefficients of g2 less that part
    "order_sums": (2 * _WIDTH,),  # Fourier coefficients of the residuals
    "ripple_jacobian": (3, _WIDTH), "slopes": (5,),  # work space
}  # fmt: skip
STATUS = np.dtype(
    [(name, np.float64, (layout.COUNT,)) for name in _BY_FILTER]
    + [(name, np.float64, shape) for name, shape in _ARRAYS.items()]
    + [(name, np.float64, (layout.MODELS,)) for name in _BY_MODEL]
    + [("leading", np.int64), ("best", np.int64, (layout.MODELS,)), ("waves", np.int64, (layout.MODELS,))]
    + [(name, np.float64) for name in (*COUNTS, *_NUMBERS)]
)
"""In seconds and radians; arrays by filter first, so that no vector of filters spans two cache lines of the processor.
`leading` is the model of the most probable filter, `best` the most probable filter of each model, `waves` its orders of
ripple. Covariance factors and variances of filters are in units of `scale`."""

STATE = np.dtype(
    [(name, np.float64) for name in ("phase", "speed", "acceleration", "turns", "settled", "index")]
    + [("covariance", np.float64, (9,))]
)
"""State at an accepted sample: angle beyond whole turns, speed, acceleration, whole turns, 1 if settled (-1: no state
yet), number of the input sample, covariance."""
_FOR_SMOOTHING = (
    "reading", "noise", "unit",  # unwrapped reading [rad]; its variance (0: rejected), and that without noise scale
    "gate_noise",  # variance by which a reading is an outlier, if larger
    "angle", "origin",  # estimated angle [rad]; whole turns to add to both
    "correlated", "interval", "time", "step",  # as in the status; time since the first sample and the last one [s]
    "cut",  # MANOEUVRE .., or 0
    "leading", "clock", "residual",  # leading model; reading of the clock, and the same less the smoothed one [rad]
    "intensity",  # process noise intensity [rad^2/s^5]
)  # fmt: skip
ROW = np.dtype(
    STATE.descr
    + [(name, "<f8") for name in _FOR_SMOOTHING]
    + [("jerk", "<f8", (2,)), ("memory", "<f8", (layout.MODELS,)), ("systematic", "<f8", (3,))]
)
"""State, and the data for smoothing; also `jerk`, see `process_noise`, each model's mean log memory, and the variances
that no residual shows, see `residual_orders`."""


def new_status(settings: ShaftSettings, count: int = 1) -> Records:
    """Return `count` copies of the status before the first sample."""
    record = aligned_records(STATUS, count)
    record["period"] = 0.0 if settings.wrapping == "unwrapped" else settings.period_rad
    record["auto"] = settings.wrapping == "auto"
    record["resolution"] = UNKNOWN_STEP_RAD if settings.step_rad is None else settings.step_rad
    record["guessed"] = settings.step_rad is None
    record["edges"], record["encoder_zero"] = settings.teeth > 0, settings.tooth_zero_rad
    record["lowest"] = 1.0 / settings.cycle_turns
    record["logarithm"], record["jerk_strength"] = np.log(layout.MEMORIES), layout.MEMORIES**-3.0
    if settings.stamp_jitter_s is not None:
        record["jitter"], record["jitter_configured"] = settings.stamp_jitter_s**2, 1.0
    return record
