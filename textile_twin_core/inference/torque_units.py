"""Unit of a logged torque, from the factor between the logged and the expected torque."""

from __future__ import annotations

import math
from dataclasses import dataclass

UNITS_PER_NM = {
    "N cm": 100.0,
    "N mm": 1000.0,
    "kN m": 1e-3,
    "daN m or kgf m": 0.101,
    "kgf cm": 10.19716,
    "lbf ft": 0.7375621,
    "lbf in": 8.850746,
    "ozf in": 141.6119,
}
"""Size of 1 N m in other units."""

_NEAR = 0.1
_NEAR_ODD = {"lbf ft": 0.015, "kgf cm": 0.05, "lbf in": 0.05}
"""Relative distance within which a factor matches these units, which a plain gain may resemble."""


@dataclass(frozen=True)
class NearestGain:
    """Gain due to sign and unit alone.

    Attributes:
        gain: as in the settings. sign: over the configured one. unit: its name, empty for N m. factor: of the unit.
    """

    gain: float
    sign: int
    unit: str
    factor: float


def nearest_gain(gain: float, configured: float, near: float | None = None) -> NearestGain:
    """Return the configured gain with the sign, and in the unit, nearest to an estimated gain.

    `near` is the relative distance within which a unit counts; None: a tenth, less for units near a plain gain.
    """
    ratio = gain / configured
    sign = 1 if ratio > 0.0 else -1
    best, unit, factor = math.inf, "", 1.0
    for name, units in UNITS_PER_NM.items():
        away = abs(abs(ratio) / units - 1.0)
        if away < (_NEAR_ODD.get(name, _NEAR) if near is None else near) and away < best:
            best, unit, factor = away, name, units
    return NearestGain(configured * sign * factor, sign, unit, factor)
