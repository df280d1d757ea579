"""Sensors on the shaft, and the scene to model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MachineError
from textile_twin_core.machine.eccentricity import Eccentricity

ENCODER_OPTIONS: Mapping[str, str] = {
    "teeth": "samples are edges of a wheel with this number of teeth a turn, missing ones included",
    "missing_teeth": "of these, how many are missing in the one gap before tooth 0",
    "cycle_turns": "turns of the shaft after which its motion repeats: 2 for half orders",
    "resolution_rad": "step of the encoder's angle in rad, estimated from the samples where it is not known",
    "stamp_jitter_s": "standard deviation of the stamps in s, estimated from the samples where it is not known "
    "(0.3 of the cycle of a controller that is polled)",
}
"""Encoder settings that commands and nodes may override, with their descriptions."""


_Torque = TypeVar("_Torque", float, FloatArray)
_LARGEST_OF_PITCH = 0.4
"""Largest periodic error of a toothed wheel, in pitches, with which an angle still shows its tooth."""


@dataclass(frozen=True)
class Encoder:
    """Relation of measured and shaft angle: shaft = (q - zero) * direction * ratio, q = measured - e(q).

    q is the true angle of the encoder and e its periodic error (see `Eccentricity`), zero unless declared.

    Attributes:
        zero_rad, direction, ratio: zero [rad], sign and ratio of the relation.
        eccentricity_rad: cosine and sine coefficient [rad] of the error once per turn of the encoder, and a second
            pair for twice per turn: e = c1 cos q + s1 sin q + c2 cos 2q + s2 sin 2q.
        resolution_rad: step of the measured angle [rad]; None to estimate it.
        stamp_jitter_s: standard deviation of the stamps [s]; None to estimate it.
        teeth: teeth per turn of a wheel whose edges are sampled, missing ones included; 0 for sampled angles.
        missing_teeth: number of missing teeth in the gap before tooth 0.
        pitch_errors_rad: deviation of each tooth's edge from its nominal angle [rad]; None if unknown.
        cycle_turns: turns of the shaft after which its motion repeats.

    Raises:
        MachineError: for impossible values.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.tufting(encoder_zero_rad=0.1).sensors.encoder.zero_rad
        0.1
    """

    zero_rad: float = 0.0
    direction: int = 1
    ratio: float = 1.0
    eccentricity_rad: tuple[tuple[float, float], ...] = ()
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
        size = Eccentricity(self.eccentricity_rad).largest_rad
        if self.teeth and size > _LARGEST_OF_PITCH * 2.0 * math.pi / self.teeth:
            raise MachineError(
                f"encoder: an eccentricity_rad of {size:.3g} rad leaves the teeth of this wheel uncertain; give it as"
                " pitch_errors_rad"
            )

    @cached_property
    def _eccentricity(self) -> Eccentricity | None:
        return Eccentricity(self.eccentricity_rad) if any(map(any, self.eccentricity_rad)) else None

    @property
    def is_corrected(self) -> bool:
        """True where readings are corrected for a periodic error."""
        return self._eccentricity is not None

    @property
    def factor(self) -> float:
        """Turns of the shaft per turn of the encoder, negative where they count against each other."""
        return self.direction * self.ratio

    def shaft_angle(self, measured_rad: npt.ArrayLike) -> FloatArray:
        """Convert measured angles (n,), wrapped or not, to angles of the shaft [rad]."""
        return (self.true_angle(measured_rad) - self.zero_rad) * self.factor

    def shaft_reading(self, measured_rad: float, measured_rad_s: float) -> tuple[float, float]:
        """Convert one measured angle and speed (NaN: none) to those of the shaft, without the cost of arrays."""
        if self._eccentricity is not None:
            measured_rad = self._eccentricity.one_true_angle(measured_rad)
            if not math.isnan(measured_rad_s):
                measured_rad_s /= self._eccentricity.slope_at(measured_rad)
        return (measured_rad - self.zero_rad) * self.factor, measured_rad_s * self.factor

    def shaft_speed(self, measured_rad: npt.ArrayLike, measured_rad_s: npt.ArrayLike) -> FloatArray:
        """Convert measured speeds (n,) to speeds of the shaft [rad/s], given the angles measured with them."""
        return self.true_speed(measured_rad, measured_rad_s) * self.factor

    def true_angle(self, measured_rad: npt.ArrayLike) -> FloatArray:
        """Correct measured angles (n,) for the periodic error; still those of the encoder, with its zero [rad]."""
        measured = np.asarray(measured_rad, dtype=np.float64)
        return measured if self._eccentricity is None else self._eccentricity.true_angle(measured)

    def true_speed(self, measured_rad: npt.ArrayLike, measured_rad_s: npt.ArrayLike) -> FloatArray:
        """Correct measured speeds (n,) for the periodic error; still those of the encoder [rad/s]."""
        speed = np.asarray(measured_rad_s, dtype=np.float64)
        if self._eccentricity is None or speed.shape != np.shape(measured_rad):  # which the estimator refuses
            return speed
        return np.asarray(speed / (1.0 + self._eccentricity.error(self.true_angle(measured_rad))[1]))

    def measured_angle(self, shaft_rad: npt.ArrayLike) -> FloatArray:
        """Convert unwrapped angles of the shaft (n,) to the angles that the encoder measures [rad]."""
        true = np.asarray(shaft_rad, dtype=np.float64) / self.factor + self.zero_rad
        return true if self._eccentricity is None else self._eccentricity.reading(true)

    def measured_speed(self, shaft_rad: npt.ArrayLike, shaft_rad_s: npt.ArrayLike) -> FloatArray:
        """Convert speeds of the shaft (n,) to the speeds that the encoder measures [rad/s], given the angles."""
        speed = np.asarray(shaft_rad_s, dtype=np.float64) / self.factor
        if self._eccentricity is None:
            return speed
        true = np.asarray(shaft_rad, dtype=np.float64) / self.factor + self.zero_rad
        return speed * (1.0 + self._eccentricity.error(true)[1])

    def reading_at(self, shaft_rad: FloatArray) -> FloatArray:
        """Return the reading, as an angle of the shaft, behind corrected angles of the shaft (n,) [rad].

        The readings, not the corrected angles, are multiples of the encoder's step.
        """
        return self.measured_angle(shaft_rad) * self.ratio


@dataclass(frozen=True)
class TorqueSensor:
    """Relation of measured and true torque: measured(t) = gain * filtered(true)(t - delay) + offset.

    Attributes:
        gain: gain, negative for a reversed sensor.
        offset_Nm: offset [N m].
        delay_s: delay [s].
        low_pass_s: time constant of a first-order low pass [s]; 0 for none.
        low_pass_hz: corner of a low pass instead [Hz]; 0 for none.
        low_pass_order: order of the low pass with this corner: 1, or 2 for a Butterworth filter.
        high_pass_hz: corner of a first-order high pass, such as AC coupling [Hz]; 0 for none.

    Raises:
        MachineError: for impossible values.

    Examples:
        >>> from textile_twin_core.machine.sensors import TorqueSensor
        >>> TorqueSensor(gain=-1.0, delay_s=0.002).delay_s  # [s]
        0.002
    """

    gain: float = 1.0
    offset_Nm: float = 0.0
    delay_s: float = 0.0
    low_pass_s: float = 0.0
    low_pass_hz: float = 0.0
    low_pass_order: int = 1
    high_pass_hz: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain != 0 and math.isfinite(self.offset_Nm)):
            raise MachineError("torque sensor: gain must not be zero, and gain and offset_Nm finite")
        if not (math.isfinite(self.delay_s) and abs(self.delay_s) < 10.0):
            raise MachineError("torque sensor: delay_s must be a time in seconds below 10 s")
        if not 0.0 <= self.low_pass_s < 10.0:
            raise MachineError("torque sensor: low_pass_s must be a time in seconds below 10 s, or 0 for none")
        for name in ("low_pass_hz", "high_pass_hz"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise MachineError(f"torque sensor: {name} must be a positive frequency in Hz, or 0 for none")
        if self.low_pass_s and self.low_pass_hz:
            raise MachineError("torque sensor: give low_pass_s or low_pass_hz, not both")
        if self.low_pass_order not in (1, 2):
            raise MachineError(f"torque sensor: low_pass_order must be 1 or 2, not {self.low_pass_order!r}")
        if self.low_pass_order == 2 and not self.low_pass_hz:
            raise MachineError("torque sensor: low_pass_order 2 needs low_pass_hz, the corner of the filter")
        if self.high_pass_hz and self.low_pass_corner_hz and self.high_pass_hz >= self.low_pass_corner_hz:
            raise MachineError(
                f"torque sensor: high_pass_hz {self.high_pass_hz:g} must be below the low pass, whose corner is"
                f" {self.low_pass_corner_hz:.4g} Hz"
            )

    def reading(self, filtered_Nm: _Torque) -> _Torque:
        """Return what the sensor reads, its delay later, at a torque behind its filter [N m]: a number or an array."""
        return self.gain * filtered_Nm + self.offset_Nm

    @property
    def low_pass_corner_hz(self) -> float:
        """Corner of the low pass [Hz]; 0 for none."""
        return 1.0 / (2.0 * math.pi * self.low_pass_s) if self.low_pass_s else self.low_pass_hz


@dataclass(frozen=True)
class Sensors:
    """The sensors on the shaft.

    Attributes:
        encoder: encoder of the main shaft.
        torque: torque sensor.
        second_encoder: encoder at `second_encoder_at` of an elastic shaft.

    Examples:
        >>> from textile_twin_core.machine.sensors import Encoder, Sensors
        >>> Sensors(encoder=Encoder(zero_rad=0.1)).encoder.zero_rad  # [rad]
        0.1
    """

    encoder: Encoder = Encoder()
    torque: TorqueSensor = TorqueSensor()
    second_encoder: Encoder = Encoder()


@dataclass(frozen=True)
class Scene:
    """Request of a machine file.

    Attributes:
        outputs: names of the outputs.
        method: `exact`, `table` or `auto`.
        tolerance: error of a table over the output's peak.

    Examples:
        >>> from textile_twin_core.machine.sensors import Scene
        >>> Scene().outputs
        ('balancing_torque_Nm',)
    """

    outputs: tuple[str, ...] = ("balancing_torque_Nm",)
    method: Literal["exact", "table", "auto"] = "auto"
    tolerance: float = 1e-12

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < math.inf:
            raise MachineError(f"scene: tolerance must be a positive number, such as 1e-12, not {self.tolerance!r}")
