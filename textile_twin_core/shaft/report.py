"""What became of the samples: counts of accepted and rejected samples, events, and what was learnt of the encoder."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

REJECTION_CAUSES = ("not_finite", "duplicate_stamp", "older_stamp")
FEW_SAMPLES_A_TURN = 5.0
"""Below this not even the second order of ripple can be told: 2.5 samples a wave."""


@dataclass
class SampleReport:
    """Counts since the start or the last reset; a plain record that turns into JSON with `to_json`.

    Attributes:
        received: samples that came in.
        accepted: samples that were used.
        rejected: count by cause: not_finite (NaN or infinite angle or stamp), duplicate_stamp (that of the newest
            accepted sample), older_stamp (late or reversed).
        repeats: readings that only say the one before again, of a sensor that measures less often than it is asked.
        gaps: pauses between samples of more than 50 intervals; where the reading after one was not foretold, the motion
            was found anew.
        jumps: lasting leaps of the angle that no shaft can make.
        outliers: readings far off, set aside.
        reversals: changes of the sense of rotation.
        standstills: times that the shaft came to rest.
        losses: times that readings followed no motion and everything began anew.
        longest_gap_s: the longest time between two accepted samples.
        period_s: typical time between samples.
        samples_per_turn: at the speed of now; infinite at rest.
        resolution_rad: encoder step, given or found; 0 while unknown, and where readings are not rounded.
        stamp_jitter_s: standard deviation of the stamps, given or found.
        pitch_errors_rad: of each tooth, given or learnt; empty for sampled angles.
        ripple: amplitude of the speed's ripple relative to the speed, by multiples of the lowest order,
            1 / cycle_turns; empty where none is seen.
        state: waiting, starting, running, standstill or lost (began anew within the last 25 samples).
    """

    received: int = 0
    accepted: int = 0
    rejected: dict[str, int] = field(default_factory=lambda: dict.fromkeys(REJECTION_CAUSES, 0))
    repeats: int = 0
    gaps: int = 0
    jumps: int = 0
    outliers: int = 0
    reversals: int = 0
    standstills: int = 0
    losses: int = 0
    longest_gap_s: float = 0.0
    period_s: float = 0.0
    samples_per_turn: float = float("inf")
    resolution_rad: float = 0.0
    stamp_jitter_s: float = 0.0
    pitch_errors_rad: tuple[float, ...] = ()
    ripple: tuple[float, ...] = ()
    state: str = "waiting"

    @property
    def rejected_total(self) -> int:
        """Rejected samples of every cause."""
        return sum(self.rejected.values())

    def to_json(self) -> dict[str, object]:
        """A dictionary of plain numbers, lists and texts; an infinite number is None."""
        rate = self.samples_per_turn
        return {
            **asdict(self),
            "ripple": list(self.ripple),
            "pitch_errors_rad": list(self.pitch_errors_rad),
            "samples_per_turn": rate if rate < float("inf") else None,
        }

    def text(self) -> str:
        """One line for people: what was used, what was not and why, and how the estimator stands."""
        causes = ", ".join(f"{count} {cause.replace('_', ' ')}" for cause, count in self.rejected.items() if count)
        parts = [f"{self.state}: {self.accepted} of {self.received} samples used"]
        if causes:
            parts.append(f"rejected {causes}")
        for name in ("repeats", "gaps", "jumps", "outliers", "reversals", "standstills", "losses"):
            count = getattr(self, name)
            if count:
                parts.append(f"{count} {name if count > 1 else name[:-1] if name != 'losses' else 'loss'}")
        if self.samples_per_turn < FEW_SAMPLES_A_TURN:
            parts.append(
                f"{self.samples_per_turn:.1f} samples a turn: too few to tell the ripple of the speed within a turn;"
                f" give {FEW_SAMPLES_A_TURN:.0f} or more"
            )
        return "; ".join(parts)
