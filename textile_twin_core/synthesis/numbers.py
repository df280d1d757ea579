"""Key figures of one turn: stroke, dwell, largest acceleration, torque, ripple.

All functions work on the last axis, for one turn (m,) or many designs (n, m). Samples are equally spaced.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine.events import DWELL_SHARE

_BENDS = 0.25
"""A curvature beside the largest sample below this share of that at the sample indicates a step or a kink."""


def smallest(values: FloatArray) -> FloatArray:
    """Compute the smallest value of a smooth curve over the turn, by a parabola through three samples."""
    return -largest(-values)


def largest(values: FloatArray) -> FloatArray:
    """Compute the largest value over the turn, by a parabola through three samples where the curve is smooth."""
    return at_largest(values, values)


def at_largest(values: FloatArray, guide: FloatArray) -> FloatArray:
    """Interpolate the values at the maximum of `guide` over the turn, between samples where it is smooth."""
    k = np.argmax(guide, axis=-1)[..., None]
    count = values.shape[-1]
    around = np.take_along_axis(guide, (k + np.arange(-2, 3)) % count, -1)
    vb, vh, va = (np.take_along_axis(values, (k + d) % count, -1)[..., 0] for d in (-1, 0, 1))
    bends = np.diff(around, 2, axis=-1)
    bend = bends[..., 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        smooth = bends.max(axis=-1) < _BENDS * bend
        x = np.where(smooth, 0.5 * (around[..., 1] - around[..., 3]) / bend, 0.0)
    return np.asarray(vh + 0.5 * x * (va - vb) + 0.5 * x * x * (va - 2.0 * vh + vb))


def dwell(position: FloatArray, within: FloatArray | float) -> FloatArray:
    """Compute the shaft angle [rad] over which the position stays within a distance of its smallest value.

    The samples are joined by straight lines, so that the angle is no multiple of their spacing.
    """
    here = (smallest(position) + within)[..., None] - position  # positive inside the dwell
    after = np.roll(here, -1, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        crossing = np.maximum(here, after) / np.abs(here - after)
    share = np.where((here >= 0.0) & (after >= 0.0), 1.0, np.where((here < 0.0) & (after < 0.0), 0.0, crossing))
    return np.asarray(share.mean(axis=-1) * 2.0 * math.pi)


def _stroke(position: FloatArray) -> FloatArray:
    return largest(position) - smallest(position)


def dwell_within(position: FloatArray, within: float | None) -> FloatArray:
    """Return the distance from the rear point that counts as dwell [m]: as given, else 5 % of the stroke."""
    return DWELL_SHARE * _stroke(position) if within is None else np.asarray(within)


MOTION = ("stroke_m", "dwell_rad", "largest_speed_m_s", "largest_acceleration_m_s2", "front_acceleration_m_s2")
"""Key figures of a measure; its position is largest at the front and smallest at the rear, where it dwells."""


def motion_number(
    what: str,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    dwell_within_m: float | None = None,
) -> FloatArray:
    """Compute one of `MOTION`. The dwell counts within `dwell_within_m` of the rear, or within 5 % of the stroke."""
    match what:
        case "stroke_m":
            return _stroke(position)
        case "dwell_rad":
            return dwell(position, dwell_within(position, dwell_within_m))
        case "largest_speed_m_s":
            return largest(np.abs(velocity))
        case "largest_acceleration_m_s2":
            return largest(np.abs(acceleration))
        case "front_acceleration_m_s2":
            return np.abs(at_largest(acceleration, position))
        case _:
            raise KeyError(what)


def torque_numbers(torque: FloatArray) -> dict[str, FloatArray]:
    """Compute peak (largest magnitude), root mean square and ripple (largest less smallest) of the torque [N m]."""
    return {
        "peak_torque_Nm": np.abs(torque).max(axis=-1),
        "rms_torque_Nm": np.sqrt(np.mean(torque**2, axis=-1)),
        "torque_ripple_Nm": np.ptp(torque, axis=-1),
    }


def shaking_numbers(x: FloatArray, y: FloatArray) -> dict[str, FloatArray]:
    """Compute the largest and root mean square shaking force [N]."""
    squared = x**2 + y**2
    return {
        "largest_shaking_force_N": np.sqrt(squared.max(axis=-1)),
        "rms_shaking_force_N": np.sqrt(squared.mean(axis=-1)),
    }
