"""What is read of a recording's topics: angles, torques and points as arrays, each with its stamps."""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.stamp_timing import StampTiming


@dataclass(frozen=True)
class AngleSamples:
    """Angles of one joint in the order recorded; arrays of shape (n,).

    stamps: ns, from the message headers; for Float64, which has none, when recorded.
    velocities: rad/s, NaN where a message has none; None when no message has one.
    timing: how the stamps come in bursts, where these are reconstructed times; None: as recorded.
    recorded_ns: the stamps as recorded, where these are reconstructed times.
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
