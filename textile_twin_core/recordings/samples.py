"""Samples of the topics of a recording: angles, torques and points as arrays with stamps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray

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
        recorded_ns: Stamps as recorded, if `stamps` are reconstructed or continued ones; None otherwise.
        notes: Corrections on reading, for people.

    Examples:
        >>> from textile_twin_core.recordings import open_bag
        >>> angle = open_bag("bags/tufting_160rpm_synthetic").read_angles("main_shaft/angle")
        >>> angle.stamps.shape == angle.angles_rad.shape
        True
    """

    topic: str
    stamps: IntArray
    angles_rad: FloatArray
    velocities: FloatArray | None
    timing: StampTiming | None = None
    recorded_ns: IntArray | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps)


@dataclass(frozen=True)
class TorqueSamples:
    """Torques about the shaft in the order recorded; arrays of shape (n,).

    Attributes:
        topic: Topic of the torques.
        stamps: Stamps of the message headers [ns].
        torque_Nm: Torques [N m].
        timing, recorded_ns, notes: As in AngleSamples.

    Examples:
        >>> from textile_twin_core.recordings import open_bag
        >>> open_bag("bags/tufting_160rpm_synthetic").read_torques("balancing_torque/measured").torque_Nm.size
        22775
    """

    topic: str
    stamps: IntArray
    torque_Nm: FloatArray
    timing: StampTiming | None = None
    recorded_ns: IntArray | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps)

    def rows(self, here: BoolArray) -> TorqueSamples:
        """Return the samples of a mask (n,)."""
        recorded = None if self.recorded_ns is None else self.recorded_ns[here]
        return replace(self, stamps=self.stamps[here], torque_Nm=self.torque_Nm[here], recorded_ns=recorded)


@dataclass(frozen=True)
class PointSamples:
    """Points in the order recorded: stamps (n,) in ns, points_m (n, 3)."""

    topic: str
    stamps: IntArray
    points_m: FloatArray

    def __len__(self) -> int:
        return len(self.stamps)
