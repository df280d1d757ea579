"""The filter's equations against independent integration, differentiation and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline
from scipy.stats import norm

from textile_twin_core.shaft.encoder import EncoderNoise, encoder_step
from textile_twin_core.shaft.knocks import response
from textile_twin_core.shaft.ripple import Ripple, advance, blank_gradient, observe
from textile_twin_core.shaft.spline import Knots, PenalisedSpline

STATE = np.array([0.7, 16.0, 3.0, -0.2, 9.0, np.log(0.04), 0.02, -0.01, 0.004, 0.006])
ORDERS = [1, 3]


def motion(_: float, y: np.ndarray) -> np.ndarray:
    """The model as the docstring of `ripple` states it."""
    theta, level, slope, dip, rate, log_response = y[:6]
    h = y[6] * np.cos(theta) + y[7] * np.sin(theta) + y[8] * np.cos(3 * theta) + y[9] * np.sin(3 * theta)
    constant = np.exp(log_response)
    out = np.zeros(10)
    out[:5] = (level + dip) * (1 + h), slope, 0.0, rate, -2 * rate / constant - dip / constant**2
    return out


def moved(state: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    new, transition = state.copy(), np.eye(10)
    advance(new, Ripple(state[0], ORDERS, state[6:].tolist()), step, transition)
    return new, transition


def test_motion_and_transition() -> None:
    step = 0.002
    exact = solve_ivp(motion, (0, step), STATE, rtol=1e-12, atol=1e-14).y[:, -1]
    new, transition = moved(STATE, step)
    assert np.abs(new - exact)[0] < 2e-8  # third order in the angle
    assert np.abs(new - exact)[1:].max() < 1e-11
    slopes = np.stack(
        [(moved(STATE + d, step)[0] - moved(STATE - d, step)[0]) / 2e-6 for d in 1e-6 * np.eye(10)], axis=1
    )
    scale = np.maximum(np.abs(slopes), np.abs(slopes).max(axis=1, keepdims=True) * 1e-2)
    assert (np.abs(transition - slopes) / scale).max() < 5e-3


def test_observed_speed_and_acceleration_and_their_gradient() -> None:
    def seen(state: np.ndarray) -> np.ndarray:
        gradient = blank_gradient(10)
        return np.array(observe(state, Ripple(state[0], ORDERS, state[6:].tolist()), gradient))

    gradient = blank_gradient(10)
    observe(STATE, Ripple(STATE[0], ORDERS, STATE[6:].tolist()), gradient)
    slopes = np.stack([(seen(STATE + d) - seen(STATE - d)) / 2e-6 for d in 1e-6 * np.eye(10)], axis=1)
    assert np.allclose(gradient, slopes, rtol=1e-6, atol=1e-5)
    ahead, behind = (solve_ivp(motion, (0, s), STATE, rtol=1e-12, atol=1e-14).y[0, -1] for s in (1e-4, -1e-4))
    assert seen(STATE)[1] == pytest.approx((ahead - behind) / 2e-4, rel=1e-6)
    assert seen(STATE)[2] == pytest.approx((ahead - 2 * STATE[0] + behind) / 1e-8, rel=1e-3)


def test_response_to_a_knock() -> None:
    def drive(_: float, y: np.ndarray) -> list[float]:
        return [y[1], y[2], -2 * y[2] / 0.03 - y[1] / 0.03**2]

    times = np.array([0.01, 0.05, 0.2])
    exact = solve_ivp(drive, (0, 0.2), [0, 0, 1.0], t_eval=times, rtol=1e-10, atol=1e-14).y
    assert np.allclose(response(times, 0.03), exact, rtol=1e-6, atol=1e-9)
    assert not response(np.array([-0.1]), 0.03).any()


@pytest.mark.parametrize("offset", [0.0, 0.4, 1.5, 8.0])
def test_a_coarse_reading_is_worth_what_its_interval_is(offset: float) -> None:
    step, sigma = 0.02, 0.0011
    noise = EncoderNoise(step, 0.0)
    noise._rest = 0.0
    innovation = step / 2 + (offset - 0.5) * sigma
    seen, variance, _ = noise.reading(innovation, sigma**2, 1.0)
    low, high = innovation - step / 2, innovation + step / 2
    at = np.linspace(low, min(high, low + 12 * sigma), 20001)
    weight = norm.pdf(at / sigma)
    mean = np.trapezoid(weight * at, at) / np.trapezoid(weight, at)
    spread = np.trapezoid(weight * (at - mean) ** 2, at) / np.trapezoid(weight, at)
    gain = sigma**2 / variance
    assert gain * seen == pytest.approx(mean, rel=0.02)
    if offset < 5:
        assert sigma**2 * (1 - gain) == pytest.approx(spread, rel=1e-3)


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_the_encoders_step_is_found(bits: int) -> None:
    rng = np.random.default_rng(bits)
    step = 2 * np.pi / 2**bits
    theta = 16.755 * (np.arange(768) * 0.002 + rng.normal(0, 2e-5, 768)) + 0.05 * np.sin(np.arange(768) / 30)
    assert encoder_step(np.mod(np.round(theta / step) * step, 2 * np.pi)) == pytest.approx(step, rel=1e-6)
    assert encoder_step(np.round(theta / step) * step - 1.234) == pytest.approx(step, rel=1e-6)


def test_no_step_is_found_where_none_is() -> None:
    rng = np.random.default_rng(0)
    assert encoder_step(np.cumsum(rng.uniform(0.02, 0.04, 700))) == 0.0
    assert encoder_step(np.full(700, 1.25)) is None
    in_step = np.mod(np.arange(700) * (2 * np.pi / 200), 2 * np.pi)  # 200 samples a turn, to the last bit
    assert encoder_step(np.round(in_step, 12)) == 0.0


def test_spline_against_scipy_and_dense_algebra() -> None:
    rng = np.random.default_rng(3)
    breaks = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0.02, 0.98, 9)]))
    knots = Knots(breaks)
    times = np.sort(rng.uniform(0, 1, 150))
    basis = knots.basis(times)
    coefficients = rng.normal(size=knots.size)
    spline = BSpline(np.concatenate([[0.0] * 3, breaks, [1.0] * 3]), coefficients, 3)
    for order, values in enumerate((basis.value, basis.slope, basis.bend)):
        assert np.allclose(np.sum(values * coefficients[basis.columns], axis=1), spline(times, order), rtol=1e-9)
    weight, intensity = rng.uniform(1, 2, 150), rng.uniform(1e3, 1e5, knots.intervals)
    design = spline.design_matrix(times, spline.t, 3).toarray()
    middle = (breaks[1:] + breaks[:-1]) / 2
    jerk = np.stack([BSpline(spline.t, one, 3)(middle, 3) for one in np.eye(knots.size)], axis=1)
    normal = design.T @ (weight[:, None] * design) + jerk.T @ ((np.diff(breaks) / intensity)[:, None] * jerk)
    fit = PenalisedSpline(knots, basis, weight, intensity)
    data = rng.normal(size=150)
    assert np.allclose(fit.solve(fit.project(data)), np.linalg.solve(normal, design.T @ (weight * data)), atol=1e-6)
    inverse, blocks = np.linalg.inv(normal), fit.inverse_band()
    for i in range(knots.size - 3):
        assert np.allclose(blocks[i], inverse[i : i + 4, i : i + 4], atol=1e-6 * np.abs(inverse).max())
