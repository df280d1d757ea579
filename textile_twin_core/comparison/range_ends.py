"""Torques at an end of their sensor's range, or of the drive that tells them: there the true torque is not known."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray

_FEWEST_VALUES = 200
"""Of a sensor with coarser steps a torque that stays within one looks like an end."""
_SHARE = 0.005
_OFTEN = 10.0


def at_range_ends(torque_Nm: FloatArray) -> BoolArray:
    """Where torques (n,) of a turning shaft are exactly the smallest or largest one, far oftener than any other.

    The exact value comes at least ten times as often as each between, and makes half a percent of the samples.
    """
    values, place, count = np.unique(torque_Nm, return_inverse=True, return_counts=True)
    if values.size < _FEWEST_VALUES:
        return np.zeros(torque_Nm.size, np.bool_)
    often = count > max(_SHARE * torque_Nm.size, _OFTEN * float(count[1:-1].max()))
    return np.asarray(often[place])
