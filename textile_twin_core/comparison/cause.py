"""A cause of the verdict and an estimated quantity, as data, and what kinds of causes there are."""

from __future__ import annotations

import math
from dataclasses import dataclass

WRONG_FIRST = ("encoder_direction", "encoder_ratio", "angle_unit", "angle_rate", "torque_sign", "torque_unit")
"""Causes to settle before anything else can be identified."""
NOT_JUDGED = frozenset(
    (
        "encoder_zero",
        "encoder_direction",
        "encoder_ratio",
        "angle_rate",
        "torque_sign",
        "delay",
        "zero_or_delay",
        "clocks_drift",
        "other_machine",
    )
)
"""Causes that wrong times may imitate."""


@dataclass(frozen=True)
class Cause:
    """One fault of the verdict.

    Attributes:
        cause: its name. text: for a person, with the number.
        value: rad, s, N m, or a factor, by cause; a unit's name for units.
        sigma: standard deviation of the value given the tolerances of all other numbers, nan without one.
        parameter: dotted path into the machine file, empty if the file has no such number.
        equivalents: paths of parameters that this record does not distinguish from it.
        unit: of the value where the cause leaves it open: s or Hz of a low pass.

    Examples:
        >>> from textile_twin_core.comparison.cause import Cause
        >>> Cause("delay", "the torque lags by 2 ms", 0.002, 4e-5, "sensors.torque.delay_s").value  # [s]
        0.002
    """

    cause: str
    text: str
    value: float | str | dict[str, float]
    sigma: float = math.nan
    parameter: str = ""
    equivalents: tuple[str, ...] = ()
    unit: str = ""


@dataclass(frozen=True)
class Quantity:
    """An estimated quantity and its name for a person."""

    name: str
    text: str
