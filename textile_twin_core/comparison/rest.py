"""The torque sensor's offset as the shaft at rest shows it: there is no friction then."""

from __future__ import annotations

import math

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.evidence import Evidence, Settings
from textile_twin_core.comparison.uncertainty import Estimate

_FEWEST, _PARTS = 20, 10
_OF_MEDIAN = math.sqrt(math.pi / 2.0)
"""Standard deviation of a median over that of a mean."""
_QUARTILES = 1.349
"""Between the quartiles, in standard deviations."""


def rest_reading(evidence: Evidence, settings: Settings) -> Estimate | None:
    """What the torque sensor shows at rest beside the machine's own torque and its offset so far; None without rest.

    That is of its weight and its loads, such as springs; dry friction is 0 at rest.
    """
    theta, omega, _, good = evidence.track.at(evidence.time_s - settings.delay_s)
    still = good & (np.abs(omega) < 0.1 * evidence.rest_rad_s)
    if np.count_nonzero(still) < _FEWEST:
        return None
    theta = settings.direction * settings.ratio * theta[still] - settings.zero_rad
    parts = evidence.terms.at(theta, np.zeros_like(theta), np.zeros_like(theta), evidence.rest_rad_s)
    held = parts.mechanism + settings.load * parts.load
    left = evidence.torque_Nm[still] - settings.gain * held - settings.offset_Nm
    # by parts of the rest, since a few hold a shaft that creeps, with its friction
    medians = np.array([np.median(part) for part in np.array_split(left, _PARTS)])
    low, value, high = np.percentile(medians, [25.0, 50.0, 75.0]).tolist()
    sigma = _OF_MEDIAN * (high - low) / _QUARTILES / math.sqrt(_PARTS)
    # at rest a sensor may show one of its values throughout: anything within a step is as likely
    sigma = math.hypot(sigma, _step(evidence.torque_Nm) / math.sqrt(12.0))
    half = float(scipy.stats.t.ppf(0.975, _PARTS - 1)) * sigma
    return Estimate(value, sigma, (value - half, value + half))


def _step(torque_Nm: FloatArray) -> float:
    """The step [N m] from one value that a sensor can show to the next; 0 where values hardly repeat."""
    values = np.unique(torque_Nm)
    return float(np.median(np.diff(values))) if 1 < values.size < 0.5 * torque_Nm.size else 0.0
