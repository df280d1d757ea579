"""Torques at an end of the range of their sensor or drive, where the true torque is unknown."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray

_FEWEST_VALUES = 200
"""Fewest different values: with coarser steps a nearly constant torque would look like an end."""
_SHARE = 0.005
_OFTEN = 10.0
_LOOKS_BACK = 20_000
"""Number of earlier torques that are used, with the newest ones, to find the ends."""


def at_range_ends(torque_Nm: FloatArray) -> BoolArray:
    """Return true for torques (n,) of a turning shaft that equal an extreme value which occurs far too often.

    The extreme value occurs at least ten times as often as each other one, and in half a percent of the samples.
    """
    values, place, count = np.unique(torque_Nm, return_inverse=True, return_counts=True)
    if values.size < _FEWEST_VALUES:
        return np.zeros(torque_Nm.size, np.bool_)
    often = count > max(_SHARE * torque_Nm.size, _OFTEN * float(count[1:-1].max()))
    return np.asarray(often[place])


class RangeEnds:
    """Running search for torques at an end of their range; values_Nm are the latest ends."""

    def __init__(self) -> None:
        self._before = np.empty(0)
        self.values_Nm = np.empty(0)

    def find(self, torque_Nm: FloatArray) -> BoolArray:
        """Apply `at_range_ends` to torques (n,) and those before them."""
        seen = np.concatenate([self._before, torque_Nm])
        self._before = seen[-_LOOKS_BACK:]
        at_ends = at_range_ends(seen)
        self.values_Nm = np.unique(seen[at_ends])
        return at_ends[seen.size - torque_Nm.size :]


def range_end_note(count: int, ends_Nm: FloatArray, without: str) -> str:
    """Note on a number of torques at ends; `without` names the results that leave them out."""
    ends = " and ".join(f"{end:g}" for end in ends_Nm)
    return (
        f"{count} samples of torque are exactly {ends} N m, as at the end of the range of a sensor or drive: {without}"
        " without them"
    )
