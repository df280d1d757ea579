"""Settings of the shaft estimators, checked when they are given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TypeGuard

from textile_twin_core.errors import SceneError
from textile_twin_core.shaft.turns import TURN

WRAPPINGS = ("auto", "wrapped", "unwrapped")


@dataclass(frozen=True, kw_only=True)
class ShaftSettings:
    """What all estimators can be told; the defaults need no tuning.

    Attributes:
        harmonics: orders of ripple from 1 on that are in the model from the start, whatever the data say.
        max_harmonics: orders up to this one join when the samples show them.
        encoder_bits: bits of the encoder per turn; None: found.
        resolution_rad: or its step.
        stamp_jitter_s: standard deviation of the stamps; None: learnt.
        response_s: time constant of the drive's answer to a load knock, to begin with; it is learnt.
        wrapping: "auto", "wrapped" or "unwrapped".
        period_rad: what a wrapping angle wraps by.
        gap_s: pause after which the estimator starts anew; infinite: never.

    Raises:
        SceneError: a setting of the wrong kind or value.
    """

    harmonics: int = 2
    max_harmonics: int = 8
    encoder_bits: float | None = None
    resolution_rad: float | None = None
    stamp_jitter_s: float | None = None
    response_s: float = 0.04
    wrapping: str = "auto"
    period_rad: float = TURN
    gap_s: float = 1.0

    def __post_init__(self) -> None:
        for name in ("harmonics", "max_harmonics"):
            value: object = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < 0:
                raise SceneError(f"{name} is {value!r}: give a whole number, 0 or more")
        if self.max_harmonics < self.harmonics:
            raise SceneError(
                f"max_harmonics is {self.max_harmonics}, less than harmonics, {self.harmonics}: give at least as many"
            )
        for name in ("encoder_bits", "resolution_rad"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        jitter: object = self.stamp_jitter_s
        if jitter is not None and not (_is_finite(jitter) and jitter >= 0):
            raise SceneError(f"stamp_jitter_s is {jitter!r}: give a finite number, 0 or more, or None")
        require_positive("response_s", self.response_s)
        require_positive("period_rad", self.period_rad)
        if self.gap_s != math.inf:
            require_positive("gap_s", self.gap_s)
        if self.wrapping not in WRAPPINGS:
            raise SceneError(f"wrapping is {self.wrapping!r}: choose one of {', '.join(WRAPPINGS)}")

    @property
    def step_rad(self) -> float | None:
        """The encoder's step, when given."""
        return self.resolution_rad if self.encoder_bits is None else self.period_rad / 2.0**self.encoder_bits


@dataclass(frozen=True, kw_only=True)
class SmoothSettings(ShaftSettings):
    """Settings of `smooth`, which tells more orders apart since it has the whole record."""

    max_harmonics: int = 16


@dataclass(frozen=True, kw_only=True)
class TrackerSettings(ShaftSettings):
    """Settings of `causal` and `lag`.

    Attributes:
        memory_s: how long after an event its time stays open.
    """

    memory_s: float = 0.04

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("memory_s", self.memory_s)


def require_positive(name: str, value: object) -> None:
    """Refuse a setting that is no positive finite number.

    Raises:
        SceneError: it is none.
    """
    if not (_is_finite(value) and value > 0):
        raise SceneError(f"{name} is {value!r}: give a positive finite number")


def _is_finite(value: object) -> TypeGuard[float]:
    return not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)
