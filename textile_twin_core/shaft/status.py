"""Data of the recursion: the status between two readings, in typed groups, and the result at each accepted reading.

Each group belongs to one stage, whose functions take the groups that they may touch. A class declares the fields of a
group, and `record_dtype` makes the numpy record of it that compiled loops read and write. Units are seconds and
radians; flags are 0 or 1.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias, get_type_hints

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import aligned_records
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.encoder import UNKNOWN_STEP_RAD
from textile_twin_core.shaft.settings import ShaftSettings

Records: TypeAlias = npt.NDArray[Any]
Stamps: TypeAlias = npt.NDArray[Any]  # int64 nanoseconds or float64 seconds

STARTING, RUNNING, STANDSTILL = 0.0, 1.0, 2.0
MOTIONS = ("starting", "running", "standstill")

OPEN, WRAPPED, UNWRAPPED = 0.0, 1.0, 2.0  # whether the angle is wrapped
WRAPPINGS = ("open", "wrapped", "unwrapped")

MANOEUVRE, STRETCH, TRACK = 1.0, 2.0, 3.0
"""Cuts of a row: end of a manoeuvre that began with the rejected readings before; restart of angle; of the track."""

_WIDTH = layout.WIDEST
_ByFilter: TypeAlias = Annotated[FloatArray, (layout.COUNT,)]
_StateByFilter: TypeAlias = Annotated[FloatArray, (3, layout.COUNT)]
_RippleByFilter: TypeAlias = Annotated[FloatArray, (_WIDTH, layout.COUNT)]
_ByModel: TypeAlias = Annotated[FloatArray, (layout.MODELS,)]
_IndexByModel: TypeAlias = Annotated[IntArray, (layout.MODELS,)]
_RippleByModel: TypeAlias = Annotated[FloatArray, (layout.MODELS, _WIDTH)]
_SecondByModel: TypeAlias = Annotated[FloatArray, (layout.MODELS, 2 * _WIDTH)]


class Filters:
    """Kalman filters of all models, the filter being the last index; covariance factors in units of `scale`."""

    logarithm: _ByFilter  # log N of the memory N
    jerk_strength: _ByFilter  # N^-3, root of the process noise intensity relative to other memories
    scale: _ByFilter  # factor on the measurement variance ..
    scale_samples: _ByFilter  # .. and the innovations it is averaged over
    recent_scale: _ByFilter  # the same of the latest innovations
    scale_before: _ByFilter  # the same when the unit of variance was last rescaled
    probability: _ByFilter  # within the model ..
    usage: _ByFilter  # .. and its mean
    likelihood_ratio: _ByFilter  # to the model since its peak
    innovation: _ByFilter
    prior_variance: _ByFilter  # of the predicted reading
    ripple_variance: _ByFilter  # part of it by ripple
    ripple_reading: _ByFilter  # ripple in the reading
    likelihood: _ByFilter
    noise_variance: _ByFilter  # measurement variance, robust
    clock: Annotated[FloatArray, (9, layout.COUNT)]  # state and covariance factor, rows as in `layout`
    projected: _StateByFilter  # L' h
    gain: _StateByFilter
    sensitivity: Annotated[FloatArray, (3, _WIDTH, layout.COUNT)]  # of the state to the ripple coefficients, `ripple`
    regressor: _RippleByFilter  # of the innovation on the coefficients
    projected_ripple: _RippleByFilter  # transposed factor of the coefficients times the regressor
    ripple: _RippleByFilter  # coefficients of g1
    factor: Annotated[FloatArray, (_WIDTH, _WIDTH, layout.COUNT)]  # their covariance factor L'
    parts: Annotated[FloatArray, (2, layout.COUNT)]  # work space of `ripple`
    clock_variance: _ByFilter  # the same
    ripple_change: _RippleByFilter  # the same


class Wave:
    """Ripple as a function of the angle: basis at one angle, and work space of `ripple`."""

    basis: Annotated[FloatArray, (2 * _WIDTH,)]  # cosines and sines
    change: Annotated[FloatArray, (_WIDTH,)]  # of the coefficients
    jacobian: Annotated[FloatArray, (3, _WIDTH)]
    slopes: Annotated[FloatArray, (5,)]
    lowest: float  # lowest order of ripple
    basis_at: float  # angle for which `basis` is evaluated
    basis_waves: float  # number of its orders


class Models:
    """Models of 0 to 24 orders of ripple that compete by likelihood."""

    second: _SecondByModel  # coefficients of g2, see `ripple`
    sensor_ripple: _RippleByModel  # part of g1 that is the sensor's, see `residual_orders`
    shaft_second: _SecondByModel  # coefficients of g2 less that part
    uncertain_power: Annotated[FloatArray, (layout.MODELS, 3)]  # variance by uncertain orders, times order^2, order^4
    density: _ByModel  # predictive density of the latest reading
    mode_probability: _ByModel
    active: _ByModel
    start_speed: _ByModel
    start_angle: _ByModel
    travelled: _ByModel  # furthest angle from there: a shaft that oscillates shows no order of the turn
    resolved_angle: _ByModel  # angle turned with readings enough for more orders
    idle: _ByModel  # remaining angle of its suspension; negative: turned since it was probable
    next_idle: _ByModel  # cycles of its next suspension
    log_memory: _ByModel  # mean logarithm of its memory
    leading: int  # model of the most probable filter
    best: _IndexByModel  # most probable filter of each model
    waves: _IndexByModel  # orders of ripple
    ripple_tried: float  # 1 once a model with ripple was compared


class Bank:
    """The model bank."""

    filters: Filters
    models: Models
    wave: Wave


class Orders:
    """Orders of the turn in the residuals, see `residual_orders`."""

    sums: Annotated[FloatArray, (2 * _WIDTH,)]  # Fourier coefficients of the residuals
    found: Annotated[FloatArray, (_WIDTH,)]  # squared amplitude of each order ..
    expected: Annotated[FloatArray, (_WIDTH,)]  # .. power of those beyond the model ..
    evidence: Annotated[FloatArray, (_WIDTH,)]  # .. and logarithm of that of an end of the ripple there
    averaged_model: float  # recent leading model ..
    averaged_since: float  # .. and `used` when it began to lead
    average_weight: float
    high_orders: float  # part of the time with orders above USUAL_WAVES
    reading_variance: float  # mean
    sensor_power: float  # of the sensor's errors in each order


class Counts:
    """Counts for the report, since the start or the last reset."""

    accepted: float
    repeats: float
    gaps: float
    jumps: float
    outliers: float
    reversals: float
    standstills: float
    losses: float
    received: float
    not_finite: float
    duplicate_stamp: float
    older_stamp: float


class Sampling:
    """Times of the samples of a record."""

    unit: float  # of the stamps [s]
    time: float  # since the first sample
    samples: float  # accepted since the start
    used: float  # of these, as measurements
    since: float  # samples since the initiation of the track
    interval: float  # mean
    longest: float  # interval
    bunched: float  # samples in a row that arrived late, together
    edges: float  # 1 for edges of teeth
    move: float  # mean move of readings per sample


class Unwrapping:
    """Turns of the readings."""

    origin: float  # whole turns of the first reading
    period: float  # of wrapped readings, 0 if unwrapped
    slips: float  # sum added to the readings
    last: float  # last reading, unwrapped
    auto: float  # 1 if the readings decide whether the angle is wrapped
    low: float  # range of the readings
    high: float
    wrapping: float  # OPEN, WRAPPED or UNWRAPPED
    encoder_zero: float  # angle at which the encoder reads 0


class Mixture:
    """The estimate: the mixture of all filters."""

    angle: float
    speed: float
    acceleration: float
    speed_sigma: float
    acceleration_sigma: float
    fastest: float  # highest speed so far
    sensor_speed: float  # speed by the sensor, NaN for none
    motion: float  # STARTING, RUNNING or STANDSTILL
    sense: float  # +-1
    still: float  # samples at standstill


class Differences:
    """The latest readings, and their differences per interval."""

    last_used: float  # last reading that was not rejected ..
    last_used_at: float  # .. and its time
    moved: float  # first difference of such readings
    bent: float  # second difference
    second: float  # second difference of all readings
    third: float
    count: float


class Noise:
    """Measurement noise, see `measurement_noise`."""

    resolution: float  # encoder's step
    guessed: float  # 1 while it is unknown
    lone_move: float  # last move if it ended a standstill, else 0
    correlated: float  # readings that count as one, as their rounding errors are correlated
    recent: float  # measurement variance that the process noise is relative to
    jitter: float  # variance of the stamps
    jitter_configured: float
    additive: float  # variance of other noise
    standstill: float  # the same at standstill
    white: float  # decaying sum of the noise that bounds the jitter ..
    speed_squared: float  # .. and of the speed squared


class Repeats:
    """Repetitions of a sensor that measures less often than it is read."""

    share: float  # part of large moves that follow repetitions
    run: float  # repetitions in a row
    longest: float  # their maximum
    large_move: float  # last move beyond rounding
    before_move: float  # repetitions before it


class Gate:
    """Outlier gate: rejected readings and what followed them."""

    rejected_run: float  # readings rejected in a row
    unconfirmed: float  # readings that must fit until the state has converged
    innovation_before: float  # of the last rejected reading but one
    last_innovation: float  # of the last one ..
    last_rejected_step: float  # .. and the step to it
    clean: float  # readings since the last outlier
    slip: float  # last slip of the encoder
    since_slip: float  # readings since
    travel: float  # mean move from sample to sample
    runaway: float  # samples for which the speed was far beyond it
    abrupt: float  # above 0 where recent innovations outside the gate were motion
    provisional: float  # 1 after a reading accepted at once, until the next one confirms it


class FilterStatus:
    """All that the recursion knows between two readings.

    The filters come first, so that no vector of filters spans two cache lines of the processor.
    """

    bank: Bank
    orders: Orders
    counts: Counts
    sampling: Sampling
    unwrapping: Unwrapping
    track: Mixture
    differences: Differences
    noise: Noise
    repeats: Repeats
    gate: Gate


class State:
    """State at an accepted sample."""

    phase: float  # angle beyond whole turns
    speed: float
    acceleration: float
    turns: float  # whole turns
    settled: float  # 1 if the estimate has converged; -1: no state yet
    index: float  # number of the input sample
    covariance: Annotated[FloatArray, (9,)]


class FilterRow(State):
    """State, and the data for smoothing."""

    reading: float  # unwrapped
    noise: float  # its variance; 0: rejected
    unit: float  # its variance without noise scale
    gate_noise: float  # variance by which a reading is an outlier, if larger
    angle: float  # estimated, relative to ..
    origin: float  # .. these whole turns
    correlated: float  # as in the status
    interval: float  # as in the status
    time: float  # since the first sample
    step: float  # since the last sample
    cut: float  # MANOEUVRE, STRETCH, TRACK, or 0
    leading: float  # leading model
    clock: float  # reading of the clock ..
    residual: float  # .. and the same less the smoothed one
    intensity: float  # of the process noise [rad^2/s^5]
    jerk: Annotated[FloatArray, (2,)]  # see `rts_smoother`
    memory: _ByModel  # each model's mean log memory
    systematic: Annotated[FloatArray, (3,)]  # variances that no residual shows, see `residual_orders`


def record_dtype(kind: type) -> np.dtype[Any]:
    """Return the dtype of a record with the fields that a class declares: float, int, arrays, and other groups."""
    fields: list[Any] = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if hint in (float, int):
            fields.append((name, np.dtype(hint)))
        elif hasattr(hint, "__metadata__"):
            fields.append((name, np.float64 if hint.__origin__ == FloatArray else np.int64, hint.__metadata__[0]))
        else:
            fields.append((name, record_dtype(hint)))
    return np.dtype(fields)


BANK, STATUS, STATE, ROW = (record_dtype(kind) for kind in (Bank, FilterStatus, State, FilterRow))
COUNTS = ("accepted", "repeats", "gaps", "jumps", "outliers", "reversals", "standstills", "losses")
_PERSISTENT = {
    "counts": record_dtype(Counts).names,
    "sampling": ("unit", "interval", "longest"),
    "unwrapping": ("wrapping",),
    "track": ("speed", "motion"),
    "noise": ("resolution", "guessed", "jitter", "jitter_configured"),
}
_PERSISTENT_IN_BANK = {"filters": ("ripple",), "models": ("leading", "best", "waves", "sensor_ripple")}


def new_bank(settings: ShaftSettings) -> Records:
    """Return a model bank (1,) before the first sample."""
    record = aligned_records(BANK)
    _begin_bank(record, settings)
    return record


def new_status(settings: ShaftSettings, count: int = 1) -> Records:
    """Return `count` copies of the status before the first sample."""
    record = aligned_records(STATUS, count)
    _begin_bank(record["bank"], settings)
    unwrapping, noise = record["unwrapping"], record["noise"]
    unwrapping["period"] = 0.0 if settings.wrapping == "unwrapped" else settings.period_rad
    unwrapping["auto"], unwrapping["encoder_zero"] = settings.wrapping == "auto", settings.tooth_zero_rad
    noise["resolution"] = UNKNOWN_STEP_RAD if settings.step_rad is None else settings.step_rad
    noise["guessed"], record["sampling"]["edges"] = settings.step_rad is None, settings.teeth > 0
    if settings.stamp_jitter_s is not None:
        noise["jitter"], noise["jitter_configured"] = settings.stamp_jitter_s**2, 1.0
    return record


def _begin_bank(bank: Records, settings: ShaftSettings) -> None:
    bank["wave"]["lowest"] = 1.0 / settings.cycle_turns
    bank["filters"]["logarithm"] = np.log(layout.MEMORIES)
    bank["filters"]["jerk_strength"] = layout.MEMORIES**-3.0


def status_of_next_record(status: Records, settings: ShaftSettings) -> Records:
    """Return the status at the end of a record with all reset but the report, the newest stamp's unit and the noise."""
    fresh = new_status(settings, len(status))
    for before, after, persistent in (
        (status, fresh, _PERSISTENT),
        (status["bank"], fresh["bank"], _PERSISTENT_IN_BANK),
    ):
        for group, names in persistent.items():
            for name in names or ():
                after[group][name] = before[group][name]
    return fresh
