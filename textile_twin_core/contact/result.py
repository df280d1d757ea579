"""What comes out of contact integration: segments with their power series, and events with their impulses."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.polynomials import rescale


class PadState(IntEnum):
    """A pad is not touched, pushes, or is touched but slack because the body leaves faster than it recovers."""

    OFF = 0
    PUSHING = 1
    SLACK = 2


@dataclass(frozen=True)
class ContactEvent:
    """Something that happens at one instant.

    kind is "impact" (a stop is hit), "rest" (the bounces on a stop have died out), "release" (a closed stop opens),
    "touch" / "leave" (a pad), "slack" / "push" (a touched pad lets go, takes hold again).
    """

    time_s: float
    """when it happens; for "rest" the end of the bounces, a moment after the instant that they are booked at"""
    kind: str
    name: str
    """the stop or pad"""
    bodies: tuple[str, str]
    """its lower and upper end"""
    booked_s: float
    approach_speed_m_s: float = 0.0
    impulse_Ns: float = 0.0
    energy_lost_J: float = 0.0
    drive_work_J: float = 0.0
    """work that the driven element does through this impulse"""


@dataclass(frozen=True)
class Segment:
    """A stretch of motion without event, each quantity a power series in u = (t - start) / span over 0 <= u <= 1."""

    start_s: float
    span_s: float
    positions: FloatArray
    """(movers, order+1) [m]: the bodies, then the driven element"""
    closed: tuple[int, ...]
    """numbers of the closed stops"""
    stop_forces: FloatArray
    """(closed stops, m) [N]"""
    pads: tuple[PadState, ...]
    pad_forces: FloatArray
    """(all pads, m) [N]"""

    @property
    def end_s(self) -> float:
        """Time of its end."""
        return self.start_s + self.span_s

    def cut(self, u: float) -> Segment:
        """Its beginning up to u."""
        return Segment(
            self.start_s,
            self.span_s * u,
            rescale(self.positions, u),
            self.closed,
            rescale(self.stop_forces, u),
            self.pads,
            rescale(self.pad_forces, u),
        )

    def motion(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, velocities and accelerations (movers, times) at times inside it."""
        u = (times_s - self.start_s) / self.span_s
        index = np.arange(float(self.positions.shape[1]))
        powers = u ** index[:, None]
        slopes = self.positions[:, 1:] * index[1:]
        bends = slopes[:, 1:] * index[1:-1]
        return (
            self.positions @ powers,
            slopes @ powers[:-1] / self.span_s,
            bends @ powers[:-2] / self.span_s**2,
        )
