"""What became of the samples: counts of accepted and rejected samples, events, and what was learnt of the encoder."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

REJECTION_CAUSES = ("not_finite", "duplicate_stamp", "older_stamp")


@dataclass
class SampleReport:
    """Counts since the start or the last reset; a plain record that turns into JSON with `to_json`.

    Attributes:
        received: samples that came in.
        accepted: samples that were used.
        rejected: count by cause: not_finite (NaN or infinite angle or stamp), duplicate_stamp (that of the newest
            accepted sample), older_stamp (late or reversed).
        gaps: pauses between samples after which the estimator started anew.
        jumps: lasting leaps of the angle that no shaft can make.
        outliers: single readings far off, bridged.
        reversals: changes of the sense of rotation.
        standstills: times that the shaft came to rest.
        knocks: sudden changes of the acceleration that were recognised.
        transients: times that the motion left every expectation and the estimator opened itself.
        longest_gap_s: the longest time between two accepted samples.
        period_s: typical time between samples.
        resolution_rad: encoder step, given or found; 0 while unknown.
        stamp_jitter_s: standard deviation of the stamps, given or found.
        ripple: relative amplitude of the speed's ripple by order of the shaft, from order 1 on.
        state: one of waiting, settling, running, standstill.
    """

    received: int = 0
    accepted: int = 0
    rejected: dict[str, int] = field(default_factory=lambda: dict.fromkeys(REJECTION_CAUSES, 0))
    gaps: int = 0
    jumps: int = 0
    outliers: int = 0
    reversals: int = 0
    standstills: int = 0
    knocks: int = 0
    transients: int = 0
    longest_gap_s: float = 0.0
    period_s: float = 0.0
    resolution_rad: float = 0.0
    stamp_jitter_s: float = 0.0
    ripple: tuple[float, ...] = ()
    state: str = "waiting"

    @property
    def rejected_total(self) -> int:
        """Rejected samples of every cause."""
        return sum(self.rejected.values())

    def to_json(self) -> dict[str, object]:
        """A dictionary of plain numbers, lists and texts."""
        return {**asdict(self), "ripple": list(self.ripple)}

    def text(self) -> str:
        """One line for people: what was used, what was not and why, and how the estimator stands."""
        causes = ", ".join(f"{count} {cause.replace('_', ' ')}" for cause, count in self.rejected.items() if count)
        parts = [f"{self.state}: {self.accepted} of {self.received} samples used"]
        if causes:
            parts.append(f"rejected {causes}")
        for name in ("gaps", "jumps", "outliers", "reversals", "standstills", "knocks", "transients"):
            count = getattr(self, name)
            if count:
                parts.append(f"{count} {name if count > 1 else name[:-1]}")
        return "; ".join(parts)
