"""The shaft's own clock: the integral over the angle of 1/(1 + ripple), in which a rippled shaft turns evenly."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN

GRID = 2048


class Clock:
    """Psi(theta), the integral of 1/(1 + h), and its derivatives by the ripple's coefficients, as periodic tables."""

    def __init__(self, orders: IntArray, coefficients: FloatArray) -> None:
        angle = np.linspace(0.0, TURN, GRID + 1)
        self.orders, self.coefficients = orders, coefficients
        wave = wave_basis(angle, orders)
        speed = np.maximum(1.0 + wave @ coefficients, 0.2)
        columns = np.concatenate([1.0 / speed[:, None], -wave / (speed**2)[:, None]], axis=1)[:-1]
        spectrum = np.fft.rfft(columns, axis=0)
        k = np.arange(spectrum.shape[0])
        self.mean = spectrum[0].real / GRID
        spectrum[0] = 0.0
        spectrum[1:] /= 1j * k[1:, None]
        table = np.fft.irfft(spectrum, GRID, axis=0)
        self._angle = angle
        self._table = np.concatenate([table, table[:1]])

    def __call__(self, theta: FloatArray) -> FloatArray:
        """(n, 1 + coefficients): Psi, and its derivative by each coefficient."""
        phase = np.mod(theta, TURN)
        out: FloatArray = theta[:, None] * self.mean
        for j in range(self._table.shape[1]):
            out[:, j] += np.interp(phase, self._angle, self._table[:, j])
        return out

    def ripple(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n,) 1 + h, h', h''."""
        c, s = self.coefficients[0::2], self.coefficients[1::2]
        k = self.orders
        cos, sin = np.cos(np.outer(theta, k)), np.sin(np.outer(theta, k))
        wave, turned = cos * c + sin * s, cos * s - sin * c
        return 1.0 + wave.sum(1), turned @ k, -(wave @ (k * k))

    def theta(self, psi: FloatArray, guess: FloatArray) -> FloatArray:
        """The angle whose Psi is psi, by Newton's steps from a guess."""
        theta = guess
        for _ in range(4):
            theta = theta + (psi - self(theta)[:, 0]) * self.ripple(theta)[0]
        return theta


def wave_basis(theta: FloatArray, orders: IntArray) -> FloatArray:
    """(n, 2 orders): cos, sin of each order, alternating."""
    arguments = np.outer(theta, orders)
    return np.stack([np.cos(arguments), np.sin(arguments)], axis=2).reshape(theta.size, -1)


def motion_gradient(v: FloatArray, u: FloatArray, value: FloatArray, slope: FloatArray, bend: FloatArray) -> FloatArray:
    """(n, 3, 3) derivative of (theta, omega, alpha) by (psi, psi', psi'') at fixed ripple."""
    out = np.zeros((v.size, 3, 3))
    out[:, 0, 0] = value
    out[:, 1, 0] = v * slope * value
    out[:, 1, 1] = value
    out[:, 2, 0] = (u * slope + v * v * (slope * slope + value * bend)) * value
    out[:, 2, 1] = 2.0 * v * value * slope
    out[:, 2, 2] = value
    return out
