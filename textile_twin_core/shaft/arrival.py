"""Arrival of samples: which are accepted, which came late in a bunch, and where the record has a gap."""

from __future__ import annotations

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft.constants import (
    BUNCHED_STEP,
    FINEST_S,
    GAP_SAMPLES,
    INTERVAL_EDGES,
    INTERVAL_SAMPLES,
    LARGEST,
    MAX_SPREAD,
    REPEATING,
    SETTLING,
)
from textile_twin_core.shaft.status import Counts, Mixture, Repeats, Sampling, Stamps

EVEN, BUNCHED, FASTER = 0, 1, 2  # arrival of a reading: in time; late, together with the one before; at a higher rate


@compiled_in_place
def admit(counts: Counts, unit: float, last: Stamps, stamp: float, angle: float) -> bool:
    """Accept a sample with finite angle and stamp, newer than `last` (1,); count the cause of a rejection."""
    counts.received += 1.0
    if not (abs(angle) <= LARGEST and abs(stamp * unit) <= LARGEST):  # false of NaN, too
        counts.not_finite += 1.0
        return False
    since = (stamp - last[0]) * unit
    if counts.accepted > 0.0 and since < FINEST_S:
        counts.duplicate_stamp += since >= 0.0
        counts.older_stamp += since < 0.0
        return False
    counts.accepted += 1.0
    return True


@compiled_in_place
def classify_arrival(sampling: Sampling, step: float) -> int:
    """Count readings in a row that came close together; return EVEN, BUNCHED or FASTER.

    More than a few in a row did not arrive late: the rate rose after a pause. Edges are stamped as they pass.
    """
    sampling.bunched = sampling.bunched + 1.0 if step < BUNCHED_STEP * sampling.interval else 0.0
    if sampling.bunched == 0.0:
        return EVEN
    return BUNCHED if sampling.bunched <= most_bunched(sampling) else FASTER


@compiled_in_place
def most_bunched(sampling: Sampling) -> float:
    """Return the maximum number of readings in a row that may have arrived late."""
    return 1.0 if sampling.edges > 0.0 else SETTLING


@compiled_in_place
def is_gap(sampling: Sampling, track: Mixture, period: float, step: float) -> bool:
    """Return whether the record has a gap: a long one, or one that leaves the turn of a wrapped angle ambiguous."""
    spread = step * (track.speed_sigma + 0.5 * step * track.acceleration_sigma)
    ambiguous = step > 2.0 * sampling.interval and spread > MAX_SPREAD * period > 0.0
    return ambiguous or step > GAP_SAMPLES * sampling.interval


@compiled_in_place
def average_interval(sampling: Sampling, step: float) -> None:
    """Update the mean interval; those of edges follow the speed."""
    gain = 1.0 / min(sampling.samples, INTERVAL_EDGES if sampling.edges > 0.0 else INTERVAL_SAMPLES)
    sampling.interval += (min(step, GAP_SAMPLES * sampling.interval) - sampling.interval) * gain


@compiled_in_place
def is_turn_ambiguous(sampling: Sampling, track: Mixture, repeats: Repeats, period: float, step: float) -> bool:
    """Return whether a wrapped angle moves by more than half a period per interval."""
    longest = max(step, sampling.interval) if sampling.since < SETTLING else sampling.interval
    if repeats.share > REPEATING:
        longest *= 1.0 + repeats.longest
    return period > 0.0 and 2.0 * abs(track.speed) * longest > period
