"""What an estimator reports: counts of accepted and rejected samples and of events, and what it learnt."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

REJECTION_CAUSES = ("not_finite", "duplicate_stamp", "older_stamp")
EVENTS = ("repeat", "gap", "jump", "outlier", "reversal", "standstill", "loss")
FEW_SAMPLES_A_TURN = 5.0  # below this even the second order of ripple has fewer than 2.5 samples a wave


@dataclass
class SampleReport:
    """Counts since the start or the last reset.

    Attributes:
        received, accepted: samples that came in, and of these the ones that were used.
        rejected: count by cause: not_finite (angle or stamp NaN, infinite or over 1e12 rad or s), duplicate_stamp (less
            than a nanosecond after the newest accepted sample), older_stamp (late or reversed).
        repeats: readings equal to the one before, of a sensor that measures less often than it is asked, and those that
            came late, at once with the one before.
        gaps: pauses of more than 50 intervals, or in which a wrapped angle may have made a turn more or less; where the
            prediction failed after one, the filter was restarted.
        jumps: lasting offsets of the angle that no shaft can make.
        outliers: readings rejected because of their residual.
        reversals: changes of the sense of rotation.
        standstills: times that the shaft came to rest.
        losses: times that readings fitted no motion and the filter was restarted.
        longest_gap_s, period_s: longest and typical time between accepted samples.
        samples_per_turn: at the present speed; infinite at rest.
        resolution_rad: encoder step, given or found; 0 while unknown, and where readings are not rounded.
        stamp_jitter_s: standard deviation of the stamps, given or found.
        pitch_errors_rad: of each tooth, given or learnt; empty for sampled angles.
        ripple: amplitude of the speed's ripple relative to the speed, by multiples of the lowest order,
            1 / cycle_turns; empty where none is seen.
        state: waiting, starting, running, standstill or lost (restarted within the last 25 samples).
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
        values = {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}
        return {name: None if value == float("inf") else value for name, value in values.items()}

    def text(self) -> str:
        """One line for people: samples used, samples rejected by cause, events, and the state."""
        parts = [f"{self.state}: {self.accepted} of {self.received} samples used"]
        if self.rejected_total:
            causes = [f"{count} {cause.replace('_', ' ')}" for cause, count in self.rejected.items() if count]
            parts.append(f"rejected {', '.join(causes)}")
        for event in EVENTS:
            plural = "losses" if event == "loss" else f"{event}s"
            if count := getattr(self, plural):
                parts.append(f"{count} {plural if count > 1 else event}")
        if self.samples_per_turn < FEW_SAMPLES_A_TURN:
            parts.append(
                f"{self.samples_per_turn:.1f} samples a turn: too few to tell the ripple of the speed within a turn;"
                f" give {FEW_SAMPLES_A_TURN:.0f} or more"
            )
        return "; ".join(parts)
