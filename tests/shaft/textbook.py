"""The yardstick: a constant-acceleration Kalman filter and RTS smoother with noises of maximum likelihood.

State theta, omega, alpha; white jerk, discretised exactly; white reading noise (Bar-Shalom, Li, Kirubarajan 2001,
section 6.2.3; Rauch, Tung, Striebel 1965). The two noises, jerk intensity and reading variance, are those of greatest
likelihood on the very record: the reading variance in closed form, the ratio of the two by a search on its logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from scipy.optimize import minimize_scalar


@dataclass(frozen=True)
class Textbook:
    """States of the tuned filter and smoother.

    Attributes:
        causal, smooth: (n, 3) theta, omega, alpha.
        causal_covariance, smooth_covariance: (n, 3, 3).
        jerk: intensity of the white jerk [rad^2/s^5].
        reading_variance: of a reading [rad^2].
    """

    causal: np.ndarray
    causal_covariance: np.ndarray
    smooth: np.ndarray
    smooth_covariance: np.ndarray
    jerk: float
    reading_variance: float


def textbook(time_s: np.ndarray, angle_rad: np.ndarray) -> Textbook:
    """Tune on the record and estimate; angles unwrapped, stamps rising."""
    unit = float(np.median(np.diff(time_s)))
    h, z = np.diff(time_s) / unit, np.asarray(angle_rad - angle_rad[0], dtype=np.float64)

    def cost(log_ratio: float) -> float:
        return float(_deviance(h, z, 10.0**log_ratio)[0])

    grid = np.arange(-16.0, 4.1, 1.0)
    best = grid[int(np.argmin([cost(x) for x in grid]))]
    ratio = 10.0 ** minimize_scalar(cost, bounds=(best - 1.0, best + 1.0), method="bounded", options={"xatol": 0.01}).x
    variance = float(_deviance(h, z, ratio)[1])
    causal, causal_p, smooth, smooth_p = _run(h, z, ratio)
    scale = np.array([1.0, 1.0 / unit, 1.0 / unit**2])
    for states in (causal, smooth):
        states *= scale
        states[:, 0] += angle_rad[0]
    for covariance in (causal_p, smooth_p):
        covariance *= variance * np.outer(scale, scale)
    return Textbook(causal, causal_p, smooth, smooth_p, ratio * variance / unit**5, variance)


@numba.njit(cache=True)
def _predict(x: np.ndarray, p: np.ndarray, h: float, q: float) -> None:
    """One step of length h [samples] in place: x (3,), p (3, 3)."""
    x[0] += h * x[1] + 0.5 * h * h * x[2]
    x[1] += h * x[2]
    g = 0.5 * h * h
    for j in range(3):
        p[0, j] += h * p[1, j] + g * p[2, j]
        p[1, j] += h * p[2, j]
    for j in range(3):
        p[j, 0] += h * p[j, 1] + g * p[j, 2]
        p[j, 1] += h * p[j, 2]
    h2, h3 = h * h, h * h * h
    p[0, 0] += q * h3 * h2 / 20
    p[0, 1] += q * h2 * h2 / 8
    p[0, 2] += q * h3 / 6
    p[1, 1] += q * h3 / 3
    p[1, 2] += q * h2 / 2
    p[2, 2] += q * h
    p[1, 0], p[2, 0], p[2, 1] = p[0, 1], p[0, 2], p[1, 2]


@numba.njit(cache=True)
def _correct(x: np.ndarray, p: np.ndarray, z: float) -> tuple[float, float]:
    """A reading of unit variance in place (Joseph's form); innovation and its variance."""
    s = p[0, 0] + 1.0
    k0, k1, k2 = p[0, 0] / s, p[1, 0] / s, p[2, 0] / s
    innovation = z - x[0]
    x[0] += k0 * innovation
    x[1] += k1 * innovation
    x[2] += k2 * innovation
    for j in range(3):
        top = p[0, j]
        p[0, j] -= k0 * top
        p[1, j] -= k1 * top
        p[2, j] -= k2 * top
    for j in range(3):
        first = p[j, 0]
        p[j, 0] -= first * k0
        p[j, 1] -= first * k1
        p[j, 2] -= first * k2
    p[0, 0] += k0 * k0
    p[0, 1] += k0 * k1
    p[0, 2] += k0 * k2
    p[1, 1] += k1 * k1
    p[1, 2] += k1 * k2
    p[2, 2] += k2 * k2
    p[1, 0], p[2, 0], p[2, 1] = p[0, 1], p[0, 2], p[1, 2]
    return innovation, s


@numba.njit(cache=True)
def _begin(h: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = np.array([z[0], (z[1] - z[0]) / h[0], 0.0])
    p = np.zeros((3, 3))
    p[0, 0] = p[1, 1] = p[2, 2] = 1e6
    return x, p


@numba.njit(cache=True)
def _deviance(h: np.ndarray, z: np.ndarray, q: float) -> tuple[float, float]:
    """Minus twice the log likelihood, the reading variance profiled out, and that variance; 10 samples to settle."""
    x, p = _begin(h, z)
    logs, squares, used = 0.0, 0.0, 0
    for i in range(z.size):
        if i > 0:
            _predict(x, p, h[i - 1], q)
        innovation, s = _correct(x, p, z[i])
        if i >= 10:
            logs += np.log(s)
            squares += innovation * innovation / s
            used += 1
    variance = max(squares / used, 1e-18)
    return used * np.log(variance) + logs, variance


def _run(h: np.ndarray, z: np.ndarray, q: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    filtered, covariance, ahead, ahead_p = _filter(h, z, q)
    zero, one = np.zeros_like(h), np.ones_like(h)
    f = np.array([[one, h, 0.5 * h * h], [zero, one, h], [zero, zero, one]]).transpose(2, 0, 1)
    gain = np.linalg.solve(ahead_p[1:], f @ covariance[:-1]).transpose(0, 2, 1).copy()
    smooth, smooth_p = filtered.copy(), covariance.copy()
    _smooth(gain, ahead, ahead_p, smooth, smooth_p)
    return filtered, covariance, smooth, smooth_p


@numba.njit(cache=True)
def _filter(h: np.ndarray, z: np.ndarray, q: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return states and covariances after each reading, and those predicted before it."""
    n = z.size
    x, p = _begin(h, z)
    filtered, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
    ahead, ahead_p = np.empty((n, 3)), np.empty((n, 3, 3))
    for i in range(n):
        if i > 0:
            _predict(x, p, h[i - 1], q)
        _store(x, p, ahead, ahead_p, i)
        _correct(x, p, z[i])
        _store(x, p, filtered, covariance, i)
    return filtered, covariance, ahead, ahead_p


@numba.njit(cache=True)
def _store(x: np.ndarray, p: np.ndarray, states: np.ndarray, covariances: np.ndarray, i: int) -> None:
    for j in range(3):
        states[i, j] = x[j]
        for k in range(3):
            covariances[i, j, k] = p[j, k]


@numba.njit(cache=True)
def _smooth(gain: np.ndarray, ahead: np.ndarray, ahead_p: np.ndarray, smooth: np.ndarray, smooth_p: np.ndarray) -> None:
    """Turn filtered states and covariances into smoothed ones in place, from the last reading backwards.

    Written out by elements, as products and copies of whole arrays take seven seconds to compile.
    """
    more = np.empty((3, 3))
    for i in range(smooth.shape[0] - 2, -1, -1):
        for j in range(3):
            for k in range(3):
                smooth[i, j] += gain[i, j, k] * (smooth[i + 1, k] - ahead[i + 1, k])
                more[j, k] = 0.0
                for a in range(3):
                    for b in range(3):
                        less = smooth_p[i + 1, a, b] - ahead_p[i + 1, a, b]
                        more[j, k] += gain[i, j, a] * less * gain[i, k, b]
        for j in range(3):
            for k in range(3):
                smooth_p[i, j, k] += 0.5 * (more[j, k] + more[k, j])
