"""Torque readings at standstill, one for each standstill."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.torque_readings import step_of
from textile_twin_core.inference.record import Standstill
from textile_twin_core.inference.robust import robust_scale

_FEWEST, _PARTS = 20, 10
_OF_MEDIAN = math.sqrt(math.pi / 2.0)
"""Standard deviation of a median over that of a mean."""
_QUARTILES = 1.349
"""Distance of the quartiles in standard deviations."""
_MOVED = 5.0
"""Scales of the angle within a standstill beyond which the shaft has moved."""
_TABULATED = 1e-4
"""Error of the tabulated torque as a share of its variation; a simulated record may be more exact."""
_APART_S = 1.0
"""Longest time without a reading within one standstill."""


def standstills(evidence: Evidence) -> tuple[Standstill, ...]:
    """Medians of the torque over parts of each standstill.

    A shaft that creeps has the friction of a turning one: samples whose angle is not that of the standstill are left
    out, and in a few parts the shaft may still move.
    """
    theta, omega, _, good = evidence.track.at(evidence.time_s)
    still = good & (np.abs(omega) < 0.1 * evidence.slow_rad_s)
    time, torque, theta = evidence.time_s[still], evidence.torque_Nm[still], theta[still]
    step, least = step_of(evidence.torque_Nm), _TABULATED * float(np.ptp(evidence.torque_Nm)) + 1e-12
    found = []
    for part in np.split(np.arange(time.size), np.flatnonzero(np.diff(time) > _APART_S) + 1):
        if part.size < _FEWEST:
            continue
        moved = theta[part] - np.median(theta[part])
        part = part[np.abs(moved) <= _MOVED * robust_scale(moved)]
        medians = np.array([np.median(each) for each in np.array_split(torque[part], _PARTS)])
        low, value, high = np.percentile(medians, [25.0, 50.0, 75.0]).tolist()
        # of ten parts, which shows slow changes, but at least that of independent samples
        sigma = _OF_MEDIAN * (high - low) / _QUARTILES / math.sqrt(_PARTS)
        sigma = max(sigma, _OF_MEDIAN * robust_scale(torque[part] - value) / math.sqrt(part.size))
        # a quantised sensor may show one value throughout: all torques within its step are equally likely
        sigma = math.hypot(sigma, step / math.sqrt(12.0))
        found.append(Standstill(float(np.median(time[part])), value, max(sigma, least)))
    return tuple(found)
