"""Speed of the encoder among the columns of speeds of a log."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.recordings.log_units import SPEED_UNITS, unit_factor

_NOT_ITS_SPEED = 0.1
"""Relative difference above which a speed is that of another shaft, or of the other direction."""


@dataclass(frozen=True)
class EncoderSpeed:
    """Column of speeds, omega (n,) in rad/s. error: RMS of the angle less the integrated speed [rad], or inf."""

    column: str
    unit: str
    omega: FloatArray
    error: float


def encoder_speed(name: str, unit: str, values: FloatArray, stamps: IntArray, theta: FloatArray) -> EncoderSpeed | str:
    """Return a column of speeds (n,) if it is the angle's, otherwise the reason in words.

    Without a unit in its name the column has the unit that fits the angle.

    Args:
        name, unit, values: of the column. stamps: of its rows [ns]. theta: the angle [rad].
    """
    if unit and unit_factor(unit, SPEED_UNITS) is None:
        return f"speed in '{unit}'? tell --speed-unit: {', '.join(SPEED_UNITS)}"
    times = 1.0
    for each in [unit] if unit else SPEED_UNITS:
        omega = values * (unit_factor(each, SPEED_UNITS) or 1.0)
        fit = _fit(stamps, theta, omega)
        if fit is None and unit:
            return EncoderSpeed(name, unit, omega, math.inf)
        if fit is not None and abs(fit[0] - 1.0) <= _NOT_ITS_SPEED:
            return EncoderSpeed(name, each, omega, fit[1])
        times = times if fit is None else fit[0]
    if unit:
        return f"the angle turns {times:.3g} times as fast: no speed of this encoder"
    return f"its name has no unit; tell --speed-unit: {', '.join(SPEED_UNITS)}"


def _fit(stamps: IntArray, theta: FloatArray, omega: FloatArray) -> tuple[float, float] | None:
    """Fit the factor from a speed to that of an angle, by least squares, and return it with the RMS residual.

    None if too few samples a turn make the angle between two of them ambiguous.
    """
    stated = 0.5 * (omega[1:] + omega[:-1]) * np.diff(stamps) * 1e-9
    turned = np.diff(theta)
    turned -= 2.0 * math.pi * np.rint(turned / (2.0 * math.pi))
    good = np.isfinite(stated) & np.isfinite(turned) & (stated != 0.0)
    stated, turned = stated[good], turned[good]
    if not stated.size or np.percentile(np.abs(turned), 95.0) > 0.5 * math.pi or np.abs(turned).sum() < 2.0 * math.pi:
        return None
    return float(stated @ turned / (stated @ stated)), float(np.sqrt(np.mean((turned - stated) ** 2)))
