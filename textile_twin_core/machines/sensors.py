"""What a machine file says beside mechanics: the sensors on the shaft and the scene to model."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.errors import MachineError


@dataclass(frozen=True)
class Encoder:
    """How the measured angle relates to the shaft's: shaft = (measured - zero) * direction * ratio."""

    zero_rad: float = 0.0
    direction: int = 1
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if self.direction not in (1, -1):
            raise MachineError(f"encoder: direction must be 1 or -1, not {self.direction!r}")
        if not (math.isfinite(self.ratio) and self.ratio > 0 and math.isfinite(self.zero_rad)):
            raise MachineError("encoder: ratio must be positive and zero_rad finite")


@dataclass(frozen=True)
class TorqueSensor:
    """How the measured torque relates to the true one: measured(t) = gain * true(t - delay) + offset."""

    gain: float = 1.0
    offset_Nm: float = 0.0
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain != 0 and math.isfinite(self.offset_Nm)):
            raise MachineError("torque sensor: gain must not be zero, and gain and offset_Nm finite")
        if not (math.isfinite(self.delay_s) and abs(self.delay_s) < 10.0):
            raise MachineError("torque sensor: delay_s must be a time in seconds below 10 s")


@dataclass(frozen=True)
class Sensors:
    """The sensors on the shaft."""

    encoder: Encoder = Encoder()
    torque: TorqueSensor = TorqueSensor()


@dataclass(frozen=True)
class Scene:
    """What a machine file asks to model: outputs, method and tolerance."""

    outputs: tuple[str, ...] = ("balancing_torque_Nm",)
    method: str = "auto"
    tolerance: float = 1e-12
