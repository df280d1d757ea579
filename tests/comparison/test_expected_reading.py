"""Expected reading behind a filter, against scipy.signal on a grid of 200 kHz."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy import signal

from tests.comparison.test_compare import ENTRY, EVENTS, EXIT, START_NS, angle, torque
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison import compare_torque
from textile_twin_core.comparison.expected_reading import expected_readings
from textile_twin_core.comparison.residual import ResidualStream
from textile_twin_core.machine import TorqueFilter, TorqueSensor

SECONDS, PEAK_NM, RATE_HZ = 5.0, 17.0, 2e5
SENSORS: dict[str, dict[str, Any]] = {
    "first_order": {"low_pass_s": 0.01},
    "short": {"low_pass_s": 0.001},
    "butterworth": {"low_pass_hz": 20.0, "low_pass_order": 2},
    "blocked_mean": {"high_pass_hz": 0.5},
    "band": {"low_pass_hz": 40.0, "high_pass_hz": 0.8},
    "slow_block": {"high_pass_hz": 0.02},
}
LIVE = {("short", 500.0): 8e-3, ("blocked_mean", 500.0): 2e-2}
"""Live errors over the peak that are larger: kinks lie between predictions, and no slow filter smooths them."""
EACH = pytest.mark.parametrize("name", list(SENSORS)[:5])


class Case(NamedTuple):
    sensor: TorqueSensor
    measured_ns: IntArray
    measured: FloatArray
    predicted_ns: IntArray
    predicted: FloatArray
    theta: FloatArray


@cache
def _fine() -> tuple[FloatArray, FloatArray]:
    """Times of a fine grid and means of the torque about them; it begins 4 s before the record."""
    time = np.arange(round(-4.0 * RATE_HZ), round(SECONDS * RATE_HZ)) / RATE_HZ
    return time, np.mean([torque(angle(time + shift / RATE_HZ)) for shift in (-0.375, -0.125, 0.125, 0.375)], axis=0)


@cache
def _true(name: str) -> tuple[FloatArray, FloatArray]:
    """Times of the fine grid and the filtered torque there."""
    given = SENSORS[name]
    b, a = np.array([1.0]), np.array([1.0])
    corner = given.get("low_pass_hz", 1.0 / (2.0 * math.pi * given.get("low_pass_s", math.inf)))
    for order, hz, kind in ((given.get("low_pass_order", 1), corner, "low"), (1, given.get("high_pass_hz", 0), "high")):
        if hz:
            numerator, denominator = signal.butter(order, 2.0 * math.pi * hz, kind, analog=True)
            b, a = np.polymul(b, numerator), np.polymul(a, denominator)
    time, values = _fine()
    numerator, denominator, _ = signal.cont2discrete((b, a), 1.0 / RATE_HZ, "foh")
    about = values[0] if "high_pass_hz" not in given else values[time < -1.0].mean()
    filtered = signal.lfilter(np.ravel(numerator), denominator, values - about)
    return time, filtered + about * b[-1] / a[-1]


@cache
def _case(name: str, rate_hz: float = 500.0, noise_Nm: float = 0.0) -> Case:
    rng = np.random.default_rng(11)
    sensor = TorqueSensor(gain=1.02, offset_Nm=0.3, delay_s=0.0031, **SENSORS[name])
    n = round(rate_hz * SECONDS)
    predicted_ns = START_NS + np.round((np.arange(n) + rng.uniform(-0.01, 0.01, n)) / rate_hz * 1e9).astype(np.int64)
    measured_ns = START_NS + np.round(np.sort(rng.uniform(0.0, SECONDS, n)) * 1e9).astype(np.int64)
    time, filtered = _true(name)
    at = (measured_ns - START_NS) * 1e-9 - sensor.delay_s
    measured = 1.02 * np.interp(at, time, filtered) + 0.3 + noise_Nm * rng.standard_normal(n)
    theta = angle((predicted_ns - START_NS) * 1e-9)
    return Case(sensor, measured_ns, measured, predicted_ns, torque(theta), theta)


def _settled(case: Case) -> float:
    return 8.0 * TorqueFilter.of(case.sensor).settling_s / 7.0


@EACH
@pytest.mark.parametrize("rate_hz", [500.0, 2000.0])
def test_a_comparison_meets_the_filtered_torque(name: str, rate_hz: float) -> None:
    case = _case(name, rate_hz)
    found = compare_torque(*case[1:], torque_sensor=case.sensor, events=EVENTS)
    assert found.fitted_gain == pytest.approx(1.02, abs=1e-3)
    assert np.nanmax(np.abs(found.residual_Nm)) < (1e-3 if "low" in str(case.sensor) else 2e-3) * PEAK_NM
    late = found.stamps_ns - START_NS > (_settled(case) + 0.0031 + 4.0 / rate_hz) * 1e9
    smooth = TorqueFilter.of(case.sensor).is_smooth
    assert np.count_nonzero(found.used[late]) >= (0.995 if smooth else 0.9) * np.count_nonzero(late)


@EACH
def test_views_see_what_the_sensor_reads_of_each_prediction(name: str) -> None:
    case = _case(name)
    found = compare_torque(*case[1:], torque_sensor=case.sensor, events=EVENTS)
    time = (found.predicted_stamps_ns - START_NS) * 1e-9
    late = time > _settled(case)
    expected = 1.02 * np.interp(time, *_true(name)) + 0.3
    assert np.abs(found.predicted_reading_Nm - expected)[late].max() < 2e-3 * PEAK_NM
    alone = expected_readings(case.sensor, case.predicted_ns, case.predicted, case.theta, [e.angle_rad for e in EVENTS])
    np.testing.assert_allclose(alone, found.predicted_reading_Nm, atol=1e-12)


@EACH
@pytest.mark.parametrize("rate_hz", [500.0, 2000.0])
def test_a_live_stream_meets_the_filtered_torque(name: str, rate_hz: float) -> None:
    """Predictions at the rate of the sensor; the torque is linear between them but at the jumps."""
    case = _case(name, rate_hz)
    stream = ResidualStream(case.sensor, (ENTRY, EXIT))
    found = []
    position = 0
    for stamp, predicted, theta in zip(case.predicted_ns.tolist(), case.predicted, case.theta, strict=True):
        found += stream.predicted([stamp], [float(predicted)], [float(theta)])
        while position < case.measured_ns.size and case.measured_ns[position] <= stamp + 5_000_000:
            found += stream.measured(int(case.measured_ns[position]), float(case.measured[position]))
            position += 1
    # A high pass begins live without knowing the mean.
    late = [each.residual_Nm for each in found if each.stamp_ns - START_NS > 1.6 * _settled(case) * 1e9]
    assert np.abs(late).max() < LIVE.get((name, rate_hz), 3e-3) * PEAK_NM
    assert stream.skipped["filter has not settled"] == pytest.approx(
        TorqueFilter.of(case.sensor).settling_s * rate_hz, rel=0.4, abs=6
    )
    if TorqueFilter.of(case.sensor).is_smooth:
        assert stream.skipped["load jumps there"] == 0
        assert stream.given > 0.995 * case.measured_ns.size - stream.skipped["filter has not settled"] - 12


def test_the_residual_of_a_filtered_sensor_is_its_noise() -> None:
    case = _case("butterworth", noise_Nm=0.1)
    found = compare_torque(*case[1:], torque_sensor=case.sensor, events=EVENTS)
    assert found.errors.rms_error_Nm == pytest.approx(0.1, rel=0.03)
    unfiltered = replace(case.sensor, low_pass_hz=0.0, low_pass_order=1)
    assert compare_torque(*case[1:], torque_sensor=unfiltered, events=EVENTS).errors.rms_error_Nm > 1.0


def test_a_gap_starts_the_filter_again() -> None:
    case = _case("first_order")
    kept = np.ones(case.predicted_ns.size, np.bool_)
    kept[1500:1700] = False
    found = compare_torque(
        case.measured_ns, case.measured, case.predicted_ns[kept], case.predicted[kept], case.theta[kept],
        torque_sensor=case.sensor, events=EVENTS,
    )  # fmt: skip
    assert np.nanmax(np.abs(found.residual_Nm)) < 1e-3 * PEAK_NM
    assert found.samples.by_cause["not_settled"] == pytest.approx(2 * 500 * 0.0691, abs=20)
    stream = ResidualStream(case.sensor, (ENTRY, EXIT))
    stream.predicted(case.predicted_ns[kept].tolist(), case.predicted[kept].tolist(), case.theta[kept].tolist())
    live = [
        each.residual_Nm
        for stamp, value in zip(case.measured_ns[:-10].tolist(), case.measured[:-10].tolist(), strict=True)
        for each in stream.measured(stamp, value)
    ]
    assert np.abs(live).max() < 2.5e-3 * PEAK_NM
    assert stream.skipped["filter has not settled"] == pytest.approx(2 * 500 * 0.0691, abs=20)


def test_a_slow_high_pass_does_not_take_the_whole_record() -> None:
    """Its settling time is 55 s, the record 5 s long: half is left out, and the mean differs little."""
    case = _case("slow_block")
    found = compare_torque(*case[1:], torque_sensor=case.sensor, events=EVENTS)
    assert found.samples.by_cause["not_settled"] == pytest.approx(0.5 * case.measured_ns.size, rel=0.1)
    assert found.errors.rms_error_Nm < 0.02 * PEAK_NM
