"""Detection of a speed-controlled drive, whose torque does not separate an inertia from its own delay."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.evidence import Evidence, turns_gone

_FOLLOWS = 0.95
"""Correlation within turns: 0.975 to 0.999 under proportional controllers, up to 0.84 where the speed is prescribed."""


def torque_by_speed(evidence: Evidence, delay_s: float) -> float:
    """Fall of the measured torque with the speed within turns [N m s]; 0 if the torque does not follow the speed.

    Under a proportional controller or a slip the torque is k (speed wanted - speed), and a delay d acts as a missing
    inertia of k d. The slopes on the track still differ, but only by the errors of its acceleration, which least
    squares would take for information.
    """
    theta, omega, _, good = evidence.track.at(evidence.time_s - delay_s)
    columns, good = evidence.weighed(np.column_stack([theta, evidence.time_s, omega, evidence.torque_Nm]), good)
    theta, time, omega, torque = columns[good].T
    turn = turns_gone(theta)
    time = _within(turn, time)
    speed, torque = (_without_trend(turn, time, values) for values in (omega, torque))
    both, size = float(np.sum(speed * torque)), float(np.sqrt(np.sum(speed**2) * np.sum(torque**2)))
    return -both / float(np.sum(speed**2)) if abs(both) > _FOLLOWS * size > 0.0 else 0.0


def _within(turn: IntArray, values: FloatArray) -> FloatArray:
    """Values (n,) without the mean of their turn."""
    counts = np.maximum(np.bincount(turn), 1)
    return values - (np.bincount(turn, values) / counts)[turn]


def _without_trend(turn: IntArray, time: FloatArray, values: FloatArray) -> FloatArray:
    """Values (n,) without mean and trend of their turn; `time` is without its mean."""
    values = _within(turn, values)
    rate = np.bincount(turn, time * values) / np.maximum(np.bincount(turn, time**2), 1e-300)
    return np.asarray(values - rate[turn] * time)
