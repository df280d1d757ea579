"""Samples of the topics of a recording: angles, torques and points as arrays with stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from textile_twin_core.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from textile_twin_core.comparison.stamp_timing import StampTiming


@dataclass(frozen=True)
class AngleSamples:
    """Angles of one joint in the order recorded; arrays of shape (n,).

    Attributes:
        topic: Topic of the angles.
        stamps: Stamps of the message headers [ns]; for Float64, which has none, times of recording.
        angles_rad: Angles [rad].
        velocities: Speeds [rad/s], NaN where a message has none; None if no message has one.
        timing: Bursts of the stamps, if `stamps` are reconstructed times; None otherwise.
        recorded_ns: Stamps as recorded, if `stamps` are reconstructed times; None otherwise.
    """

    topic: str
    stamps: IntArray
    angles_rad: FloatArray
    velocities: FloatArray | None
    timing: StampTiming | None = None
    recorded_ns: IntArray | None = None

    def __len__(self) -> int:
        return len(self.stamps)


@dataclass(frozen=True)
class TorqueSamples:
    """Torques about the shaft in the order recorded; arrays of shape (n,). Stamps and timing as in AngleSamples."""

    topic: str
    stamps: IntArray
    torque_Nm: FloatArray
    timing: StampTiming | None = None

    def __len__(self) -> int:
        return len(self.stamps)


@dataclass(frozen=True)
class PointSamples:
    """Points in the order recorded: stamps (n,) in ns, points_m (n, 3)."""

    topic: str
    stamps: IntArray
    points_m: FloatArray

    def __len__(self) -> int:
        return len(self.stamps)
