"""Settings of the shaft estimators, validated on construction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.shaft.turns import TURN

WRAPPINGS = ("auto", "wrapped", "unwrapped")
MAX_TEETH, MAX_CYCLE_TURNS = 10_000, 64


@dataclass(frozen=True, kw_only=True)
class ShaftSettings:
    """Settings of an estimator; the defaults need no tuning.

    Attributes:
        encoder_bits: resolution of the encoder in bits per period; None: estimated from the readings.
        resolution_rad: the encoder's step instead, as an angle of the shaft; None: estimated.
        stamp_jitter_s: standard deviation of the stamps; None: estimated.
        teeth: number of teeth in a turn, missing ones counted, where samples are edges of a wheel; 0: sampled angles.
        tooth_zero_rad: angle of tooth 0; for an encoder of angles, the angle at which it reads 0.
        pitch_errors_rad: (teeth,) pitch errors, true less nominal angle of each edge; None: estimated by `smooth`.
        cycle_turns: turns after which the motion repeats; more than 1 for half orders of ripple and lower.
        wrapping: "auto", "wrapped" or "unwrapped".
        period_rad: period of a wrapped angle.
        reading_at: function from corrected angles (n,) back to the encoder's readings [rad], in which its step is
            searched; None where the samples are the readings.

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
    reading_at: Callable[[FloatArray], FloatArray] | None = None

    def __post_init__(self) -> None:
        require_positive("period_rad", self.period_rad)
        for name in ("encoder_bits", "resolution_rad"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        jitter, errors = self.stamp_jitter_s, self.pitch_errors_rad
        valid = jitter is None or (_is_finite(jitter) and jitter >= 0)
        _require(valid, "stamp_jitter_s", jitter, "give a finite number, 0 or more, or None")
        _require(_is_finite(self.tooth_zero_rad), "tooth_zero_rad", self.tooth_zero_rad, "give a finite number")
        for name, least, most in (("teeth", 0, MAX_TEETH), ("cycle_turns", 1, MAX_CYCLE_TURNS)):
            value = getattr(self, name)
            whole = isinstance(value, Integral) and not isinstance(value, bool)
            _require(whole and least <= value <= most, name, value, f"give a whole number from {least} to {most}")
        _require(self.wrapping in WRAPPINGS, "wrapping", self.wrapping, f"choose one of {', '.join(WRAPPINGS)}")
        if errors is not None and (len(errors) != self.teeth or not np.all(np.isfinite(errors))):
            raise SceneError(
                f"pitch_errors_rad has {len(errors)} values: give one finite number for each of {self.teeth} teeth"
            )

    @property
    def step_rad(self) -> float | None:
        """The encoder's step; None where it is not configured; 0 for edges, which are not rounded."""
        if self.teeth:
            return 0.0
        return self.resolution_rad if self.encoder_bits is None else self.period_rad / 2.0**self.encoder_bits


def require_positive(name: str, value: Any) -> None:
    """Check a setting.

    Raises:
        SceneError: the value is not a positive finite number.
    """
    _require(_is_finite(value) and value > 0, name, value, "give a positive finite number")


def _require(valid: bool, name: str, value: object, wanted: str) -> None:
    if not valid:
        raise SceneError(f"{name} is {value!r}: {wanted}")


def _is_finite(value: object) -> bool:
    return not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)
