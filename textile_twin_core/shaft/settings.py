"""Settings of the recursive shaft estimators."""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.shaft.turns import TURN


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of `causal` and `lag`; the defaults need no tuning.

    Attributes:
        harmonics: orders of ripple from 1 on that are in the state from the start.
        max_harmonics: orders up to this one join when the samples show them.
        encoder_bits: bits of the encoder per turn; None: found.
        resolution_rad: or its step.
        stamp_jitter_s: standard deviation of the stamps; None: learnt.
        response_s: time constant of the drive's answer to a load knock, to begin with; it is learnt.
        wrapping: "auto", "wrapped" or "unwrapped".
        period_rad: what a wrapping angle wraps by.
        gap_s: pause after which the estimator starts anew.
        memory_s: how long after an event its time stays open.
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
    memory_s: float = 0.04

    @property
    def step_rad(self) -> float | None:
        """The encoder's step, when given."""
        return self.resolution_rad if self.encoder_bits is None else self.period_rad / 2.0**self.encoder_bits
