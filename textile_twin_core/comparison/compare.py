"""Comparison of measured with predicted torque: arrays in, one immutable result out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.alignment import Track, build_track, fast_speed, time_ranges
from textile_twin_core.comparison.expected_reading import reading_track
from textile_twin_core.comparison.inputs import usable_measurements, usable_predictions
from textile_twin_core.comparison.result import Comparison, ComparisonEvent, SampleCount
from textile_twin_core.comparison.statistics import (
    bin_by_angle,
    by_order,
    by_revolution,
    by_speed,
    error_statistics,
    line,
)
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.errors import AlignmentError
from textile_twin_core.machine import Event, TorqueFilter, TorqueSensor

_LEAST_SAMPLES = 16
_GUARD_S = 0.0005
"""Samples this close to a discontinuity of the load are left out: their stamps do not show its side."""
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
    delay: Estimate | None = None,
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
        delay: estimated delay of the torque [s] (see `Assessment.delay`); by default as configured.
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
    delay = Estimate(configured) if delay is None else delay
    if not track.piece(time - configured)[1].any():
        raise AlignmentError(
            f"measured and predicted torque do not overlap in time: {ranges}; both must be stamped by the same clock"
        )
    # The estimator counts as converged at a sample if it is at the predictions on both sides.
    ready = (predictions.settled[:-1] & predictions.settled[1:])[track.after_sample] & filter_settled
    used, not_used = _select(track, time - delay.value, ready)
    causes.update(not_used)
    if np.count_nonzero(used) < _LEAST_SAMPLES:
        why = ", ".join(f"{number} {cause}" for cause, number in causes.items() if number)
        raise AlignmentError(
            f"only {np.count_nonzero(used)} of {measured.size} measured torque samples can be compared"
            f"{f' (rejected: {why})' if why else ''}: {ranges}"
        )
    expected, angle = _expected(track, time - delay.value, sensor)
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
    factor, rest = line(wanted, seen)
    errors_fitted = error_statistics(seen, factor * wanted + rest)
    del seen, wanted
    turned, turning = angle[used], _turning(track, time - delay.value)

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
        delay=delay,
        fitted_gain=gain * factor,
        fitted_offset_Nm=rest + factor * offset,
        errors=errors,
        errors_configured=errors_configured,
        errors_fitted=errors_fitted,
        by_angle=bin_by_angle(angle[used & turning], residual[used & turning], _ANGLE_BINS),
        by_revolution=by_revolution(measured_ns[used], turned, residual[used]),
        by_order=by_order(angle[used & turning], residual[used & turning]),
        by_speed=by_speed(_speed(track, time[used] - delay.value), residual[used]),
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
        ("load_jump", track.near_step(time_s, _GUARD_S)),
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


def _speed(track: Track, time_s: FloatArray) -> FloatArray:
    """Mean speed of the shaft [rad/s] over the piece that holds each time (m,)."""
    return np.asarray((np.diff(track.theta_rad) / np.diff(track.edge_s))[track.piece(time_s)[0]])


def _turning(track: Track, time_s: FloatArray) -> BoolArray:
    """Return true for the times (m,) at which the shaft turns; at standstill friction hides the torque."""
    speed = np.abs(_speed(track, track.edge_s[:-1]))
    share = _TURNING_SHARE * fast_speed(speed)
    return np.asarray(np.abs(_speed(track, time_s)) >= share)
