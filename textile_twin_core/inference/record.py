"""A record as the inference reads it: torque samples of the turning shaft, its motion, and readings at standstill."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray

MOST_SAMPLES = 12_000
"""Samples of the turning shaft that a fit takes; of longer records it takes so many, evenly."""


class RecordedMotion(Protocol):
    """The shaft's motion over time."""

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Angle [rad], speed [rad/s] and acceleration [rad/s^2] at times (m,), and where they can be used."""
        ...


@dataclass(frozen=True)
class Standstill:
    """What the torque sensor shows while the shaft stands still: time [s], torque and its standard deviation [N m]."""

    time_s: float
    torque_Nm: float
    sigma_Nm: float


@dataclass(frozen=True)
class Record:
    """Torque samples (m,) of the turning shaft beside its motion.

    Attributes:
        time_s: of the samples. torque_Nm: measured.
        motion: the shaft's motion, before the encoder's direction and zero.
        middle_s: of the time in which the shaft turns, about which a drift of the clocks counts.
        speed_rad_s: working speed with its sign. slow_rad_s: below it the shaft counts as standing.
        standstills: readings of the standing shaft.
        one_speed: whole turns are so alike in speed that a delay looks like a zero of the encoder.
        speed_controlled: the torque falls as the speed rises, so that a delay looks like an inertia.
        block_s: width of the means in which residuals are weighed; 0: each sample counts by itself.
    """

    time_s: FloatArray
    torque_Nm: FloatArray
    motion: RecordedMotion
    middle_s: float
    speed_rad_s: float
    slow_rad_s: float
    standstills: tuple[Standstill, ...] = ()
    one_speed: bool = False
    speed_controlled: bool = False
    block_s: float = 0.0

    def thinned(self, most: int) -> Record:
        """The same with at most that many samples, each by itself."""
        if self.time_s.size <= most:
            return self
        k = np.linspace(0, self.time_s.size - 1, most).astype(np.int64)
        return replace(self, time_s=self.time_s[k], torque_Nm=self.torque_Nm[k], block_s=0.0)

    def near_speed(self, share: float, most: int) -> Record:
        """The same with samples within a share of the working speed."""
        omega = self.motion.at(self.time_s)[1]
        near = np.flatnonzero(np.abs(np.abs(omega) - abs(self.speed_rad_s)) < share * abs(self.speed_rad_s))
        return replace(self, time_s=self.time_s[near], torque_Nm=self.torque_Nm[near], block_s=0.0).thinned(most)
