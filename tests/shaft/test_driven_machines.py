"""The shafts of the published machines under a motor with slip: large ripple, and torque with steps."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import textile_twin_core as tt
from tests.campaign import more
from tests.shaft.kinds import TURN
from tests.shaft.textbook import textbook
from textile_twin_core.dynamics.body import Body
from textile_twin_core.shaft import create_estimator

DURATION_S = 40.0
Errors = tuple[np.ndarray, np.ndarray, np.ndarray]  # of speed and acceleration (n, 2): ours, the textbook's; our sigmas


def _slipping(speed: float, torque_per_slip: float, load: float) -> Callable[[float, float, float], float]:
    return lambda _time, _theta, omega: torque_per_slip * (speed - omega) + load


def _errors(name: str, flywheel: float, bits: int, rate: float, seed: int, view: str, after_s: float) -> Errors:
    """Return the errors of a record from the time `after_s` on; stamps have errors of 20 us."""
    speed, slip, load = {"tufting": (16.8, 2.0, 4.0), "handloom_beatup": (10.5, 1.0, 0.0)}[name]
    machine = tt.machines.create(name)
    machine = dataclasses.replace(machine, bodies=(*machine.bodies, Body.flywheel(flywheel)))
    time = np.arange(rate * DURATION_S) / rate
    true = tt.drive(machine, _slipping(speed, slip, load), 0.3, speed, time)
    late = np.random.default_rng(seed).normal(0.0, 2e-5, time.size)
    step = TURN / 2**bits
    angle = np.round((true.theta_rad + true.omega_rad_s * late) / step) * step
    estimator = create_estimator(view)
    states = [estimator.step(time, angle), estimator.finish()][view == "smooth"]
    kept = time[states.index] > after_s
    index = states.index[kept]
    truth = np.stack([true.omega_rad_s, true.alpha_rad_s2], axis=1)[index]
    told = np.stack([states.omega_rad_s, states.alpha_rad_s2], axis=1)[kept]
    return told - truth, getattr(textbook(time, angle), view)[index, 1:] - truth, states.sigma[kept, 1:]


def _rms(errors: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


@pytest.mark.parametrize("seed", [2, *more(3)])
@pytest.mark.parametrize(("view", "most"), [("causal", 0.15), ("smooth", 0.4)])
def test_a_speed_that_ripples_by_a_fifth(view: str, most: float, seed: int) -> None:
    """Hand loom: three times the prior of its orders; the smaller prior alone gave .5 and .5 of the textbook's."""
    ours, book, _ = _errors("handloom_beatup", 0.05, 13, 500.0, seed, view, 15.0)
    assert _rms(ours)[1] < most * _rms(book)[1]


@pytest.mark.parametrize(("view", "most"), [("causal", (0.25, 0.45)), ("smooth", (0.9, 1.0))])
@pytest.mark.parametrize(("bits", "rate", "flywheel"), [(12, 500.0, 0.4), (14, 1000.0, 0.4), *more((13, 500.0, 1.0))])
def test_steps_of_the_needles_force(
    bits: int, rate: float, flywheel: float, view: str, most: tuple[float, float]
) -> None:
    """Tufting machine: orders without end; those beyond the model are in the sigmas."""
    ours, book, sigmas = _errors("tufting", flywheel, bits, rate, 1, view, 10.0)
    assert np.all(_rms(ours) < np.array(most) * _rms(book))
    inside = np.mean(np.abs(ours) < sigmas, axis=0)
    assert np.all((inside > 0.5) & (inside < 0.95)), inside
