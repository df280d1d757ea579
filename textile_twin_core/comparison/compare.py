"""Comparison of measured with predicted torque: arrays in, one immutable result out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.alignment import Track, build_track, fast_speed, time_ranges
from textile_twin_core.comparison.by_angle import bin_by_angle, by_revolution
from textile_twin_core.comparison.by_order import by_order, by_speed
from textile_twin_core.comparison.delay import GUARD_S, SensorFit, fit_sensor, line, usable
from textile_twin_core.comparison.expected_reading import reading_track
from textile_twin_core.comparison.inputs import usable_measurements, usable_predictions
from textile_twin_core.comparison.result import Comparison, ComparisonEvent, SampleCount
from textile_twin_core.comparison.statistics import error_statistics
from textile_twin_core.errors import AlignmentError
from textile_twin_core.machine import Event, TorqueFilter, TorqueSensor

_LEAST_SAMPLES = 16
_SAME_DELAY = 3.0
"""Standard deviations within which an estimated delay equals the configured one."""
_LEAST_TURNS = 1.0  # of the shaft, below which no delay is estimated
_SEARCH_S = 0.1
_ANGLE_BINS = 120
_MOST_SETTLING = 0.5
"""Largest share of the record in which the sensor's filter settles."""
_TURNING_SHARE = 0.1  # of the fast end of the recorded speeds


def compare_torque(
    measured_stamps_ns: IntArray,
    measured_Nm: FloatArray,
    predicted_stamps_ns: IntArray,
    predicted_Nm: FloatArray,
    theta_rad: FloatArray,
    *,
    torque_sensor: TorqueSensor | None = None,
    events: Sequence[Event] = (),
    settled: BoolArray | None = None,
    predicted_sigma_Nm: FloatArray | None = None,
    rejected: Mapping[str, int] | None = None,
) -> Comparison:
    """Compare measured torque with predicted torque.

    The prediction at `stamp - delay` is interpolated by cubics that end at the events of the turn (see `Track`), and
    passes the filter of the sensor. Measured samples are left out and counted in a gap of the predictions, while the
    filter settles, and within half a millisecond of a discontinuity of the reading, such as the needle's entry into
    the backing behind no low pass, since their stamps do not show on which side of it they lie. So no residual is an
    artefact of interpolation.

    Args:
        measured_stamps_ns: (m,) stamps of the measured torque, int64 ns.
        measured_Nm: (m,) measured torque [N m]; nan and infinite samples are rejected and counted.
        predicted_stamps_ns: (n,) stamps of the predictions, int64 ns, on the same clock.
        predicted_Nm: (n,) predicted balancing torque [N m], without the sensor's filter, gain and offset.
        theta_rad: (n,) unwrapped shaft angle at the predicted stamps [rad].
        torque_sensor: the sensor as configured; without one gain 1, offset 0, delay 0.
        events: events of the turn, in angle of theta_rad.
        settled: (n,) true where the shaft estimator had converged; by default everywhere.
        predicted_sigma_Nm: (n,) standard deviation of the predictions [N m], for the views.
        rejected: samples that were rejected before prediction, by cause; they join the count.

    Raises:
        AlignmentError: shapes differ, stamps are no integers, too few samples, or no overlap in time.

    Returns:
        The comparison, without a verdict.

    Examples:
        >>> import numpy as np
        >>> from textile_twin_core.comparison import compare_torque
        >>> stamps = np.arange(5000) * 2_000_000  # [ns]
        >>> theta = 16.76 * stamps * 1e-9  # [rad]
        >>> found = compare_torque(stamps, np.sin(theta) + 0.1, stamps, np.sin(theta), theta)  # [N m]
        >>> round(found.errors.bias_Nm, 3)  # [N m]
        0.1
    """
    predictions = usable_predictions(predicted_stamps_ns, predicted_Nm, theta_rad, predicted_sigma_Nm, settled)
    measured_ns, measured, causes = usable_measurements(measured_stamps_ns, measured_Nm)
    if measured_ns.size == 0 or predictions.stamps_ns.size < 2:
        raise AlignmentError(
            f"too little torque to compare: {measured_ns.size} of {np.size(measured_Nm)} measured samples "
            f"and {predictions.stamps_ns.size} of {np.size(predicted_Nm)} predictions are finite with "
            "increasing stamps"
        )
    sensor = TorqueSensor() if torque_sensor is None else torque_sensor
    gain, offset, configured = float(sensor.gain), float(sensor.offset_Nm), float(sensor.delay_s)
    ranges = time_ranges(measured_ns, predictions.stamps_ns)

    # Seconds from the first prediction: subtracted as int64, so that 1e-9 s survives a clock of 1.7e18 ns.
    origin = int(predictions.stamps_ns[0])
    time: FloatArray = np.asarray((measured_ns - origin) * 1e-9, dtype=np.float64)
    predicted_time: FloatArray = np.asarray((predictions.stamps_ns - origin) * 1e-9, dtype=np.float64)
    track, jumps = build_track(
        predicted_time, predictions.torque_Nm, predictions.theta_rad, [e.angle_rad for e in events]
    )
    # A high pass below the turns of the shaft starts near its mean, so a short record need not wait for it.
    most_settling_s = _MOST_SETTLING * float(track.edge_s[-1] - track.edge_s[0])
    track, filter_settled = reading_track(track, TorqueFilter.of(sensor), most_settling_s)
    reading = sensor.reading(track.torque_at(predicted_time, track.piece(predicted_time)[0])[0])
    del predicted_time  # here and below: free the large arrays of a long record before the next are made
    piece, inside = track.piece(time - configured)
    if not inside.any():
        raise AlignmentError(
            f"measured and predicted torque do not overlap in time: {ranges}; both must be stamped by the same clock"
        )
    # The estimator counts as converged at a sample if it is at the predictions on both sides.
    ready = (predictions.settled[:-1] & predictions.settled[1:])[track.after_sample] & filter_settled
    calm = inside & ready[piece]
    fit = SensorFit(configured, float("nan"), gain, offset, identifiable=False, at_limit=False, sought=False)
    turns = float(np.ptp(track.theta_rad)) / (2.0 * np.pi)
    if np.count_nonzero(calm) >= _LEAST_SAMPLES and turns >= _LEAST_TURNS:
        fit = fit_sensor(track, time[calm], measured[calm], configured, _search_s(track))
        fit = _never_worse(fit, track, (time[calm], measured[calm]), (configured, gain, offset))
    del piece, inside, calm

    used, not_used = _select(track, time - fit.delay_s, ready)
    causes.update(not_used)
    if np.count_nonzero(used) < _LEAST_SAMPLES:
        why = ", ".join(f"{number} {cause}" for cause, number in causes.items() if number)
        raise AlignmentError(
            f"only {np.count_nonzero(used)} of {measured.size} measured torque samples can be compared"
            f"{f' (rejected: {why})' if why else ''}: {ranges}"
        )
    expected, angle = _expected(track, time - fit.delay_s, sensor)
    expected[~used] = np.nan
    residual = measured - expected
    used_configured, _ = _select(track, time - configured, ready)
    if np.count_nonzero(used_configured) < _LEAST_SAMPLES:
        used_configured = used
    configured_Nm, _ = _expected(track, time - configured, sensor)
    errors_configured = error_statistics(measured[used_configured], configured_Nm[used_configured])
    del used_configured, configured_Nm
    seen, wanted = measured[used], expected[used]
    errors = error_statistics(seen, wanted)
    fitted = fit.gain * (wanted - offset) / gain + fit.offset_Nm if np.isfinite(fit.gain) else wanted
    errors_fitted = error_statistics(seen, fitted)
    del seen, wanted, fitted
    turned, turning = angle[used], _turning(track, time - fit.delay_s)

    causes["prediction_not_usable"] = predictions.dropped
    causes.update({f"angle_{cause}": int(number) for cause, number in (rejected or {}).items()})
    causes = {cause: number for cause, number in causes.items() if number}
    return Comparison(
        stamps_ns=measured_ns,
        measured_Nm=measured,
        expected_Nm=expected,
        residual_Nm=residual,
        theta_rad=angle,
        used=used,
        predicted_stamps_ns=predictions.stamps_ns,
        predicted_Nm=predictions.torque_Nm,
        predicted_reading_Nm=reading,
        predicted_theta_rad=predictions.theta_rad,
        predicted_sigma_Nm=predictions.sigma_Nm,
        sensor_delay_s=configured,
        sensor_gain=gain,
        sensor_offset_Nm=offset,
        fit=fit,
        errors=errors,
        errors_configured=errors_configured,
        errors_fitted=errors_fitted,
        by_angle=bin_by_angle(angle[used & turning], residual[used & turning], _ANGLE_BINS),
        by_revolution=by_revolution(measured_ns[used], turned, residual[used]),
        by_order=by_order(angle[used & turning], residual[used & turning]),
        by_speed=by_speed(_speed(track, time[used] - fit.delay_s), residual[used]),
        samples=SampleCount(
            measured=int(np.size(measured_Nm)),
            predicted=int(np.size(predicted_Nm)),
            used=int(np.count_nonzero(used)),
            rejected=sum(causes.values()),
            by_cause=causes,
        ),
        revolutions=float(turned.max() - turned.min()) / (2.0 * np.pi),
        events=tuple(
            ComparisonEvent(event.name, float(event.angle_rad), jump) for event, jump in zip(events, jumps, strict=True)
        ),
        notes=_notes(fit, configured, _search_s(track)) if turns >= _LEAST_TURNS else (),
    )


def _select(track: Track, time_s: FloatArray, ready: BoolArray) -> tuple[BoolArray, dict[str, int]]:
    """Select the times that enter; count the others, each under the first cause that applies."""
    piece, inside = track.piece(time_s)
    remaining = np.ones(time_s.size, dtype=np.bool_)
    causes: dict[str, int] = {}
    for cause, holds in (
        ("no_prediction", ~inside),
        ("prediction_gap", track.blocked[piece]),
        ("not_settled", ~ready[piece]),
        ("load_jump", track.near_step(time_s, GUARD_S)),
    ):
        causes[cause] = int(np.count_nonzero(remaining & holds))
        remaining &= ~holds
    return remaining, causes


def _expected(track: Track, time_s: FloatArray, sensor: TorqueSensor) -> tuple[FloatArray, FloatArray]:
    """Predicted reading of the sensor, and the shaft angle (nan outside the predictions), at times (m,)."""
    piece, inside = track.piece(time_s)
    torque, _ = track.torque_at(time_s, piece)
    theta = np.where(inside, track.theta_at(time_s, piece), np.nan)
    return sensor.reading(torque), theta


def _search_s(track: Track) -> float:
    """Largest distance from the configured delay at which another is searched [s].

    At most half a turn at the fast end of the recorded speeds, since delays a turn apart look alike.
    """
    speed = fast_speed(np.diff(track.theta_rad) / np.diff(track.edge_s))
    return min(_SEARCH_S, np.pi / speed) if speed > 0.0 else _SEARCH_S


def _never_worse(
    fit: SensorFit,
    track: Track,
    measured: tuple[FloatArray, FloatArray],
    sensor: tuple[float, float, float],
) -> SensorFit:
    """Return the fit, or the configured delay if the fitted one does not reduce the error.

    The configured delay counts as identified if it lies within a few sigmas of the fitted one.
    """
    time_s, torque_Nm = measured
    configured_s, gain, offset = sensor
    if not fit.identifiable:
        return fit
    squares = []
    for delay in (fit.delay_s, configured_s):
        good, torque, _ = usable(track, time_s - delay)
        squares.append(float(np.mean((torque_Nm[good] - gain * torque[good] - offset) ** 2)) if good.any() else np.inf)
    if squares[0] <= squares[1]:
        return fit
    good, torque, _ = usable(track, time_s - configured_s)
    settled = abs(fit.delay_s - configured_s) <= _SAME_DELAY * fit.delay_sigma_s
    sigma = fit.delay_sigma_s if settled else float("nan")
    return SensorFit(configured_s, sigma, *line(torque[good], torque_Nm[good]), settled, fit.at_limit)


def _speed(track: Track, time_s: FloatArray) -> FloatArray:
    """Mean speed of the shaft [rad/s] over the piece that holds each time (m,)."""
    return np.asarray((np.diff(track.theta_rad) / np.diff(track.edge_s))[track.piece(time_s)[0]])


def _turning(track: Track, time_s: FloatArray) -> BoolArray:
    """Return true for the times (m,) at which the shaft turns; at standstill friction hides the torque."""
    speed = np.abs(_speed(track, track.edge_s[:-1]))
    share = _TURNING_SHARE * fast_speed(speed)
    return np.asarray(np.abs(_speed(track, time_s)) >= share)


def _notes(fit: SensorFit, configured_s: float, search_s: float) -> tuple[str, ...]:
    far = (
        f"the torque sensor's delay_s of {configured_s:g} s is more than the {search_s:.3g} s by which another is"
        f" sought around it, and may be wrong by whole turns; if it is in milliseconds, write {configured_s * 1e-3:g}"
    )
    return (*([far] if abs(configured_s) > search_s else []), *_fit_notes(fit, configured_s, search_s))


def _fit_notes(fit: SensorFit, configured_s: float, search_s: float) -> tuple[str, ...]:
    if fit.at_limit:
        return (
            f"the best delay lies at the edge of the searched range ({configured_s - search_s:g} .. "
            f"{configured_s + search_s:g} s): the clocks of angle and torque may differ by more; "
            "the errors are at the configured delay",
        )
    if not fit.identifiable:
        return ("no delay lessens the error as configured, or the torque does not follow: the configured one holds",)
    return ()
