"""Crank rotation between the dead centres, from the time ratio that people ask for."""

from __future__ import annotations

import math

from textile_twin_core.errors import SceneError


def rotation_of_time_ratio(ratio: float) -> float:
    """Crank rotation [rad] of the way out where it takes `ratio` times as long as the way back, at constant speed.

    Raises SceneError for a ratio that is not positive.
    """
    if not (math.isfinite(ratio) and ratio > 0.0):
        raise SceneError(f"time ratio {ratio!r}: give a positive number, 1 for out and back in equal times")
    return 2.0 * math.pi * ratio / (1.0 + ratio)
