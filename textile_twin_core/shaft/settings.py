"""Settings of the shaft estimators, checked when they are given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TypeGuard

import numpy as np

from textile_twin_core.errors import SceneError
from textile_twin_core.shaft.turns import TURN

WRAPPINGS = ("auto", "wrapped", "unwrapped")
MOST_TEETH = 10_000


@dataclass(frozen=True, kw_only=True)
class ShaftSettings:
    """What an estimator can be told; the defaults need no tuning.

    Attributes:
        encoder_bits: bits of the encoder per turn of its own; None: the step is found.
        resolution_rad: or its step, in shaft angle.
        stamp_jitter_s: standard deviation of the stamps; None: learnt.
        teeth: samples are edges of a wheel with so many teeth a turn (missing ones counted); 0: sampled angles.
        tooth_zero_rad: angle of tooth 0.
        pitch_errors_rad: (teeth,) how far each tooth's edge lies beyond its nominal angle; None: `smooth` finds them.
        cycle_turns: turns after which the motion repeats, for ripple of half orders and lower.
        wrapping: "auto", "wrapped" or "unwrapped".
        period_rad: what a wrapping angle wraps by.

    Raises:
        SceneError: a setting of the wrong kind or value.
    """

    encoder_bits: float | None = None
    resolution_rad: float | None = None
    stamp_jitter_s: float | None = None
    teeth: int = 0
    tooth_zero_rad: float = 0.0
    pitch_errors_rad: tuple[float, ...] | None = None
    cycle_turns: int = 1
    wrapping: str = "auto"
    period_rad: float = TURN

    def __post_init__(self) -> None:
        for name in ("encoder_bits", "resolution_rad"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        jitter: object = self.stamp_jitter_s
        if jitter is not None and not (_is_finite(jitter) and jitter >= 0):
            raise SceneError(f"stamp_jitter_s is {jitter!r}: give a finite number, 0 or more, or None")
        _require_whole("teeth", self.teeth, 0, MOST_TEETH)
        _require_whole("cycle_turns", self.cycle_turns, 1, 64)
        require_positive("period_rad", self.period_rad)
        if self.wrapping not in WRAPPINGS:
            raise SceneError(f"wrapping is {self.wrapping!r}: choose one of {', '.join(WRAPPINGS)}")
        errors = self.pitch_errors_rad
        if errors is not None and (len(errors) != self.teeth or not np.all(np.isfinite(errors))):
            raise SceneError(
                f"pitch_errors_rad has {len(errors)} values: give one finite number for each of {self.teeth} teeth"
            )

    @property
    def step_rad(self) -> float | None:
        """The encoder's step, when given; 0 for edges, which are exact."""
        if self.teeth:
            return 0.0
        return self.resolution_rad if self.encoder_bits is None else self.period_rad / 2.0**self.encoder_bits


def require_positive(name: str, value: object) -> None:
    """Refuse a setting that is no positive finite number.

    Raises:
        SceneError: it is none.
    """
    if not (_is_finite(value) and value > 0):
        raise SceneError(f"{name} is {value!r}: give a positive finite number")


def _require_whole(name: str, value: object, least: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        raise SceneError(f"{name} is {value!r}: give a whole number from {least} to {most}")


def _is_finite(value: object) -> TypeGuard[float]:
    return not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)
