"""The sense of rotation that an estimated state tells: where it tells none, dry friction has no sign.

A shaft at rest is estimated at 1e-7 rad/s rather than 0, of either sign. The friction of a backing would follow that
sign with its whole force, and a prediction at rest would be off by as much as the friction is.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.shaft import ShaftEstimator, ShaftStates
from textile_twin_core.shaft.states import INFLATION
from textile_twin_core.shaft.status import STATE

SENSE_SIGMAS = 3.0
"""Standard deviations of the speed within which its sign is not known: one state in 370 at rest is beyond them."""
_NEXT_TO_REST_RAD_S = 1e-100
"""A speed whose sign counts, and whose size is lost beside any other term."""
_SPEED_VARIANCE = struct.Struct("=d")
_VARIANCE_BYTE = STATE.itemsize - 5 * _SPEED_VARIANCE.size  # the covariance (3, 3) is the last field


def sense_unknown(states: ShaftStates) -> BoolArray:
    """(n,) where the speed is within SENSE_SIGMAS of zero."""
    return np.asarray(np.abs(states.omega_rad_s) <= SENSE_SIGMAS * states.sigma[:, 1])


def newest_sense_unknown(estimator: ShaftEstimator, omega_rad_s: float) -> bool:
    """The same of the state that `step_one` has just given, which comes without its covariance."""
    (variance,) = _SPEED_VARIANCE.unpack_from(estimator._row, _VARIANCE_BYTE)
    return abs(omega_rad_s) <= SENSE_SIGMAS * (math.sqrt(max(variance, 0.0)) * float(INFLATION[1]))


def next_to_rest(omega_rad_s: float | FloatArray) -> FloatArray:
    """Speeds [rad/s] of the same signs at which nothing but the sign tells: what an output has here more than at
    rest is its dry friction.
    """
    return np.asarray(_NEXT_TO_REST_RAD_S * np.sign(omega_rad_s))
