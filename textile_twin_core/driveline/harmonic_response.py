"""Torque of an elastic shaft at uniform speed, order by order, as response of its linearised chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import ComplexArray, FloatArray
from textile_twin_core.driveline.chain import ElasticShaft
from textile_twin_core.driveline.resonances import natural_frequencies, needed_by_power


@dataclass(frozen=True)
class HarmonicResponse:
    """Response of a chain to the orders of its own torque, for any common factor of its stiffnesses.

    The inertia of a linkage counts with its mean over the turn, and the drive's torque is constant.

    Attributes:
        first_Hz: lowest natural frequency at the factor 1, undamped.
    """

    first_Hz: float
    _frequencies: FloatArray
    _twist: FloatArray
    _forces: ComplexArray
    _damping_ratio: float

    def elastic(self, omega_rad_s: float, orders: int, factors: FloatArray) -> ComplexArray:
        """(factors, orders) amplitudes of the sensor's torque from order 1 on, at factors of the stiffness [N m]."""
        natural = 2.0 * np.pi * self._frequencies * np.sqrt(factors)[:, None]
        order = np.arange(1, orders + 1)
        forced = order[:, None] * omega_rad_s / natural[:, None, :]
        amplified = 1.0 / (1.0 - forced**2 + 2j * self._damping_ratio * forced)
        forces = _at_speed(self._forces, omega_rad_s)[1 : orders + 1] * self._twist
        return np.asarray((amplified * forces).sum(axis=2))


def harmonic_response(elastic: ElasticShaft, drive_inertia_kgm2: float, damping_ratio: float) -> HarmonicResponse:
    """Prepare the response of a shaft.

    Args:
        elastic: The shaft, from `elastic_shaft`.
        drive_inertia_kgm2: Inertia added at the drive's station [kg m^2].
        damping_ratio: Of every mode.

    Returns:
        The response in the torque of the piece whose torque the sensor shows.

    References:
        Genta (2009), Vibration Dynamics and Control, chapter 9: modal response of an undamped chain.
    """
    shaft, inertia = elastic.shaft, elastic.mean_inertia_kgm2.copy()
    inertia[shaft.drive_station] += drive_inertia_kgm2
    frequencies, modes = natural_frequencies(inertia, elastic.chain.stiffness)
    piece, sign = shaft.torque_piece
    needed = needed_by_power(elastic)
    amplitudes = 2.0 * np.fft.rfft(needed, axis=2) / needed.shape[2]
    twist = elastic.chain.stiffness[piece] * (modes[piece] - modes[piece + 1])
    per_mode = -sign * twist / (2.0 * np.pi * frequencies) ** 2 / elastic.ratios[piece + 1]
    forces = np.einsum("psk,sm->pkm", amplitudes, modes)
    return HarmonicResponse(float(frequencies[0]), frequencies, per_mode, forces, damping_ratio)


def _at_speed(by_power: ComplexArray, omega_rad_s: float) -> ComplexArray:
    return np.asarray(by_power[0] + omega_rad_s * (by_power[1] + omega_rad_s * by_power[2]))
