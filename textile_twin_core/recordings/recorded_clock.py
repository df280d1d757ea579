"""Stamps of recorded samples that a wrong clock gave: those that leap ahead, and those after it was set back."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples

_SET_BACK_S = 1.0
"""Stamps that go back by more, and go on from there, are of a clock that was set back."""
_FEW = 10
_MANY_LATE = 0.01  # part of the samples, from which it matters that they come after a stamp that leapt ahead


def clock_notes(samples: AngleSamples | TorqueSamples) -> list[str]:
    """What a person should know of the stamps of recorded samples: a line where a clock was set back within them."""
    values = samples.angles_rad if isinstance(samples, AngleSamples) else samples.torque_Nm
    topic, stamps = samples.topic, samples.stamps[np.isfinite(values)]
    late = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
    if late <= _MANY_LATE * len(stamps):
        return []
    what = set_back(stamps)
    return [f"topic {topic}: {what}; {late} of {len(stamps)} are not used until it is as late again"] if what else []


def set_back(stamps: IntArray) -> str:
    """In words where stamps (n,) go back by more than a second and go on from there; empty where they do not."""
    step = np.diff(stamps)
    at = int(np.argmin(step)) + 1
    by_s, after_s = -int(step[at - 1]) * 1e-9, (int(stamps[at - 1]) - int(stamps[0])) * 1e-9
    # A single stamp that was ahead comes back at once.
    if by_s <= _SET_BACK_S or at < _FEW or len(stamps) - at < _FEW or int(stamps[at - _FEW]) < int(stamps[at]):
        return ""
    return f"a clock was set back: the stamps go back by {by_s:.3f} s at sample {at}, {after_s:.3f} s after the first"


def stamps_ahead(stamps: IntArray) -> IntArray:
    """Samples whose stamps leap ahead of later ones, where without them many fewer come too late: (m,) indices.

    A clock that was wrong for one sample would otherwise cost all samples until it is that time.
    """
    late = np.count_nonzero(stamps < np.maximum.accumulate(stamps))
    ahead = np.flatnonzero(stamps > np.minimum.accumulate(stamps[::-1])[::-1])
    return ahead if len(ahead) < late and late > _MANY_LATE * len(stamps) else ahead[:0]
