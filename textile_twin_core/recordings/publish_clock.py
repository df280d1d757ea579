"""The clock of messages that have no stamp: when they were published where that is the better clock, else recorded."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import IntArray

EVENER = 0.5
"""Ratio of the intervals' deviations up to which the times of publishing are the better clock."""
_GAP_NS, _OTHER_CLOCK_NS = 250_000_000, 60_000_000_000
"""Longer intervals are pauses; times further apart are of clocks that no other topic shares."""


def better_clock(logged_ns: IntArray, published_ns: IntArray) -> IntArray:
    """The times (n,) [ns] of messages without a stamp.

    A recorder that writes what has piled up logs it at once, and a coarse clock logs the same time several times.

    Args:
        logged_ns: (n,) when they were recorded.
        published_ns: (n,) when they were published; 0 where the file does not say it.

    Returns:
        The times of publishing where they rise and are evener by EVENER, else those of recording.

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
    """Deviation of the intervals, as a part of their mean."""
    step = np.diff(times_ns)
    step = step[np.abs(step) < _GAP_NS]
    mean = float(np.mean(step)) if step.size else 0.0
    return float(np.std(step)) / mean if mean > 0.0 else np.inf
