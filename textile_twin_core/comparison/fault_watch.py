"""Watch turns of a machine against what was learnt of it, and raise alarms, with hysteresis."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.fault_band import SERIES as SERIES
from textile_twin_core.comparison.fault_band import Band, Departure, band_of
from textile_twin_core.comparison.fault_naming import OF_SAMPLES, SIDE, evidence_of, is_held, named, told, worth_telling
from textile_twin_core.comparison.fault_signatures import TurnFeatures

_GROWN, _TURNED = 2.0, 0.5
"""Times its size at which a fault that stands is told again, and so many times the other way."""
_ALIKE = 4.0
"""Standard deviations that the halves of some turns may differ by, to be alike."""
_MOST_KNOWN = 8
"""Bands that are kept while alarms stand."""


@dataclass(frozen=True)
class WatchSettings:
    """How the watch is set.

    Attributes:
        learn_turns: turns from which the machine's own band is learnt.
        memory_turns: turns over which the moving mean looks back.
        raise_sigmas, clear_sigmas: an alarm comes above the one and goes below the other.
        clear_turns: turns in a row below, until it goes.
        evidence_turns: turns that are looked at before a fault is named.
        settle_turns: turns alike after an alarm, from which on others are held against what holds since.
        least_share: smallest change of load, gain and of torques (share of the torque's size) worth an alarm.
        least_phase_rad: smallest slip of the angle worth one.
    """

    learn_turns: int = 100
    memory_turns: float = 12.0
    raise_sigmas: float = 8.0
    clear_sigmas: float = 4.0
    clear_turns: int = 10
    evidence_turns: int = 4
    settle_turns: int = 12
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

    The first evidence names a fault; what follows from it is not another. So once an alarm stands, turns are held
    against what holds since then; it goes when the turns are again as learnt at first.

    torque_Nm: size of the machine's torque, for what is worth an alarm.
    """

    torque_Nm: float
    settings: WatchSettings = field(default_factory=WatchSettings)

    def __post_init__(self) -> None:
        self._learning: list[TurnFeatures] = []
        self._known: list[Departure] = []  # from the band learnt at first, and from those that held since each alarm
        self._since: list[TurnFeatures] = []  # after the last alarm
        self._settling = False  # what holds since is not known yet
        self._calm: dict[str, int] = {}  # turns, by the kind of each fault that stands
        self._told: dict[str, Alarm] = {}  # the last of each kind
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
        return tuple(self._calm)

    @property
    def standing(self) -> tuple[Alarm, ...]:
        """The alarms of the faults that stand now, in the order of `active`."""
        return tuple(self._told[kind] for kind in self._calm)

    @property
    def learnt_turns(self) -> TurnFeatures:
        """The turns that went into the band, for `resume`; there is at least one once the watch has learnt."""
        return TurnFeatures.joined(self._learning)

    def resume(self, learnt: TurnFeatures, standing: Iterable[Alarm]) -> None:
        """Go on where an earlier watch of the same settings stopped.

        Args:
            learnt: its `learnt_turns`.
            standing: its alarms that stood; as after an alarm, what holds since is learnt from the turns to come.
        """
        self._learning = [learnt.where(slice(k, k + 1)) for k in range(learnt.number.size)]
        self._known = [self._departure(self._learning)]
        self._told = {evidence_of(alarm.kind): alarm for alarm in standing}
        self._calm = dict.fromkeys(self._told, 0)
        self._settling = bool(self._calm)

    def take(self, turns: TurnFeatures) -> tuple[list[Alarm], FloatArray]:
        """Take turns; the alarms that they raise, and (t, series) departures in sigmas (0 while learning)."""
        alarms: list[Alarm] = []
        rows = []
        for k in range(turns.number.size):
            rows.append(self._one(turns.where(slice(k, k + 1)), alarms))
        return alarms, np.array(rows).reshape(len(rows), len(SERIES))

    def _one(self, turn: TurnFeatures, alarms: list[Alarm]) -> FloatArray:
        if not self.learnt:
            self._learning.append(turn)
            if self.learnt:
                self._known = [self._departure(self._learning)]
            return np.zeros(len(SERIES))
        for departure in {id(each): each for each in (self._known[0], self._known[-1])}.values():
            departure.take(turn)
        self.latest = self._known[0].sigmas
        self._clear()
        self._judge(turn, alarms)
        return self.latest.copy()

    def _departure(self, turns: list[TurnFeatures]) -> Departure:
        memory = self.settings.memory_turns
        first = self._known[0].band if self._known else None
        return Departure(band_of(turns, self.torque_Nm, memory, first), memory)

    def _worth(self, band: Band) -> FloatArray:
        return worth_telling(band, self.torque_Nm, self.settings.least_share, self.settings.least_phase_rad)

    def _clear(self) -> None:
        s, away = self.settings, self._known[0].away
        for kind in self.active:
            calm = away[SERIES.index(kind)] < s.clear_sigmas
            self._calm[kind] = self._calm[kind] + 1 if calm else 0
            if self._calm[kind] >= s.clear_turns:
                del self._calm[kind]
                if not self._calm:
                    self._go_back_to(0)

    def _judge(self, turn: TurnFeatures, alarms: list[Alarm]) -> None:
        s = self.settings
        against = self._known[0] if self._settling else self._known[-1]
        out = (against.away > s.raise_sigmas) & (against.size > self._worth(against.band))
        if self._settling:
            out &= np.array([name in OF_SAMPLES and name not in self._calm for name in SERIES])
        if not self._suspected:
            if out.any():
                self._suspected = True  # the fault may have set in amid this turn, which shows it by half
            elif self._calm:
                self._settle(turn)
            return
        self._evidence.append(turn)
        if len(self._evidence) < s.evidence_turns:
            return
        kind, change = self._named(TurnFeatures.joined(self._evidence[-s.evidence_turns :]), against.band)
        if kind in ("profile", "noise") and len(self._evidence) < 2 * s.evidence_turns:
            return  # a slipped encoder disturbs the shaft's motion for some turns; what lasts is named
        evidence = TurnFeatures.joined(self._evidence)
        self._suspected, self._evidence = False, []
        if kind:
            self._tell(kind, change, evidence, against, alarms)

    def _named(self, recent: TurnFeatures, band: Band) -> tuple[str, float]:
        """The fault that turns show; none where they are as they were before an alarm."""
        for k, earlier in enumerate(self._known[:-1]):
            if is_held(recent, earlier.band, self._worth(earlier.band)):
                self._go_back_to(k)
                return "", 0.0
        kind, change = named(recent, band, self._worth(band))
        return ("", 0.0) if self._settling and kind not in OF_SAMPLES else (kind, change)

    def _tell(self, kind: str, change: float, evidence: TurnFeatures, against: Departure, alarms: list[Alarm]) -> None:
        """Raise the alarm of a fault that is new, has grown or has turned round; then see what holds since."""
        speed = float(np.mean(evidence.speed_rad_s))
        speed_known = any(each.band.knows_speed(speed) for each in self._known)
        size = change
        if kind in self._calm:
            before = self._told[kind].size
            size += before
            grown = size / before
            raised = kind != "profile" and (grown >= _GROWN or grown <= -_TURNED)  # a profile's size has no sign
            del self._known[max(1, len(self._known) - 1) :]  # what holds now takes its place
        else:
            # Beside an alarm another speed is reason enough for what its sensors' settings do there.
            raised = speed_known or not self._calm or kind in OF_SAMPLES
        self._since, self._settling = [], True
        if not raised:
            return
        name, text = told(kind, size, evidence, against.band, speed_known)
        turn, stamp = int(evidence.number[-1]), int(evidence.start_ns[-1])
        self._calm[kind] = 0
        self._told[kind] = Alarm(name, SIDE[name], turn, stamp, size, float(against.away.max()), text)
        alarms.append(self._told[kind])

    def _settle(self, turn: TurnFeatures) -> None:
        """Learn what holds while alarms stand: of the first turns that are alike, and better of more of them."""
        s = self.settings
        if len(self._known) == 1 and not self._settling:
            return  # all is as learnt at first
        if len(self._since) < s.learn_turns:
            self._since.append(turn)
        if self._settling:
            if len(self._since) < s.settle_turns:
                return
            if not _alike(self._known[0].band.rows(TurnFeatures.joined(self._since)), self._known[0].band):
                del self._since[0]
                return
            self._settling = False
            if len(self._known) == _MOST_KNOWN:
                del self._known[1]
            self._known.append(self._departure(self._since))
        elif self._is_time(len(self._since)) and bool(np.all(self._known[-1].away < s.clear_sigmas)):
            self._known[-1] = self._departure(self._since)

    def _is_time(self, turns: int) -> bool:
        """Whether so many turns tell more than those that were learnt from."""
        learnt = self._known[-1].band.turns
        return learnt < self.settings.learn_turns and turns >= min(2 * learnt, self.settings.learn_turns)

    def _go_back_to(self, number: int) -> None:
        """Hold turns against a band that was known before."""
        del self._known[number + 1 :]
        if number:
            self._known[number] = Departure(self._known[number].band, self.settings.memory_turns)
        self._since, self._settling = [], False


def _alike(rows: FloatArray, band: Band) -> bool:
    """Whether turns (t, series) are alike: their halves differ by no more than single turns tell."""
    half = rows.shape[0] // 2
    own = np.median(np.abs(np.diff(rows, axis=0)), axis=0) / 0.954  # of neighbours, which a step leaves as they are
    apart = np.abs(rows[:half].mean(axis=0) - rows[half:].mean(axis=0))
    return bool(np.all(apart < _ALIKE * np.maximum(own, band.sigma) * math.sqrt(2.0 / half)))
