"""Sensors on the shaft, and the scene to model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from textile_twin_core.errors import MachineError

ENCODER_OPTIONS: Mapping[str, str] = {
    "teeth": "samples are edges of a wheel with so many teeth a turn, missing ones counted",
    "missing_teeth": "of these, how many are missing in the one gap before tooth 0",
    "cycle_turns": "turns of the shaft after which its motion repeats: 2 for half orders",
    "resolution_rad": "step of the encoder's angle in rad, estimated from the samples where it is not known",
    "stamp_jitter_s": "standard deviation of the stamps in s, estimated from the samples where it is not known "
    "(0.3 of the cycle of a controller that is polled)",
}
"""Encoder settings that commands and nodes may override, with their descriptions."""


@dataclass(frozen=True)
class Encoder:
    """Relation of measured and shaft angle: shaft = (measured - zero) * direction * ratio.

    Attributes:
        zero_rad, direction, ratio: zero [rad], sign and ratio of the relation.
        resolution_rad: step of the measured angle [rad]; None to estimate it.
        stamp_jitter_s: standard deviation of the stamps [s]; None to estimate it.
        teeth: teeth per turn of a wheel whose edges are sampled, missing ones included; 0 for sampled angles.
        missing_teeth: number of missing teeth in the gap before tooth 0.
        pitch_errors_rad: deviation of each tooth's edge from its nominal angle [rad]; None if unknown.
        cycle_turns: turns of the shaft after which its motion repeats.

    Raises:
        MachineError: for impossible values.

    Example:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.tufting(encoder_zero_rad=0.1).sensors.encoder.zero_rad
        0.1
    """

    zero_rad: float = 0.0
    direction: int = 1
    ratio: float = 1.0
    resolution_rad: float | None = None
    stamp_jitter_s: float | None = None
    teeth: int = 0
    missing_teeth: int = 0
    pitch_errors_rad: tuple[float, ...] | None = None
    cycle_turns: int = 1

    def __post_init__(self) -> None:
        if self.direction not in (1, -1):
            raise MachineError(f"encoder: direction must be 1 or -1, not {self.direction!r}")
        if not (math.isfinite(self.ratio) and self.ratio > 0 and math.isfinite(self.zero_rad)):
            raise MachineError("encoder: ratio must be positive and zero_rad finite")
        if self.resolution_rad is not None and not (math.isfinite(self.resolution_rad) and self.resolution_rad > 0):
            raise MachineError("encoder: resolution_rad must be a positive angle, or omitted to be estimated")
        if self.stamp_jitter_s is not None and not (math.isfinite(self.stamp_jitter_s) and self.stamp_jitter_s >= 0):
            raise MachineError("encoder: stamp_jitter_s must be a time of 0 or more, or omitted to be estimated")
        if self.teeth < 0 or self.cycle_turns < 1:
            raise MachineError("encoder: teeth must be 0 (none) or more, cycle_turns 1 or more")
        if not 0 <= self.missing_teeth <= max(self.teeth - 4, 0):
            raise MachineError("encoder: missing_teeth must be 0 or more, and leave 4 of the teeth")
        if self.pitch_errors_rad is not None and len(self.pitch_errors_rad) != self.teeth:
            raise MachineError(
                f"encoder: pitch_errors_rad has {len(self.pitch_errors_rad)} values for {self.teeth} teeth"
            )


@dataclass(frozen=True)
class TorqueSensor:
    """Relation of measured and true torque: measured(t) = gain * true(t - delay) + offset.

    Attributes:
        gain: gain, negative for a reversed sensor.
        offset_Nm: offset [N m].
        delay_s: delay [s].

    Raises:
        MachineError: for impossible values.
    """

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
    """The sensors on the shaft; `second_encoder` is the one at `second_encoder_at` of an elastic shaft."""

    encoder: Encoder = Encoder()
    torque: TorqueSensor = TorqueSensor()
    second_encoder: Encoder = Encoder()


@dataclass(frozen=True)
class Scene:
    """Request of a machine file: outputs, method and tolerance."""

    outputs: tuple[str, ...] = ("balancing_torque_Nm",)
    method: Literal["exact", "table", "auto"] = "auto"
    tolerance: float = 1e-12

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < math.inf:
            raise MachineError(f"scene: tolerance must be a positive number, such as 1e-12, not {self.tolerance!r}")
