"""compare_torque against signals whose delay, gain, offset and errors are known in closed form."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison import compare_torque, summary_rows
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.errors import AlignmentError, TwinError
from textile_twin_core.machine import TorqueSensor

START_NS = 1_763_000_000_123_456_789
ENTRY, EXIT, LOWEST = 0.38312100023839724, 3.3846508836082833, 0.4 + np.pi / 2
OMEGA = 16.755


@dataclass
class Event:
    name: str
    angle_rad: float


EVENTS = [Event("entry", ENTRY), Event("lowest", LOWEST), Event("exit", EXIT)]


def angle(time_s: npt.NDArray[np.floating[Any]]) -> FloatArray:
    """Angle of a shaft at about 160 rpm with a ripple, in closed form."""
    return np.asarray(OMEGA * time_s + 0.004 * np.sin(OMEGA * time_s), dtype=np.float64)


def torque(theta: FloatArray) -> FloatArray:
    """Smooth inertia part, and a friction that starts and ends with a step, as the needle's in the backing."""
    phase = np.mod(theta, 2 * np.pi)
    inside = (phase >= ENTRY) & (phase < EXIT)
    return 0.4 * np.sin(2 * theta) + 0.5 * np.cos(theta) + inside * 17.0 * np.abs(np.cos(phase - 0.4))


def recording(
    seconds: float = 8.0, delay_s: float = 0.002, gain: float = 1.01, offset: float = 0.03, noise: float = 0.0
) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Measured and predicted torque at 500 Hz with jittered stamps on both sides."""
    rng = np.random.default_rng(7)
    n = int(500 * seconds)
    predicted_ns = START_NS + np.round((np.arange(n) * 2e-3 + rng.normal(0, 2e-5, n)) * 1e9).astype(np.int64)
    measured_ns = START_NS + np.round((np.arange(n) * 2e-3 + rng.uniform(0, 2e-3, n)) * 1e9).astype(np.int64)
    measured_ns = np.unique(measured_ns)
    seconds_at = (predicted_ns - START_NS) * 1e-9
    theta = angle(seconds_at)
    true = torque(angle((measured_ns - START_NS) * 1e-9 - delay_s))
    measured = gain * true + offset + rng.normal(0, 1, true.size) * noise
    return measured_ns, measured, predicted_ns, torque(theta), theta


def test_gain_and_offset_are_those_of_a_line_at_the_delay() -> None:
    result = compare_torque(*recording(), events=EVENTS, delay=Estimate(0.002, 1e-6))
    assert result.delay.value == 0.002
    assert result.fitted_gain == pytest.approx(1.01, abs=2e-4)
    assert result.fitted_offset_Nm == pytest.approx(0.03, abs=2e-3)
    assert result.errors_fitted.rms_error_Nm < 1e-4
    assert result.errors.rms_error_Nm < result.errors_configured.rms_error_Nm
    assert result.to_json()["torque"]["delay_identifiable"]


def test_configured_sensor_removes_gain_offset_and_delay() -> None:
    sensor = TorqueSensor(gain=1.01, offset_Nm=0.03, delay_s=0.002)
    result = compare_torque(*recording(), events=EVENTS, torque_sensor=sensor)
    assert result.errors_configured.rms_error_Nm < 1e-4
    assert result.errors.rms_error_Nm < 1e-4
    assert result.sensor_delay_s == 0.002


def test_noise_alone_gives_its_own_rms_bias_and_correlation() -> None:
    measured_ns, measured, predicted_ns, predicted, theta = recording(
        seconds=20.0, delay_s=0.0, gain=1.0, offset=0.0, noise=0.5
    )
    result = compare_torque(measured_ns, measured, predicted_ns, predicted, theta, events=EVENTS)
    count = result.samples.used
    assert result.errors.rms_error_Nm == pytest.approx(0.5, rel=5 / np.sqrt(2 * count))
    assert abs(result.errors.bias_Nm) < 5 * 0.5 / np.sqrt(count)
    assert result.errors.peak_Nm == pytest.approx(np.max(np.abs(measured[result.used])), rel=1e-12)
    assert result.errors.rms_over_peak == pytest.approx(result.errors.rms_error_Nm / result.errors.peak_Nm)
    truth = np.corrcoef(measured[result.used], result.expected_Nm[result.used])[0, 1]
    assert result.errors.correlation == pytest.approx(truth, rel=1e-12)


def test_no_sample_is_compared_across_the_step_and_all_are_counted() -> None:
    measured_ns, measured, predicted_ns, predicted, theta = recording(noise=0.0)
    result = compare_torque(measured_ns, measured, predicted_ns, predicted, theta, events=EVENTS, delay=Estimate(0.002))
    assert [event.jump for event in result.events] == [True, False, True]
    turns = (theta[-1] - theta[0]) / (2 * np.pi)
    # Two steps a turn, a guard of 1 ms about each, one measured sample in 2 ms.
    assert 0.7 * turns < result.samples.by_cause["load_jump"] < 1.3 * turns
    assert np.max(np.abs(result.residual_Nm[result.used])) < 0.25  # gain and offset of the sensor
    assert result.samples.used + result.samples.rejected == result.samples.measured == measured.size
    linear = np.interp(measured_ns - 2_000_000, predicted_ns, predicted)
    assert np.max(np.abs(measured - linear)) > 5.0  # error of an interpolation across the step


def test_every_bad_sample_is_rejected_under_its_cause() -> None:
    measured_ns, measured, predicted_ns, predicted, theta = recording()
    measured_ns, measured = measured_ns.copy(), measured.copy()
    measured[100], measured[200], measured[300] = np.nan, np.inf, -np.inf
    measured_ns[400] = measured_ns[399]
    measured_ns[500] = measured_ns[490]
    keep = np.ones(predicted_ns.size, dtype=bool)
    keep[1000:1100] = False  # 0.2 s without predictions
    settled = np.arange(predicted_ns.size) >= 250
    predicted = predicted.copy()
    predicted[2000] = np.nan
    result = compare_torque(
        measured_ns,
        measured,
        predicted_ns[keep],
        predicted[keep],
        theta[keep],
        events=EVENTS,
        settled=settled[keep],
        rejected={"not_finite": 3, "duplicate": 0},
    )
    causes = result.samples.by_cause
    assert causes["not_finite"] == 3
    assert causes["stamp_not_increasing"] == 2
    assert causes["prediction_gap"] == pytest.approx(101, abs=3)
    assert causes["not_settled"] == pytest.approx(250, abs=4)
    assert causes["prediction_not_usable"] == 1
    assert causes["angle_not_finite"] == 3
    assert "angle_duplicate" not in causes
    assert result.samples.rejected == sum(causes.values())
    assert result.samples.used + result.samples.rejected == measured.size + 1 + 3
    assert not np.isfinite(result.residual_Nm[~result.used]).any()


def test_errors_by_angle_find_a_local_departure() -> None:
    measured_ns, measured, predicted_ns, predicted, theta = recording(seconds=20.0, delay_s=0.0, gain=1.0, offset=0.0)
    phase = np.mod(angle((measured_ns - START_NS) * 1e-9), 2 * np.pi)
    lump = (phase > np.deg2rad(60)) & (phase < np.deg2rad(72))
    result = compare_torque(measured_ns, measured + 0.7 * lump, predicted_ns, predicted, theta, events=EVENTS)
    bins = result.by_angle
    degrees = np.rad2deg(bins.centre_rad)
    assert bins.mean_Nm[(degrees > 60) & (degrees < 72)] == pytest.approx(0.7, abs=0.05)
    assert np.nanmax(np.abs(bins.mean_Nm[(degrees > 80) & (degrees < 180)])) < 0.05
    assert int(bins.count.sum()) == result.samples.used
    for k in (3, 40, 77):
        mine = result.used & (np.abs(np.mod(result.theta_rad, 2 * np.pi) - bins.centre_rad[k]) < np.pi / 120)
        residual = result.residual_Nm[mine]
        assert bins.count[k] == residual.size
        assert bins.mean_Nm[k] == pytest.approx(residual.mean(), abs=1e-12)
        assert bins.std_Nm[k] == pytest.approx(residual.std(), abs=1e-12)
        assert (bins.min_Nm[k], bins.max_Nm[k]) == (residual.min(), residual.max())


def test_errors_by_revolution_find_the_bad_turn() -> None:
    measured_ns, measured, predicted_ns, predicted, theta = recording(delay_s=0.0, gain=1.0, offset=0.0)
    turn = np.floor(angle((measured_ns - START_NS) * 1e-9) / (2 * np.pi))
    result = compare_torque(measured_ns, measured - 1.5 * (turn == 9), predicted_ns, predicted, theta, events=EVENTS)
    rows = result.by_revolution
    assert rows.number[np.argmax(rows.rms_Nm)] == 9
    assert rows.mean_Nm[rows.number == 9] == pytest.approx(-1.5, abs=0.05)
    assert rows.worst_Nm[rows.number == 9][0] < -1.5
    assert int(rows.count.sum()) == result.samples.used
    assert np.all(np.diff(rows.start_ns) > 0)
    assert result.revolutions == pytest.approx((theta[-1] - theta[0]) / (2 * np.pi), abs=0.05)


def test_json_is_nested_plain_and_complete() -> None:
    result = compare_torque(*recording(noise=0.1), events=EVENTS, rejected={"gap": 2})
    numbers = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert numbers["torque"]["rms_error_Nm"] == result.errors.rms_error_Nm
    assert numbers["torque"]["rms_over_peak"] == result.errors.rms_over_peak
    assert numbers["torque"]["correlation"] == result.errors.correlation
    assert numbers["torque"]["delay_s"] == result.delay.value
    assert numbers["torque"]["configured"]["delay_s"] == 0.0
    assert numbers["samples"]["used"] == result.samples.used
    assert numbers["samples"]["rejected"] == result.samples.rejected
    assert numbers["samples"]["rejected_by_cause"]["angle_gap"] == 2
    assert numbers["revolutions"] == pytest.approx(21.3, abs=0.1)
    assert len(numbers["by_angle"]["mean_Nm"]) == 120
    labels = [label for label, _ in summary_rows(result)]
    assert labels[:2] == ["RMS error", "RMS error over peak"]


@pytest.mark.parametrize("value", [0.0, 4.0])
def test_a_constant_torque_is_compared_at_the_configured_delay(value: float) -> None:
    measured_ns, _, predicted_ns, predicted, theta = recording()
    values = np.full(measured_ns.size, value)
    found = compare_torque(measured_ns, values, predicted_ns, predicted, theta, torque_sensor=TorqueSensor(1, 0, 0.003))
    assert found.delay.value == 0.003 and not found.to_json()["torque"]["delay_identifiable"]
    json.dumps(found.to_json(), allow_nan=False)


def test_a_constant_prediction_is_compared() -> None:
    measured_ns, measured, predicted_ns, _, theta = recording()
    result = compare_torque(measured_ns, measured, predicted_ns, np.full(theta.size, 3.0), theta)
    assert result.errors.rms_error_Nm == pytest.approx(np.sqrt(np.mean((measured[result.used] - 3.0) ** 2)))
    assert result.errors_fitted.rms_error_Nm == pytest.approx(np.std(measured[result.used]))


def test_clocks_that_do_not_overlap_are_named_with_both_ranges() -> None:
    measured_ns, measured, predicted_ns, predicted, theta = recording()
    with pytest.raises(AlignmentError) as error:
        compare_torque(measured_ns + 3_600 * 10**9, measured, predicted_ns, predicted, theta)
    text = str(error.value)
    assert isinstance(error.value, TwinError)
    assert "\n" not in text
    assert "1763000000.12" in text and "1763003600.12" in text and "3600" in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"predicted_Nm": np.zeros(3)}, "predicted torque has shape"),
        ({"theta_rad": np.zeros(3)}, "shaft angle has shape"),
        ({"measured_Nm": np.zeros(3)}, "measured torque has shape"),
        ({"settled": np.ones(3, dtype=bool)}, "settled has shape"),
        ({"measured_stamps_ns": np.linspace(0.0, 1.0, 500)}, "whole nanoseconds"),
    ],
)
def test_wrong_shapes_and_stamps_are_refused(change: dict[str, object], message: str) -> None:
    names = ("measured_stamps_ns", "measured_Nm", "predicted_stamps_ns", "predicted_Nm", "theta_rad")
    arguments: dict[str, object] = dict(zip(names, recording(seconds=1.0), strict=True))
    arguments.update(change)
    with pytest.raises(AlignmentError, match=message):
        compare_torque(**arguments)  # type: ignore[arg-type]


def test_empty_and_nearly_empty_recordings_are_refused() -> None:
    measured_ns, measured, predicted_ns, predicted, theta = recording(seconds=1.0)
    empty_ns, empty = np.empty(0, dtype=np.int64), np.empty(0)
    with pytest.raises(AlignmentError, match="too little torque"):
        compare_torque(empty_ns, empty, predicted_ns, predicted, theta)
    with pytest.raises(AlignmentError):
        compare_torque(measured_ns, measured, empty_ns, empty, empty)
    with pytest.raises(AlignmentError, match="only 5 of 5 measured"):
        compare_torque(measured_ns[50:55], measured[50:55], predicted_ns, predicted, theta)
    with pytest.raises(AlignmentError, match="not_settled"):
        compare_torque(measured_ns, measured, predicted_ns, predicted, theta, settled=np.zeros(theta.size, dtype=bool))
