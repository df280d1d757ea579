"""Record for the inference: torque samples of the turning shaft, its motion, and torques at standstill."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.inference.elastic_torque import LinearisedTorque

MOST_SAMPLES = 12_000
"""Most samples of the turning shaft in a fit; of longer records it takes this number, evenly."""


class RecordedMotion(Protocol):
    """The shaft's motion over time."""

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Angle [rad], speed [rad/s] and acceleration [rad/s^2] at times (m,), and a mask of the usable ones."""
        ...


@dataclass(frozen=True)
class Standstill:
    """Torque of the sensor at standstill: time [s], torque and its standard deviation [N m]."""

    time_s: float
    torque_Nm: float
    sigma_Nm: float


@dataclass(frozen=True)
class Ripple:
    """Ripple of the estimated motion by order of the turn, from 1 on; empty where it is unknown.

    Attributes:
        sigma_rad: (k,) standard deviation of its amplitude in the angle that the encoder's readings leave.
        swing_rad_s2: (k,) amplitude of the estimated acceleration.
    """

    sigma_rad: FloatArray = field(default_factory=lambda: np.empty(0))
    swing_rad_s2: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Record:
    """Torque samples (m,) of the turning shaft beside its motion.

    Attributes:
        time_s: of the samples. torque_Nm: measured.
        motion: the shaft's motion, before the encoder's direction and zero.
        middle_s: middle of the time in which the shaft turns, the origin of a drift of the clocks.
        speed_rad_s: working speed with its sign. slow_rad_s: speed below which the shaft stands still.
        standstills: torques at standstill.
        one_speed: true if whole turns have such similar speeds that a delay looks like a zero of the encoder.
        speed_controlled: true if the torque falls as the speed rises, so that a delay looks like an inertia.
        block_s: width of the block averages of residuals; 0: each sample counts by itself.
        shaft_per_encoder: turns of the motion's angle in a turn of the encoder.
        ripple: of the motion, and its uncertainty.
        predicted: torque of an elastic shaft, by its observer; None for a rigid one.
        step_Nm: to which the torque is rounded; 0 where it is not.
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
    shaft_per_encoder: float = 1.0
    ripple: Ripple = field(default_factory=lambda: Ripple())
    predicted: LinearisedTorque | None = None
    step_Nm: float = 0.0

    def thinned(self, most: int) -> Record:
        """Return a copy with at most `most` samples, each by itself."""
        if self.time_s.size <= most:
            return self
        k = np.linspace(0, self.time_s.size - 1, most).astype(np.int64)
        return replace(self, time_s=self.time_s[k], torque_Nm=self.torque_Nm[k], block_s=0.0)

    def near_speed(self, share: float, most: int) -> Record:
        """Return a copy with the samples within a share of the working speed."""
        omega = self.motion.at(self.time_s)[1]
        near = np.flatnonzero(np.abs(np.abs(omega) - abs(self.speed_rad_s)) < share * abs(self.speed_rad_s))
        return replace(self, time_s=self.time_s[near], torque_Nm=self.torque_Nm[near], block_s=0.0).thinned(most)
