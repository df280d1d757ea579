"""Torques at an end of their sensor's range, or of the drive that tells them: there the true torque is not known."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray

_FEWEST_VALUES = 200
"""Of a sensor with coarser steps a torque that stays within one looks like an end."""
_SHARE = 0.005
_OFTEN = 10.0
_LOOKS_BACK = 20_000
"""Torques before those of the moment that tell with them what the ends are."""


def at_range_ends(torque_Nm: FloatArray) -> BoolArray:
    """Where torques (n,) of a turning shaft are exactly the smallest or largest one, far oftener than any other.

    The exact value comes at least ten times as often as each between, and makes half a percent of the samples.
    """
    values, place, count = np.unique(torque_Nm, return_inverse=True, return_counts=True)
    if values.size < _FEWEST_VALUES:
        return np.zeros(torque_Nm.size, np.bool_)
    often = count > max(_SHARE * torque_Nm.size, _OFTEN * float(count[1:-1].max()))
    return np.asarray(often[place])


class RangeEnds:
    """Finds torques at an end of their range as they come; values_Nm are the ends that were found last."""

    def __init__(self) -> None:
        self._before = np.empty(0)
        self.values_Nm = np.empty(0)

    def find(self, torque_Nm: FloatArray) -> BoolArray:
        """As `at_range_ends`, of torques (n,) and those that came before."""
        seen = np.concatenate([self._before, torque_Nm])
        self._before = seen[-_LOOKS_BACK:]
        at_ends = at_range_ends(seen)
        self.values_Nm = np.unique(seen[at_ends])
        return at_ends[seen.size - torque_Nm.size :]


def range_end_note(count: int, ends_Nm: FloatArray, without: str) -> str:
    """What is told of so many torques at ends; `without`: what is without them."""
    ends = " and ".join(f"{end:g}" for end in ends_Nm)
    return (
        f"{count} samples of torque are exactly {ends} N m, as at the end of the range of a sensor or drive: {without}"
        " without them"
    )
