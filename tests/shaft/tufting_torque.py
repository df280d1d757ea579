"""Smooth torque of the tufting machine, written down a second time from the paper's Table 1, for judging shaft states.

Positions of every centroid are evaluated on a periodic grid straight from the loop closure and differentiated
spectrally (FFT), so that this shares neither formulas nor code with the engine.
"""

from __future__ import annotations

import numpy as np

GRAVITY = 9.81
NODES = 1024


def _continuous_angle(direction: np.ndarray) -> np.ndarray:
    return np.unwrap(np.angle(direction))


class TuftingTorque:
    """J, J'/2 and V' of the needle linkage as Fourier series of the shaft angle (Xu et al. 2016, Table 1)."""

    def __init__(self) -> None:
        t1 = 2 * np.pi * np.arange(NODES) / NODES
        l1, l2, l3, l4, l5, l6 = 0.015, 0.138, 0.115, 0.125, 0.120, 0.440
        x1, x2, h1 = 0.070, 0.100, 0.155
        a = l1 * np.exp(1j * t1)
        c = np.full(NODES, x1 + 1j * h1)
        reach = np.abs(c - a)
        along = (l2**2 - l3**2 + reach**2) / (2 * reach)
        across = np.sqrt(l2**2 - along**2)
        axis = (c - a) / reach
        b = a + axis * (along + 1j * across)  # B on the left of A -> C
        t4 = _continuous_angle(b - c) + np.deg2rad(168.0)
        d = c + l4 * np.exp(1j * t4)
        # the needle bar runs on the line x = x1 + x2, below D
        guide = x1 + x2
        e = guide + 1j * (d.imag - np.sqrt(l5**2 - (guide - d.real) ** 2))
        bar = e - 1j * l6 / 2
        bodies = (
            (3.07, 4.34e-3, a / 2, _continuous_angle(a)),
            (3.79, 26.99e-3, (a + b) / 2, _continuous_angle(b - a)),
            (2.96, 10.77e-3, (b + c) / 2, _continuous_angle(b - c)),
            (1.74, 6.69e-3, (c + d) / 2, t4),
            (0.36, 0.91e-3, (d + e) / 2, _continuous_angle(e - d)),
            (1.47, 0.0, bar, np.zeros(NODES)),
        )
        inertia = np.zeros(NODES)
        potential = np.zeros(NODES)
        for mass, moment, centre, angle in bodies:
            turns = round((angle[-1] - angle[0]) / (2 * np.pi))
            rate = self._slope(angle - turns * t1) + turns
            speed = self._slope(centre.real) + 1j * self._slope(centre.imag)
            inertia += mass * np.abs(speed) ** 2 + moment * rate**2
            potential += mass * GRAVITY * centre.imag
        self.inertia = inertia
        self.stroke = float(np.ptp(e.imag))
        self.needle_y = e.imag - l6
        self._series = [np.fft.rfft(f) / NODES for f in (inertia, self._slope(inertia) / 2, self._slope(potential))]

    @staticmethod
    def _slope(values: np.ndarray) -> np.ndarray:
        spectrum = np.fft.rfft(values)
        orders = np.arange(spectrum.size)
        spectrum[-1] = 0
        return np.fft.irfft(1j * orders * spectrum, NODES)

    def terms(self, theta: np.ndarray) -> list[np.ndarray]:
        """J, J'/2 and V' at the given angles."""
        theta = np.atleast_1d(theta)
        out = []
        for series in self._series:
            value = np.full(theta.shape, series[0].real)
            for k in range(1, 31):
                value += 2 * (series[k].real * np.cos(k * theta) - series[k].imag * np.sin(k * theta))
            out.append(value)
        return out

    def __call__(self, theta: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        inertia, half_slope, gravity = self.terms(theta)
        return inertia * alpha + half_slope * omega**2 + gravity

    def gradient(self, theta: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """d torque / d (theta, omega, alpha), shape (n, 3)."""
        step = 1e-5
        inertia, half_slope, _ = self.terms(theta)
        along = (self(theta + step, omega, alpha) - self(theta - step, omega, alpha)) / (2 * step)
        return np.stack([along, 2 * half_slope * omega, inertia], axis=-1)
