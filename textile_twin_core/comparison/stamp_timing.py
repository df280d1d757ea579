"""Uncertainty due to stamps in bursts: the wider interval of the delay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from textile_twin_core.comparison.uncertainty import Estimate

REPEATED = 1e-6
"""Time inside a burst up to which stamps count as equal: a coarse clock [s]."""


@dataclass(frozen=True)
class StampBursts:
    """Pattern of stamps that come in bursts.

    Attributes:
        samples: samples in a burst, median.
        inside_s: time from the first to the last of them, median [s].
        pause_s: time to the next burst, median [s]; of single samples the shorter of the usual intervals.
        longer_s: of single samples, which come at uneven intervals, the longer of the usual intervals [s].
    """

    samples: int
    inside_s: float
    pause_s: float
    longer_s: float = 0.0

    @property
    def period_s(self) -> float:
        """Time from burst to burst [s]."""
        return self.inside_s + self.pause_s

    @property
    def repeated(self) -> bool:
        """True where the stamps inside a burst are equal, as of a coarse clock."""
        return self.samples > 1 and self.inside_s <= REPEATED

    @property
    def text(self) -> str:
        """The pattern in words, with its numbers."""
        pause = f"{self.pause_s * 1e3:.3g} ms"
        if self.samples == 1:
            return f"even samples at intervals of {pause} or {self.longer_s * 1e3:.3g} ms: stamped on arrival"
        if self.repeated:
            return f"{self.samples} samples with one stamp, the next {pause} later: stamped by a coarse clock"
        inside = f"{self.inside_s * 1e3:.2g} ms" if self.inside_s > 1e-5 else f"{self.inside_s * 1e6:.2g} us"
        return f"{self.samples} samples within {inside}, then {pause}: stamped on arrival"


@dataclass(frozen=True)
class StampTiming:
    """Pattern of a topic's stamps in bursts, and the precision of the reconstructed times.

    Attributes:
        topic: their topic.
        bursts: the pattern of the stamps.
        period_s: sampling period of the reconstructed times [s].
        half_width_s: half the width of the interval of their common offset [s].
    """

    topic: str
    bursts: StampBursts
    period_s: float
    half_width_s: float

    @property
    def text(self) -> str:
        """Description of the pattern and its treatment."""
        return (
            f"topic {self.topic}: {self.bursts.text}; used instead: even times, {self.period_s * 1e3:.4g} ms apart,"
            f" together right within +-{self.half_width_s * 1e3:.2g} ms beside the constant latency of the link, which"
            " no stamp shows"
        )


def half_width(timings: Sequence[StampTiming]) -> float:
    """Half the width of the delay's interval due to the offsets of angle and torque [s]."""
    return sum(timing.half_width_s for timing in timings)


def widened(delay: Estimate, timings: Sequence[StampTiming]) -> Estimate:
    """Widen the interval of an estimated delay [s] by the uncertainty of the stamps."""
    half = half_width(timings)
    if not timings or math.isnan(delay.sigma):
        return delay
    return Estimate.normal(delay.value, math.hypot(delay.sigma, half))
