"""The sense of rotation that an estimated state tells: where it tells none, dry friction has no sign.

A shaft at rest is estimated at 1e-7 rad/s rather than 0, of either sign. The friction of a backing would follow that
sign with its whole force, and a prediction at rest would be off by as much as the friction is.
"""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.shaft import ShaftStates

SENSE_SIGMAS = 3.0
"""Standard deviations of the speed within which its sign is not known: one state in 370 at rest is beyond them."""
_NEXT_TO_REST_RAD_S = 1e-100
"""A speed whose sign counts, and whose size is lost beside any other term."""


def sense_unknown(states: ShaftStates) -> BoolArray:
    """(n,) where the speed is within SENSE_SIGMAS of zero."""
    return np.asarray(np.abs(states.omega_rad_s) <= SENSE_SIGMAS * states.sigma[:, 1])


def next_to_rest(omega_rad_s: float | FloatArray) -> FloatArray:
    """Speeds [rad/s] of the same signs at which nothing but the sign tells: what an output has here more than at
    rest is its dry friction.
    """
    return np.asarray(_NEXT_TO_REST_RAD_S * np.sign(omega_rad_s))
