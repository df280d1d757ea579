"""The state of a contact model between two instants."""

from __future__ import annotations

from dataclasses import dataclass, replace

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.result import PadState


@dataclass
class ContactState:
    """Positions and velocities of the bodies, which stops are closed, what the pads do, and the drive's last state."""

    time_s: float
    positions: FloatArray
    velocities: FloatArray
    drive_position_m: float
    drive_velocity_m_s: float
    closed: frozenset[int]
    pads: tuple[PadState, ...]
    speed_scale_m_s: float
    """largest speed so far: what rounding and tolerance of a speed are measured by"""

    def copy(self) -> ContactState:
        """An independent copy."""
        return replace(self, positions=self.positions.copy(), velocities=self.velocities.copy())
