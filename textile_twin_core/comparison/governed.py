"""Whether the shaft's speed is governed: a torque that follows the speed tells no inertia from its own delay."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.shaft_track import TURN

_FOLLOWS = 0.9
"""Correlation within turns: 0.91 to 0.999 under proportional controllers, up to 0.72 where the speed is prescribed."""


def follows_speed(evidence: Evidence, delay_s: float) -> bool:
    """Whether the measured torque goes with the speed within turns, as under a proportional controller or a slip.

    The torque is then k (speed wanted - speed), and to come late by d acts as an inertia of -k d. Slopes on the track
    differ all the same, by the errors of its acceleration, and least squares take these for information.
    """
    theta, omega, _, good = evidence.track.at(evidence.time_s - delay_s)
    turn = np.floor(theta[good] / TURN).astype(np.int64)
    turn -= turn.min(initial=0)
    speed, torque = (_within(turn, values[good]) for values in (omega, evidence.torque_Nm))
    size = float(np.sqrt(np.sum(speed**2) * np.sum(torque**2)))
    return abs(float(np.sum(speed * torque))) > _FOLLOWS * size > 0.0


def _within(turn: IntArray, values: FloatArray) -> FloatArray:
    """Values (n,) without the mean of their turn."""
    counts = np.maximum(np.bincount(turn), 1)
    return values - (np.bincount(turn, values) / counts)[turn]
