"""Filter of the torque sensor, against scipy.signal.lsim and analytic responses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from textile_twin_core.errors import MachineError
from textile_twin_core.machine import TorqueFilter, TorqueSensor

FILTERS: dict[str, dict[str, Any]] = {
    "first_order": {"low_pass_s": 0.01},
    "first_order_hz": {"low_pass_hz": 35.0},
    "butterworth": {"low_pass_hz": 20.0, "low_pass_order": 2},
    "blocked_mean": {"high_pass_hz": 0.5},
    "band": {"low_pass_s": 0.004, "high_pass_hz": 2.0},
    "butterworth_band": {"low_pass_hz": 20.0, "low_pass_order": 2, "high_pass_hz": 1.0},
}
EACH = pytest.mark.parametrize("given", FILTERS.values(), ids=FILTERS.keys())


def _transfer(given: dict[str, Any]) -> signal.TransferFunction:
    """Build the transfer function from scipy's analogue Butterworth designs."""
    b, a = [1.0], [1.0]
    corner = given.get("low_pass_hz", 1.0 / (2.0 * math.pi * given.get("low_pass_s", math.inf)))
    for order, hz, kind in (
        (given.get("low_pass_order", 1), corner, "low"),
        (1, given.get("high_pass_hz", 0.0), "high"),
    ):
        if hz:
            numerator, denominator = signal.butter(order, 2.0 * math.pi * hz, kind, analog=True)
            b, a = np.polymul(b, numerator), np.polymul(a, denominator)
    return signal.TransferFunction(b, a)


@EACH
def test_the_response_is_that_of_the_analogue_design(given: dict[str, Any]) -> None:
    frequency = np.geomspace(0.01, 1000.0, 60)
    _, expected = signal.freqs(_transfer(given).num, _transfer(given).den, 2.0 * math.pi * frequency)
    assert_allclose(TorqueFilter(**given).response(frequency), expected, rtol=1e-12)
    assert TorqueFilter(**given).response(0.0) == pytest.approx(TorqueFilter(**given).gain_at_zero)


@EACH
@pytest.mark.parametrize("period_s", [1e-5, 1e-3, 0.05])
def test_a_piecewise_linear_input_is_filtered_exactly(given: dict[str, Any], period_s: float) -> None:
    rng = np.random.default_rng(3)
    time = np.arange(600) * period_s
    values = np.concatenate([np.zeros(300), rng.standard_normal(300)])
    values[:300] += 2.0 * ("high_pass_hz" not in given)  # a torque that stands, and a filter in its steady state
    found = TorqueFilter(**given)
    steady = 2.0 * ("high_pass_hz" not in given)
    _, expected, _ = signal.lsim(_transfer(given), values - steady, time)
    session = found.session()
    streamed = np.array(session.take(np.full(600, period_s), values))
    assert_allclose(streamed, expected + steady, atol=2e-11)
    if "high_pass_hz" not in given:
        assert_allclose(found.apply(period_s, values), expected + steady, atol=2e-11)


@EACH
def test_a_sine_comes_out_with_the_response(given: dict[str, Any]) -> None:
    """Started warm: the low pass from the first value, the high pass from the mean."""
    found = TorqueFilter(**given)
    time = np.arange(50000) * 2e-4
    values = 3.0 + 2.0 * np.sin(2.0 * math.pi * 8.0 * time + 0.4)
    gain = complex(found.response(8.0))
    expected = 3.0 * found.gain_at_zero + 2.0 * abs(gain) * np.sin(2.0 * math.pi * 8.0 * time + 0.4 + np.angle(gain))
    error = np.abs(found.apply(2e-4, values) - expected)
    assert error[time >= found.settling_s].max() < 5.0 * 1.1e-3
    assert error[time >= 3.0 * found.settling_s].max() < 5.0 * 1e-5


@EACH
def test_uneven_stamps_and_columns_give_the_same_numbers(given: dict[str, Any]) -> None:
    """A straight line is the same input however it is divided; columns are filtered one by one."""
    found, rng = TorqueFilter(**given), np.random.default_rng(5)
    corners = np.linspace(0.0, 4.0, 401)
    values = rng.standard_normal(401).cumsum()
    between = np.sort(np.concatenate([corners, rng.uniform(0.0, 4.0, 900)]))
    session = found.session()
    streamed = session.take(np.diff(between, prepend=0.0), np.interp(between, corners, values))
    coarse = found.session().take(np.full(401, 0.01), values)
    assert_allclose(np.asarray(streamed)[np.searchsorted(between, corners)], coarse, atol=1e-11)
    both = found.apply(0.01, np.stack([values, values[::-1]], axis=1))
    assert_allclose(both[:, 0], found.apply(0.01, values), rtol=0.0, atol=0.0)
    assert_allclose(both[-1, 0], coarse[-1], atol=1e-3 * np.abs(values).max() + 0.0)
    assert_allclose(both[:, 1], found.apply(0.01, values[::-1]), rtol=0.0, atol=0.0)


@EACH
def test_a_jump_is_the_step_response(given: dict[str, Any]) -> None:
    session = TorqueFilter(**given).session()
    session.step(0.0, 0.0)
    before = session.jump(1.0)
    assert before == pytest.approx(0.0 if "low_pass_s" in given or "low_pass_hz" in given else 1.0, abs=1e-14)
    time = np.linspace(0.0, 0.5, 200)
    _, expected = signal.step(_transfer(given), T=time)
    assert_allclose([session.output, *session.take(np.diff(time), np.ones(199))], expected, atol=1e-11)


def test_a_wrong_start_has_settled_after_the_stated_time() -> None:
    for given in FILTERS.values():
        found = TorqueFilter(**given)
        session = found.session()
        session.step(0.0, 0.0)
        session.jump(1.0)
        grid = np.linspace(0.0, 3.0 * found.settling_s, 301)
        left = np.abs(np.array(session.take(np.diff(grid), np.ones(300))) - found.gain_at_zero)
        assert left[100:].max() < 1e-3
        assert left[:60].max() > 1e-3  # and the time is not long-winded


def test_gaps_start_the_low_pass_again() -> None:
    found = TorqueFilter(low_pass_s=0.01)
    values = np.array([1.0, 1.0, math.nan, 5.0, 5.0])
    assert_allclose(found.apply(1e-3, values), values)
    session = TorqueFilter(high_pass_hz=1.0).session()
    assert math.isnan(session.output)
    assert session.jump(4.0) == 0.0
    session.reset()
    assert math.isnan(session.output)


def test_without_a_filter_values_pass() -> None:
    found = TorqueFilter.of(TorqueSensor(gain=2.0, delay_s=0.1))
    assert found.is_identity
    assert found.settling_s == 0.0
    values = np.array([1.0, math.nan, 3.0])
    assert_allclose(found.apply(1e-3, values), values)
    assert found.session().take([0.0, 1e-3], [1.0, 2.0]) == [1.0, 2.0]
    assert TorqueFilter.of(TorqueSensor(low_pass_hz=20.0, low_pass_order=2)) == TorqueFilter(0.0, 20.0, 2)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"low_pass_s": 0.01, "low_pass_hz": 20.0}, "low_pass_s or low_pass_hz, not both"),
        ({"low_pass_s": -0.01}, "low_pass_s must be a time in seconds"),
        ({"low_pass_s": math.nan}, "low_pass_s must be a time in seconds"),
        ({"low_pass_hz": -1.0}, "low_pass_hz must be a positive frequency"),
        ({"high_pass_hz": math.inf}, "high_pass_hz must be a positive frequency"),
        ({"low_pass_hz": 20.0, "low_pass_order": 3}, "low_pass_order must be 1 or 2, not 3"),
        ({"low_pass_s": 0.01, "low_pass_order": 2}, "low_pass_order 2 needs low_pass_hz"),
        ({"low_pass_order": 2}, "low_pass_order 2 needs low_pass_hz"),
        (
            {"low_pass_s": 0.1, "high_pass_hz": 2.0},
            "high_pass_hz 2 must be below .* 1.592 Hz",
        ),
    ],
)
@pytest.mark.parametrize("cls", [TorqueFilter, TorqueSensor])
def test_refused(cls: type, given: dict[str, Any], said: str) -> None:
    with pytest.raises(MachineError, match=said):
        cls(**given)
