"""Comparison of shaft states with the truth: errors and sigmas of the states and of the resulting torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.shaft.shaft_signal import ShaftSignal
from tests.shaft.tufting_torque import TuftingTorque
from textile_twin_core.shaft import SampleReport, ShaftStates, create_estimator

TORQUE = TuftingTorque()


@dataclass
class Judgement:
    """Errors from `after_s` on.

    Attributes:
        torque_rms: RMS error of the smooth torque [N m].
        errors: (n, 4) of theta, omega, alpha, torque.
        sigmas: (n, 4) as reported.
    """

    torque_rms: float
    errors: np.ndarray
    sigmas: np.ndarray
    states: ShaftStates
    report: SampleReport

    @property
    def inside(self) -> np.ndarray:
        """Share of samples whose truth lies within one sigma: theta, omega, alpha, torque."""
        return np.mean(np.abs(self.errors) <= self.sigmas, axis=0)


def estimate(name: str, signal: ShaftSignal, **settings: object) -> tuple[ShaftStates, SampleReport]:
    """All states of a signal."""
    estimator = create_estimator(name, **settings)
    parts = [estimator.step(signal.stamps_ns, signal.angles), estimator.finish()]
    return ShaftStates.join([part for part in parts if len(part)]), estimator.report


def judge(name: str, signal: ShaftSignal, after_s: float = 2.0, **settings: object) -> Judgement:
    """Estimate and compare."""
    states, report = estimate(name, signal, **settings)
    theta, omega, alpha = signal.theta[states.index], signal.omega[states.index], signal.alpha[states.index]
    turns = np.round((states.theta_rad - theta) / (2 * np.pi))
    now = states.theta_rad - turns * 2 * np.pi, states.omega_rad_s, states.alpha_rad_s2
    torque_error = TORQUE(*now) - TORQUE(theta, omega, alpha)
    torque_sigma = np.sqrt(states.variance_of(TORQUE.gradient(*now)))
    late = signal.time[states.index] > after_s
    errors = np.stack([now[0] - theta, now[1] - omega, now[2] - alpha, torque_error], axis=1)[late]
    sigmas = np.concatenate([states.sigma, torque_sigma[:, None]], axis=1)[late]
    return Judgement(float(np.sqrt(np.mean(errors[:, 3] ** 2))), errors, sigmas, states, report)
