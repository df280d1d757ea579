"""Watch turns of a machine against what was learnt of it, and raise alarms, with hysteresis."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.fault_signatures import BINS, KINDS, TurnFeatures

SERIES = (*KINDS, "noise", "profile", "dropout", "stuck")
"""What is watched, turn by turn."""
SIDE = {
    "load_force": "needle",
    "constant_torque": "drive",
    "sensor_offset": "sensor",
    "sensor_gain": "sensor",
    "phase": "sensor",
    "noise": "sensor",
    "profile": "drive",
    "dropout": "sensor",
    "stuck": "sensor",
}
_ONE_SIDED = np.array([name not in KINDS for name in SERIES])
_MOST = 0.6
"""Share of what is new that one explanation must take to be named."""
_FAR = 8.0
"""Scatters from the median beyond which a turn that is learnt from counts no more than there."""


@dataclass(frozen=True)
class WatchSettings:
    """How the watch is set.

    Attributes:
        learn_turns: turns from which the machine's own band is learnt.
        memory_turns: turns over which the moving mean looks back (exponentially weighted; Roberts 1959).
        raise_sigmas, clear_sigmas: an alarm comes above the one and goes below the other.
        clear_turns: turns in a row below, until it goes.
        evidence_turns: turns that are looked at before a fault is named.
        least_share: smallest change of load, gain and of torques (share of the torque's size) worth an alarm.
        least_phase_rad: smallest slip of the angle worth one.
    """

    learn_turns: int = 100
    memory_turns: float = 12.0
    raise_sigmas: float = 8.0
    clear_sigmas: float = 4.0
    clear_turns: int = 10
    evidence_turns: int = 4
    least_share: float = 0.01
    least_phase_rad: float = 0.003


@dataclass(frozen=True)
class Alarm:
    """A fault that set in.

    Attributes:
        kind: what the evidence is (see `SERIES`). side: needle, drive or sensor. turn, stamp_ns: when it was raised.
        size: of the change, in the unit of its kind. sigmas: how far outside the band. text: for a person.
    """

    kind: str
    side: str
    turn: int
    stamp_ns: int
    size: float
    sigmas: float
    text: str


@dataclass
class FaultWatch:
    """Takes turns in order; learns first, then watches. State lives between the calls.

    torque_Nm: size of the machine's torque, for what is worth an alarm.
    """

    torque_Nm: float
    settings: WatchSettings = field(default_factory=WatchSettings)

    def __post_init__(self) -> None:
        self._learning: list[FloatArray] = []
        self._profiles: list[FloatArray] = []
        self._mean = self._sigma = np.zeros(len(SERIES))
        self._profile_mean, self._profile_sigma = np.zeros(BINS), np.ones(BINS)
        self._moving = np.zeros(len(SERIES))
        self._usual_count = 0.0
        self._counts: list[int] = []
        self._active: dict[str, int] = {}
        self._suspected = False
        self._evidence: list[TurnFeatures] = []
        self.latest = np.zeros(len(SERIES))

    @property
    def learnt(self) -> bool:
        """Whether the band is known."""
        return len(self._learning) >= self.settings.learn_turns

    @property
    def turns_learnt(self) -> int:
        """Turns that went into the band."""
        return len(self._learning)

    @property
    def active(self) -> tuple[str, ...]:
        """Kinds of faults that stand now."""
        return tuple(self._active)

    def take(self, turns: TurnFeatures) -> tuple[list[Alarm], FloatArray]:
        """Take turns; the alarms that they raise, and (t, series) departures in sigmas (0 while learning)."""
        alarms: list[Alarm] = []
        rows = []
        for k in range(turns.number.size):
            rows.append(self._one(turns, k, alarms))
        return alarms, np.array(rows).reshape(len(rows), len(SERIES))

    def _one(self, turns: TurnFeatures, k: int, alarms: list[Alarm]) -> FloatArray:
        profile = turns.profile_Nm[k]
        if not self.learnt:
            self._counts.append(int(turns.count[k]))
            self._profiles.append(profile)
            self._learning.append(self._row(turns, k))
            if self.learnt:
                self._learn()
            return np.zeros(len(SERIES))
        departure = (self._row(turns, k) - self._mean) / self._sigma
        # One turn that is far out moves the mean at once; a lasting small one moves it in time.
        share = 1.0 / self.settings.memory_turns
        self._moving += share * (np.clip(departure, -200.0, 200.0) - self._moving)
        spread = math.sqrt(share / (2.0 - share))
        self.latest = self._moving / spread
        self._raise_and_clear(turns, k, alarms)
        return self.latest.copy()

    def _row(self, turns: TurnFeatures, k: int) -> FloatArray:
        """The watched series of a turn."""
        usual = float(np.median(self._counts)) if not self.learnt else self._usual_count
        # Samples come by time, so a slower turn holds more of them.
        profile = turns.profile_Nm[k]
        bump = 0.0
        if self.learnt:
            bump = float(np.mean(((np.nan_to_num(profile) - self._profile_mean) / self._profile_sigma) ** 2))
        return np.array(
            [
                *turns.sizes[k],
                math.log(max(float(turns.noise_Nm[k]), 1e-300)),
                math.log(max(bump, 1e-3)),
                -float(turns.count[k]) * abs(float(turns.speed_rad_s[k])) / max(usual, 1.0),
                float(turns.stuck[k]),
            ]
        )

    def _learn(self) -> None:
        self._usual_count = float(np.median(self._counts))
        profiles = np.array(self._profiles)
        profiles = np.nan_to_num(profiles)  # bins that never hold a sample, beside a leap of the load
        self._profile_mean = np.median(profiles, axis=0)
        spread = 1.4826 * np.median(np.abs(profiles - self._profile_mean), axis=0)
        self._profile_sigma = np.maximum(spread, 0.3 * float(np.median(spread)) + 1e-12)
        rows = np.array(self._learning)
        away = (profiles - self._profile_mean) / self._profile_sigma
        rows[:, SERIES.index("profile")] = np.log(np.maximum(np.mean(away**2, axis=1), 1e-3))
        rows[:, SERIES.index("dropout")] *= np.median(self._counts) / max(self._usual_count, 1.0)
        self._mean = np.median(rows, axis=0)
        self._sigma = self._scatter(rows)

    def _scatter(self, rows: FloatArray) -> FloatArray:
        """Scatter of a turn; more where neighbouring turns go together, as their mean then scatters more."""
        alone = 1.4826 * np.median(np.abs(rows - self._mean), axis=0)
        floor = np.array([1e-4, 1e-4 * self.torque_Nm, 1e-4, 1e-5, 0.03, 0.05, 0.02 * abs(self._mean[6]) + 1e-6, 0.03])
        # A mean takes a single wrong value in, however far off it is; the band would be that wide for good.
        far = _FAR * np.maximum(alone, floor)
        rows = np.clip(rows, self._mean - far, self._mean + far)
        block = min(max(2, round(self.settings.memory_turns)), rows.shape[0])
        means = rows[: rows.shape[0] // block * block].reshape(-1, block, rows.shape[1]).mean(axis=1)
        together = np.std(means, axis=0) * math.sqrt(block)
        return np.asarray(np.maximum(np.maximum(alone, together), floor))

    def _worth(self) -> FloatArray:
        """Smallest change of each series that is worth an alarm."""
        s = self.settings
        small = s.least_share
        return np.array(
            [2.0 * small, small * self.torque_Nm, small, s.least_phase_rad, 0.25, 0.7, 0.1 * abs(self._mean[6]), 0.2]
        )

    def _raise_and_clear(self, turns: TurnFeatures, k: int, alarms: list[Alarm]) -> None:
        s = self.settings
        size = self._moving * self._sigma
        # Too much noise, too few samples and a stuck value count when they grow, the others either way.
        away = np.where(_ONE_SIDED, self.latest, np.abs(self.latest))
        out = (away > s.raise_sigmas) & (np.where(_ONE_SIDED, size, np.abs(size)) > self._worth())
        for kind in list(self._active):
            calm = away[SERIES.index(kind)] < s.clear_sigmas
            self._active[kind] = self._active[kind] + 1 if calm else 0
            if self._active[kind] >= s.clear_turns:
                del self._active[kind]
        if self._active:
            return  # the first evidence names the fault; what follows from it is not another
        if not self._suspected:
            if out.any():
                self._suspected = True  # the fault may have set in amid this turn, which shows it by half
            return
        self._evidence.append(_one_turn(turns, k))
        if len(self._evidence) < s.evidence_turns:
            return
        kind, change = self._named(self._evidence[-s.evidence_turns :])
        if kind in ("profile", "noise") and len(self._evidence) < 2 * s.evidence_turns:
            return  # a slipped encoder disturbs the shaft's motion for some turns; what lasts is named
        self._suspected, evidence, self._evidence = False, self._evidence, []
        if kind:
            self._active[kind] = 0
            alarms.append(self._alarm(kind, change, evidence, float(away.max())))

    def _named(self, evidence: list[TurnFeatures]) -> tuple[str, float]:
        """The kind of fault that a few turns show, and its size; empty when it has gone.

        A single signature is named when it alone takes most of what the residual has more than learnt (the likeliest of
        one-parameter explanations); else what is the same in every turn is an unknown torque, and what is not is noise.
        """
        rows = np.mean([self._row(turns, 0) for turns in evidence], axis=0) - self._mean
        worth = self._worth()
        for kind in ("stuck", "dropout"):
            k = SERIES.index(kind)
            if rows[k] > worth[k] and rows[k] > 3.0 * self._sigma[k]:
                return kind, float(rows[k])
        learnt = self._mean[: len(KINDS)]
        normal = np.mean([turns.normal[0] for turns in evidence], axis=0)
        right = np.mean([turns.right[0] for turns in evidence], axis=0) - normal @ learnt
        power = float(np.mean([turns.rms_Nm[0] ** 2 for turns in evidence]))
        power += float(learnt @ normal @ learnt - 2.0 * learnt @ (right + normal @ learnt))
        excess = power - math.exp(2.0 * self._mean[SERIES.index("noise")])
        taken = right**2 / np.maximum(np.diag(normal), 1e-300)
        best = int(np.argmax(taken))
        size = float(right[best] / max(normal[best, best], 1e-300))
        if taken[best] > _MOST * excess and abs(size) > worth[best]:
            return KINDS[best], size
        profiles = np.nan_to_num(np.array([turns.profile_Nm[0] for turns in evidence])) - self._profile_mean
        lasting, each = float(np.mean(np.mean(profiles, axis=0) ** 2)), float(np.mean(profiles**2))
        if lasting > _MOST * each:
            return "profile", float(np.sqrt(lasting))
        k = SERIES.index("noise")
        return ("noise", float(rows[k])) if rows[k] > worth[k] else ("", 0.0)

    def _alarm(self, kind: str, size: float, evidence: list[TurnFeatures], sigmas: float) -> Alarm:
        last = evidence[-1]
        against = kind == "constant_torque" and size * math.copysign(1.0, float(last.speed_rad_s[0])) < 0.0
        name = "sensor_offset" if against else kind
        away = np.mean([np.nan_to_num(turns.profile_Nm[0]) for turns in evidence], axis=0) - self._profile_mean
        angle = (float(np.argmax(np.abs(away))) + 0.5) * 360.0 / BINS
        text = {
            "load_force": f"needle side: the loads changed by {size:+.1%}",
            "constant_torque": f"drive side: friction changed by {size:+.3g} N m (or the torque sensor's offset)",
            "sensor_offset": f"torque sensor: offset changed by {size:+.3g} N m (or the drive runs freer)",
            "sensor_gain": f"torque sensor: gain changed by {size:+.1%}",
            "phase": f"encoder or its coupling: the angle slipped by {math.degrees(size):+.2f} deg",
            "noise": f"torque sensor: {math.exp(min(size, 20.0)):.2g} times as much noise as learnt",
            "profile": f"drive side: a torque that the model does not know, most at {angle:.0f} deg",
            "dropout": "torque sensor: samples are missing",
            "stuck": "torque sensor: its value stands still",
        }[name]
        return Alarm(name, SIDE[name], int(last.number[0]), int(last.start_ns[0]), size, sigmas, text)


def _one_turn(turns: TurnFeatures, k: int) -> TurnFeatures:
    return TurnFeatures(**{name: getattr(turns, name)[k : k + 1] for name in TurnFeatures.__dataclass_fields__})
