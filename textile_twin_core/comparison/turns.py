"""How the speeds of whole turns differ: what tells a delay from a zero of the encoder."""

from __future__ import annotations

import numpy as np

from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack

_FEWEST_SPANS = 8
_PAUSE = 20.0
"""A turn this many times longer than the median one holds a stop."""


def speed_spread(track: ShaftTrack) -> float:
    """How far the mean speeds of whole turns differ: the third fastest turn over the third slowest."""
    turn = np.floor(track.theta_rad / TURN)
    edges = np.flatnonzero(np.diff(turn) != 0.0)
    spans = np.sort(np.diff(track.time_s[edges]))
    spans = spans[(spans > 0.0) & (spans < _PAUSE * np.median(spans))] if spans.size else spans
    return float(spans[-3] / spans[2]) if spans.size >= _FEWEST_SPANS else 1.0
