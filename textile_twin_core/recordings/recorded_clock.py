"""Clocks of recorded samples: the more regular one for messages without a stamp, stamps far ahead, clocks set back."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.recordings.counter import find_counter, unwrap_counter
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples
from textile_twin_core.twin.restart import RestartWatch

_Samples = TypeVar("_Samples", AngleSamples, TorqueSamples)
_STAMP_COUNTS_NS = {1e3: "us", 1e6: "ms", 1.0: "ns"}
"""Value of one count of a device's clock [ns], and its unit."""
_LEAST_WRAP_NS = 2**31
_SET_BACK_S = 1.0
"""Least backward step of a clock that was set back [s]."""
_FEW = 10
_FEWER = 0.9
"""Largest ratio of early to late samples for stamps far ahead; a clock set back gives a ratio near 1."""
_MANY_LATE = 0.01  # share of late samples above which the user is warned
EVENER = 0.5
"""Largest ratio of interval deviations, publishing over recording, that selects the times of publishing."""
_GAP_NS, _OTHER_CLOCK_NS = 250_000_000, 60_000_000_000
"""Intervals above the first are pauses; publish times off by more than the second are of an unrelated clock."""


def without_stamp_wraps(samples: _Samples) -> _Samples:
    """Undo the wraps of a device's clock of 32 bits, in us, ms or ns, within the stamps of recorded samples."""
    if samples.stamps.size < 2 or (np.diff(samples.stamps) >= -_LEAST_WRAP_NS).all():
        return samples
    counter = find_counter(samples.stamps, list(_STAMP_COUNTS_NS))
    if counter is None or counter.bits != 32:
        return samples
    unit = _STAMP_COUNTS_NS[counter.width / 2.0**32]
    note = f"topic {samples.topic}: the stamps are {counter.text}, in {unit}: continued from there"
    stamps = unwrap_counter(samples.stamps, counter.width)
    return replace(samples, stamps=stamps, recorded_ns=samples.stamps, notes=(*samples.notes, note))


def clock_notes(samples: AngleSamples | TorqueSamples, restarts: bool = False) -> list[str]:
    """Describe corrections on reading, and warn in one line if a clock was set back within recorded samples.

    `restarts`: samples from there on are used, too, as another record.
    """
    values = samples.angles_rad if isinstance(samples, AngleSamples) else samples.torque_Nm
    topic, stamps = samples.topic, samples.stamps[np.isfinite(values)]
    late = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
    if late <= _MANY_LATE * len(stamps):
        return [*samples.notes]
    what = set_back(stamps)
    if not what:
        return [*samples.notes]
    unused = f"{late} of {len(stamps)} are not used until it is as late again"
    return [*samples.notes, f"topic {topic}: {what}; {'the prediction restarts there' if restarts else unused}"]


def one_record(angles: AngleSamples) -> AngleSamples:
    """Drop the samples stamped before an earlier one if a clock was set back, so that the stamps are of one record."""
    known = np.where(np.isfinite(angles.angles_rad), angles.stamps, np.iinfo(np.int64).min)
    if not RestartWatch().restarts(angles.stamps):
        return angles
    kept = angles.stamps >= np.maximum.accumulate(known)
    velocities = None if angles.velocities is None else angles.velocities[kept]
    return replace(angles, stamps=angles.stamps[kept], angles_rad=angles.angles_rad[kept], velocities=velocities)


def on_one_clock(
    angles: AngleSamples, measured: TorqueSamples, restarts: bool = False
) -> tuple[TorqueSamples, list[str]]:
    """Return the torques on the clock of the angles, and notes on both clocks (`restarts` as in `clock_notes`).

    If only one clock was set back, torques cannot be matched with angles from there on, and are discarded.
    """
    notes = [*clock_notes(angles, restarts), *clock_notes(measured, restarts)]
    known = np.isfinite(angles.angles_rad)
    of_angles, of_torques = _set_back_at(angles.stamps[known]), _set_back_at(measured.stamps)
    if of_angles and of_torques and abs(of_angles[1] - of_torques[1]) <= _SET_BACK_S:
        return measured, notes
    if of_torques:
        which, other, stamps = measured.topic, angles.topic, measured.stamps
        usable = np.arange(stamps.size) < of_torques[0]
    elif of_angles:
        which, other, stamps = angles.topic, measured.topic, angles.stamps[known]
        usable = measured.stamps <= stamps[of_angles[0] - 1]
    else:
        return measured, notes
    notes = [note for note in notes if not note.startswith(f"topic {which}: ")]
    notes.append(f"topic {which}: {set_back(stamps)}, and those of {other} do not: torque from there on is not used")
    return measured.rows(usable), notes


def set_back(stamps: IntArray) -> str:
    """Describe where stamps (n,) go back by more than a second and continue from there; empty if they do not."""
    found = _set_back_at(stamps)
    if found is None:
        return ""
    at, by_s = found
    after_s = (int(stamps[at - 1]) - int(stamps[0])) * 1e-9
    return f"a clock was set back: the stamps go back by {by_s:.3f} s at sample {at}, {after_s:.3f} s after the first"


def _set_back_at(stamps: IntArray) -> tuple[int, float] | None:
    """Return the first sample after stamps (n,) went back, and the step [s]; None if they did not."""
    if stamps.size < 2 * _FEW:
        return None
    step = np.diff(stamps)
    at = int(np.argmin(step)) + 1
    by_s = -int(step[at - 1]) * 1e-9
    # After a single early stamp the clock returns at once.
    if by_s <= _SET_BACK_S or at < _FEW or len(stamps) - at < _FEW or int(stamps[at - _FEW]) < int(stamps[at]):
        return None
    return at, by_s


def stamps_ahead(stamps: IntArray) -> IntArray:
    """Find samples with stamps far ahead of later ones, if discarding them saves many late samples: (m,) indices.

    Otherwise one wrong stamp would discard all samples up to its time.
    """
    late = np.count_nonzero(stamps < np.maximum.accumulate(stamps))
    ahead = np.flatnonzero(stamps > np.minimum.accumulate(stamps[::-1])[::-1])
    return ahead if len(ahead) < _FEWER * late and late > _MANY_LATE * len(stamps) else ahead[:0]


def better_clock(logged_ns: IntArray, published_ns: IntArray) -> IntArray:
    """Select the times (n,) [ns] of messages without a stamp.

    A recorder that writes queued messages logs them all at once, and a coarse clock logs the same time repeatedly.

    Args:
        logged_ns: (n,) times of recording.
        published_ns: (n,) times of publishing; 0 where the file has none.

    Returns:
        The times of publishing if they increase and are more regular by EVENER, otherwise the times of recording.

    Examples:
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
