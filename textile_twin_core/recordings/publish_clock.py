"""Choice of the clock for messages without a stamp: time of publishing if more regular, otherwise time of recording."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import IntArray

EVENER = 0.5
"""Largest ratio of interval deviations, publishing over recording, that selects the times of publishing."""
_GAP_NS, _OTHER_CLOCK_NS = 250_000_000, 60_000_000_000
"""Intervals above the first are pauses; publish times off by more than the second are of an unrelated clock."""


def better_clock(logged_ns: IntArray, published_ns: IntArray) -> IntArray:
    """Select the times (n,) [ns] of messages without a stamp.

    A recorder that writes queued messages logs them all at once, and a coarse clock logs the same time repeatedly.

    Args:
        logged_ns: (n,) times of recording.
        published_ns: (n,) times of publishing; 0 where the file has none.

    Returns:
        The times of publishing if they increase and are more regular by EVENER, otherwise the times of recording.

    Example:
        >>> better_clock(np.array([0, 0, 0, 6]), np.array([1, 3, 5, 7]))
        array([1, 3, 5, 7])
    """
    if published_ns.size < 3 or not (published_ns > 0).all() or np.any(np.diff(published_ns) < 0):
        return logged_ns
    if np.median(np.abs(published_ns - logged_ns)) > _OTHER_CLOCK_NS:
        return logged_ns
    return published_ns if _unevenness(published_ns) < EVENER * _unevenness(logged_ns) else logged_ns


def _unevenness(times_ns: IntArray) -> float:
    """Return the standard deviation of the intervals over their mean."""
    step = np.diff(times_ns)
    step = step[np.abs(step) < _GAP_NS]
    mean = float(np.mean(step)) if step.size else 0.0
    return float(np.std(step)) / mean if mean > 0.0 else np.inf
