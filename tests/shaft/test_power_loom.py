"""The beat-up of a power loom shakes its shaft in twenty orders: all are found, live and from a record."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import textile_twin_core as tt
from tests.shaft.kinds import TURN
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import create_estimator


@cache
def record() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, readings and acceleration of a speed that ripples by 2.5 % RMS, 12 bits at 1 kHz."""
    angle, loom = np.linspace(0.0, TURN, 2049), tt.compile(tt.machines.create("elliptic_gear_beatup"))
    sley = loom.evaluate(theta=angle, omega=np.ones(2049), alpha=np.zeros(2049))["sley_velocity_m_s"]
    inertia = CubicSpline(angle, 1.0 + 0.2 * (sley / np.abs(sley).max()) ** 2, bc_type="periodic")
    slope = inertia.derivative()

    def law(_: float, state: np.ndarray) -> list[float]:
        theta, omega = state
        return [omega, (3.0 * (21.0 - omega) - 0.5 * slope(theta) * omega**2) / inertia(theta)]

    time = np.arange(1, 20_000) / 1000.0
    solved = solve_ivp(law, (0.0, 20.0), [0.5, 21.0], "DOP853", time, rtol=1e-9, atol=1e-9, max_step=0.02)
    theta, omega = solved.y
    alpha = np.array([law(0.0, state)[1] for state in solved.y.T])
    step = TURN / 4096
    stamps = time + np.random.default_rng(1).normal(0.0, 5e-6, time.size)
    read = np.round((theta + omega * (stamps - time)) / step) * step
    return time, read, alpha


@pytest.mark.parametrize(("view", "most"), [("causal", 0.1), ("smooth", 0.35)])
def test_ripple_of_a_sleys_inertia(view: str, most: float) -> None:
    """Check the error of the acceleration beside the textbook's."""
    time, read, alpha = record()
    estimator = create_estimator(view)
    states = [estimator.step(time, read), estimator.finish()][view == "smooth"]
    late = states.index[states.index > 10_000]
    off = states.alpha_rad_s2[states.index > 10_000] - alpha[late]
    book = getattr(textbook(time, read), view)[late, 2] - alpha[late]
    assert np.sqrt(np.mean(off**2)) < most * np.sqrt(np.mean(book**2))
