"""Sense of rotation of an estimated state; without it dry friction has no sign.

The estimated speed of a shaft at standstill is about 1e-7 rad/s of either sign instead of 0. The friction of a backing
would follow that sign at full force, and the prediction at standstill would be wrong by the friction.
"""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.shaft import ShaftStates

SENSE_SIGMAS = 3.0
"""Number of standard deviations within which the sign of the speed is unknown (1 in 370 states exceeds it)."""
_NEGLIGIBLE_RAD_S = 1e-100
"""Speed that is negligible but has a sign."""


def sense_unknown(states: ShaftStates) -> BoolArray:
    """Return (n,) true where the speed is within SENSE_SIGMAS of zero."""
    return np.asarray(np.abs(states.omega_rad_s) <= SENSE_SIGMAS * states.sigma[:, 1])


def negligible_speed(omega_rad_s: float | FloatArray) -> FloatArray:
    """Return negligible speeds [rad/s] of the same signs; outputs there exceed those at standstill by their dry
    friction.
    """
    return np.asarray(_NEGLIGIBLE_RAD_S * np.sign(omega_rad_s))
