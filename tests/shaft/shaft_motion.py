"""Motions of a shaft under known torques, integrated finely: the truth of the kinds in `kinds`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit


@dataclass(frozen=True)
class ShaftMotion:
    """alpha = pull (target - omega) + (target' - pull ...) + push + omega |omega| ripple(theta): solved on a fine grid.

    Attributes:
        dt_s: step of the grid, which begins at time 0.
        push: (n,) disturbance of the acceleration at the grid's times [rad/s^2], linear between them.
        target: (n,) speed that the drive holds [rad/s], linear between the grid's times.
        pull: how hard it holds it [1/s].
        waves: (m, 3) order, relative amplitude of the speed's ripple, phase: it grows with the square of the speed.
        depth: (n,) factor on the ripple, linear between the grid's times.
        theta, omega: (n,) the solution at the grid's times.
    """

    dt_s: float
    push: np.ndarray
    target: np.ndarray
    pull: float
    waves: np.ndarray
    depth: np.ndarray
    theta: np.ndarray
    omega: np.ndarray

    @classmethod
    def solve(
        cls, dt_s: float, push: np.ndarray, target: np.ndarray, pull: float, waves: np.ndarray, depth: np.ndarray,
        theta0: float,
    ) -> ShaftMotion:  # fmt: skip
        """From rest relative to the target at theta0, one Runge-Kutta step a grid interval."""
        waves = np.asarray(waves, dtype=np.float64).reshape(-1, 3)
        theta, omega = _solve(dt_s, push, target, pull, waves, depth, theta0)
        return cls(dt_s, push, target, pull, waves, depth, theta, omega)

    @property
    def duration_s(self) -> float:
        """The last time of the grid."""
        return (self.push.size - 1) * self.dt_s

    def at(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """theta, omega, alpha at any times within the grid."""
        return _at(  # type: ignore[no-any-return]
            np.asarray(time_s, dtype=np.float64), self.dt_s, self.push, self.target, self.pull, self.waves, self.depth,
            self.theta, self.omega,
        )  # fmt: skip

    def passes(self, angle_rad: np.ndarray) -> np.ndarray:
        """The times at which the shaft, which only runs forward, passes these angles (which rise)."""
        return _passes(  # type: ignore[no-any-return]
            np.asarray(angle_rad, dtype=np.float64), self.dt_s, self.push, self.target, self.pull, self.waves,
            self.depth, self.theta, self.omega,
        )  # fmt: skip


@njit(cache=True)
def _alpha(x, i, theta, omega, dt, push, target, pull, waves, depth):  # type: ignore[no-untyped-def]
    """The acceleration x of an interval after grid time i."""
    ripple = 0.0
    for k in range(waves.shape[0]):
        ripple -= waves[k, 0] * waves[k, 1] * np.sin(waves[k, 0] * theta + waves[k, 2])
    deep = depth[i] + x * (depth[i + 1] - depth[i])
    goal = target[i] + x * (target[i + 1] - target[i])
    rise = (target[i + 1] - target[i]) / dt
    return rise + pull * (goal - omega) + push[i] + x * (push[i + 1] - push[i]) + deep * omega * abs(omega) * ripple


@njit(cache=True)
def _advance(y, i, theta, omega, dt, push, target, pull, waves, depth):  # type: ignore[no-untyped-def]
    """Classical Runge-Kutta over the first y of interval i."""
    h = y * dt
    a1 = _alpha(0.0, i, theta, omega, dt, push, target, pull, waves, depth)
    w2 = omega + 0.5 * h * a1
    a2 = _alpha(0.5 * y, i, theta + 0.5 * h * omega, w2, dt, push, target, pull, waves, depth)
    w3 = omega + 0.5 * h * a2
    a3 = _alpha(0.5 * y, i, theta + 0.5 * h * w2, w3, dt, push, target, pull, waves, depth)
    w4 = omega + h * a3
    a4 = _alpha(y, i, theta + h * w3, w4, dt, push, target, pull, waves, depth)
    return theta + h / 6 * (omega + 2 * w2 + 2 * w3 + w4), omega + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


@njit(cache=True)
def _solve(dt, push, target, pull, waves, depth, theta0):  # type: ignore[no-untyped-def]
    n = push.size
    theta, omega = np.empty(n), np.empty(n)
    theta[0], omega[0] = theta0, target[0]
    for i in range(n - 1):
        theta[i + 1], omega[i + 1] = _advance(
            1.0, i, theta[i], omega[i], dt, push, target, pull, waves, depth
        )  # fmt: skip
    return theta, omega


@njit(cache=True)
def _at(times, dt, push, target, pull, waves, depth, grid_theta, grid_omega):  # type: ignore[no-untyped-def]
    theta, omega, alpha = np.empty(times.size), np.empty(times.size), np.empty(times.size)
    for j in range(times.size):
        i = min(max(int(times[j] / dt), 0), push.size - 2)
        y = times[j] / dt - i
        theta[j], omega[j] = _advance(
            y, i, grid_theta[i], grid_omega[i], dt, push, target, pull, waves, depth
        )  # fmt: skip
        alpha[j] = _alpha(y, i, theta[j], omega[j], dt, push, target, pull, waves, depth)
    return theta, omega, alpha


@njit(cache=True)
def _passes(angles, dt, push, target, pull, waves, depth, grid_theta, grid_omega):  # type: ignore[no-untyped-def]
    times = np.empty(angles.size)
    i = 0
    for j in range(angles.size):
        while i < push.size - 2 and grid_theta[i + 1] < angles[j]:
            i += 1
        y = (angles[j] - grid_theta[i]) / (grid_theta[i + 1] - grid_theta[i])
        for _ in range(4):
            theta, omega = _advance(
                y, i, grid_theta[i], grid_omega[i], dt, push, target, pull, waves, depth
            )  # fmt: skip
            y += (angles[j] - theta) / (omega * dt)
        times[j] = (i + y) * dt
    return times
