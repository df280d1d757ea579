"""Something that happens in a machine at a shaft angle."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """Something that happens at a shaft angle in [0, 2 pi) [rad]."""

    name: str
    angle_rad: float
