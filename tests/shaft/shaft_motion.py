"""Motions of a shaft under known torques, integrated finely: the truth of the kinds in `kinds`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np


class Law(NamedTuple):
    """alpha = target' + pull (target - omega) + push - depth omega |omega| sum k a sin(k theta + phase).

    Attributes:
        dt_s: step of the time grid, which begins at 0.
        push: (n,) disturbance of the acceleration at the grid's times [rad/s^2], linear between them.
        target: (n,) speed that the drive holds [rad/s], linear between the grid's times.
        pull: how hard it holds it [1/s].
        waves: (m, 3) order k, relative amplitude a of the speed's ripple, phase.
        depth: (n,) factor on the ripple, linear between the grid's times.
    """

    dt_s: float
    push: np.ndarray
    target: np.ndarray
    pull: float
    waves: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True)
class ShaftMotion:
    """A law's solution: theta and omega, (n,) at the grid's times, one Runge-Kutta step apart."""

    law: Law
    theta: np.ndarray
    omega: np.ndarray

    @classmethod
    def solve(cls, law: Law, theta0: float) -> ShaftMotion:
        """Solve the motion from theta0 at the target's speed."""
        return cls(law, *_solve(law, theta0))

    @property
    def duration_s(self) -> float:
        """The last time of the grid."""
        return (self.law.push.size - 1) * self.law.dt_s

    def at(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """theta, omega, alpha at any times within the grid."""
        return _at(time_s, self.law, self.theta, self.omega)

    def passes(self, angle_rad: np.ndarray) -> np.ndarray:
        """The times at which the shaft, which only runs forward, passes these angles (which rise)."""
        return _passes(angle_rad, self.law, self.theta, self.omega)


@numba.njit(cache=True)
def _alpha(x: float, i: int, theta: float, omega: float, law: Law) -> float:
    """The acceleration at the share x of the interval after grid time i."""
    ripple = 0.0
    for k in range(law.waves.shape[0]):
        ripple -= law.waves[k, 0] * law.waves[k, 1] * np.sin(law.waves[k, 0] * theta + law.waves[k, 2])
    deep = law.depth[i] + x * (law.depth[i + 1] - law.depth[i])
    push = law.push[i] + x * (law.push[i + 1] - law.push[i])
    rise = law.target[i + 1] - law.target[i]
    return float(
        rise / law.dt_s + law.pull * (law.target[i] + x * rise - omega) + push + deep * omega * abs(omega) * ripple
    )


@numba.njit(cache=True)
def _advance(y: float, i: int, theta: float, omega: float, law: Law) -> tuple[float, float]:
    """The classical Runge-Kutta step over the first share y of interval i."""
    h = y * law.dt_s
    a1 = _alpha(0.0, i, theta, omega, law)
    w2 = omega + 0.5 * h * a1
    a2 = _alpha(0.5 * y, i, theta + 0.5 * h * omega, w2, law)
    w3 = omega + 0.5 * h * a2
    a3 = _alpha(0.5 * y, i, theta + 0.5 * h * w2, w3, law)
    w4 = omega + h * a3
    a4 = _alpha(y, i, theta + h * w3, w4, law)
    return theta + h / 6 * (omega + 2 * w2 + 2 * w3 + w4), omega + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


@numba.njit(cache=True)
def _solve(law: Law, theta0: float) -> tuple[np.ndarray, np.ndarray]:
    n = law.push.size
    theta, omega = np.empty(n), np.empty(n)
    theta[0], omega[0] = theta0, law.target[0]
    for i in range(n - 1):
        theta[i + 1], omega[i + 1] = _advance(1.0, i, theta[i], omega[i], law)
    return theta, omega


@numba.njit(cache=True)
def _at(
    times: np.ndarray, law: Law, grid_theta: np.ndarray, grid_omega: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    theta, omega, alpha = np.empty(times.size), np.empty(times.size), np.empty(times.size)
    for j in range(times.size):
        i = min(max(int(times[j] / law.dt_s), 0), law.push.size - 2)
        y = times[j] / law.dt_s - i
        theta[j], omega[j] = _advance(y, i, grid_theta[i], grid_omega[i], law)
        alpha[j] = _alpha(y, i, theta[j], omega[j], law)
    return theta, omega, alpha


def rippling(clock: np.ndarray, rate: np.ndarray | float, bend: np.ndarray | float, ripple: float) -> np.ndarray:
    """Angle, speed and acceleration (3, n) of a shaft with theta - ripple sin(theta) = clock.

    `clock` (n,) has the speed `rate` and the acceleration `bend`; by fixed-point iteration, for ripples of up to 0.3.
    """
    theta = clock.copy()
    for _ in range(60):
        theta = clock + ripple * np.sin(theta)
    slope = 1.0 - ripple * np.cos(theta)
    omega = rate / slope
    return np.stack([theta, omega, (bend - omega**2 * ripple * np.sin(theta)) / slope])


@numba.njit(cache=True)
def _passes(angles: np.ndarray, law: Law, grid_theta: np.ndarray, grid_omega: np.ndarray) -> np.ndarray:
    times = np.empty(angles.size)
    i = 0
    for j in range(angles.size):
        while i < law.push.size - 2 and grid_theta[i + 1] < angles[j]:
            i += 1
        y = (angles[j] - grid_theta[i]) / (grid_theta[i + 1] - grid_theta[i])
        for _ in range(4):  # Newton: three are enough for the last digit
            theta, omega = _advance(y, i, grid_theta[i], grid_omega[i], law)
            y += (angles[j] - theta) / (omega * law.dt_s)
        times[j] = (i + y) * law.dt_s
    return times
