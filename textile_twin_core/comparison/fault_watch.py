"""Watch over the turns of a machine: learn a band, compare with it, raise and clear alarms with hysteresis."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.fault_band import SAME_SPEED, Band, Departure, band_of
from textile_twin_core.comparison.fault_band import SERIES as SERIES
from textile_twin_core.comparison.fault_naming import (
    OF_SAMPLES,
    SIDE,
    agrees_with,
    alarm_text,
    alarm_thresholds,
    evidence_of,
    named,
)
from textile_twin_core.comparison.fault_signatures import TurnFeatures

_GROWN, _TURNED = 2.0, 0.5
"""Growth of a standing fault, relative to its size, at which its alarm is repeated; the same with opposite sign."""
_ALIKE = 4.0
"""Largest difference of the halves of a set of like turns, in standard deviations."""
_CALM = 0.5
"""Share of the smallest change worth an alarm below which a standing fault is calm: cloth is never as learnt."""
_MOST_KNOWN = 8
"""Most bands in memory while alarms stand."""
_UNSURE, _LEAST_UNSURE = 2.0, 0.02
"""A turn is left out where its torque is this many times less certain than in the learnt turns, by the acceleration; an
uncertainty below the second number, a share of the torque's size, never counts."""
_SURE, _BEST = 1.5, 0.2
"""Turns are learnt whose torque is at most this many times less certain than that of the best, by quantile: an
estimator that begins is uncertain for many turns."""
_SHARED, _LOOKS = 0.1, 20
"""Turns are learnt at speeds at which this share of the turns to learn is made: a run-up passes each speed once. Looks
for them while `learn_turns` pass."""


@dataclass(frozen=True)
class WatchSettings:
    """Settings of the watch.

    Attributes:
        learn_turns: turns from which the machine's own band is learnt.
        memory_turns: length of the moving mean in turns.
        raise_sigmas, clear_sigmas: thresholds above which an alarm is raised and below which it is cleared.
        clear_turns: turns in a row below the threshold before an alarm is cleared.
        evidence_turns: turns examined before a fault is named.
        settle_turns: like turns after an alarm that give the new band to compare with.
        least_share: smallest change of load, gain and of torques (share of the torque's size) worth an alarm.
        least_phase_rad: smallest slip of the angle worth an alarm.
        least_cloth, least_pierce: where the load has a pierce, smallest change of its force both ways, and smallest
            growth of the pierce beside it, worth an alarm. Cloth differs by less from roll to roll.
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
    least_cloth: float = 0.25
    least_pierce: float = 0.05


@dataclass(frozen=True)
class Alarm:
    """Alarm of a new fault.

    Attributes:
        kind: kind of the evidence (see `SERIES`). side: needle, drive or sensor. turn, stamp_ns: when it was raised.
        size: of the change, in the unit of its kind. sigmas: distance from the band. text: for a person.
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
    """Watch over turns in their order: first learn a band, then compare with it. Keeps its state between calls.

    A fault is named once; its consequences are no new faults. So while an alarm stands, turns are compared with a
    band learnt after it. The alarm is cleared when the turns agree with the first band.

    torque_Nm: size of the machine's torque; smallest changes worth an alarm are shares of it.
    has_pierce: the load has a part that tells blunt needles from other cloth.
    """

    torque_Nm: float
    settings: WatchSettings = field(default_factory=WatchSettings)
    has_pierce: bool = False

    def __post_init__(self) -> None:
        self._learning: list[TurnFeatures] = []
        self._unsure: list[float] = []  # of the learnt turns; empty after `resume`
        self.unwatched = 0  # turns taken until the first band was learnt
        self._known: list[Departure] = []  # from the first band, and from the band after each alarm
        self._since: list[TurnFeatures] = []  # after the last alarm
        self._settling = False  # the band after the last alarm is not learnt yet
        self._calm: dict[str, int] = {}  # calm turns, by the kind of each standing fault
        self._raised: dict[str, Alarm] = {}  # the last of each kind
        self._shown: dict[str, int] = {}  # series that shows each standing fault, where it is not that of its kind
        self._suspected = False
        self._evidence: list[TurnFeatures] = []
        self.latest = np.zeros(len(SERIES))

    @property
    def learnt(self) -> bool:
        """True once the first band is learnt."""
        return bool(self._known)

    @property
    def turns_learnt(self) -> int:
        """Turns that went into the band."""
        return len(self._learning)

    @property
    def active(self) -> tuple[str, ...]:
        """Kinds of the standing faults."""
        return tuple(self._calm)

    @property
    def standing(self) -> tuple[Alarm, ...]:
        """Alarms of the standing faults, in the order of `active`."""
        return tuple(self._raised[kind] for kind in self._calm)

    @property
    def learnt_turns(self) -> TurnFeatures:
        """Turns that went into the band, for `resume`; at least one once the watch has learnt."""
        return TurnFeatures.joined(self._learning)

    def resume(self, learnt: TurnFeatures, standing: Iterable[Alarm]) -> None:
        """Resume an earlier watch of the same settings.

        Args:
            learnt: its `learnt_turns`.
            standing: its standing alarms; as after an alarm, a new band is learnt from the next turns.
        """
        self._learning = [learnt.where(slice(k, k + 1)) for k in range(learnt.number.size)]
        self._known = [self._departure(self._learning)]
        self._raised = {evidence_of(alarm.kind): alarm for alarm in standing}
        self._calm = dict.fromkeys(self._raised, 0)
        self._settling = bool(self._calm)

    def take(self, turns: TurnFeatures, unsure: FloatArray) -> tuple[list[Alarm], FloatArray]:
        """Watch turns.

        Args:
            turns: (t,) turns.
            unsure: (t,) standard deviation of the predicted torque in each, by the shaft's acceleration [N m].

        Returns:
            The alarms that they raise, and departures (t, series) in sigmas, 0 while learning.
        """
        alarms: list[Alarm] = []
        rows = []
        for k in range(turns.number.size):
            rows.append(self._one(turns.where(slice(k, k + 1)), float(unsure[k]), alarms))
        return alarms, np.array(rows).reshape(len(rows), len(SERIES))

    def _one(self, turn: TurnFeatures, unsure: float, alarms: list[Alarm]) -> FloatArray:
        if not self.learnt:
            self.unwatched += 1
            most = 4 * self.settings.learn_turns
            self._learning = [*self._learning[1 - most :], turn]
            self._unsure = [*self._unsure[1 - most :], unsure]
            usual = self._usual()
            if usual.sum() >= self.settings.learn_turns:
                self._learning = [self._learning[k] for k in np.flatnonzero(usual)]
                self._unsure = np.array(self._unsure)[usual].tolist()
                self._known = [self._departure(self._learning)]
            return np.zeros(len(SERIES))
        least = _LEAST_UNSURE * self.torque_Nm
        if self._unsure and unsure > max(_UNSURE * float(np.median(self._unsure)), least):
            return self.latest.copy()
        for departure in {id(each): each for each in (self._known[0], self._known[-1])}.values():
            departure.take(turn)
        self.latest = self._known[0].sigmas
        self._clear()
        self._judge(turn, alarms)
        return self.latest.copy()

    def _usual(self) -> BoolArray:
        """Mask of the turns so far at speeds that many of them share, and with no uncertain motion; all false between
        two looks.
        """
        turns, enough = self._learning, self.settings.learn_turns
        if len(turns) < enough or self.unwatched % max(enough // _LOOKS, 1):
            return np.zeros(len(turns), dtype=np.bool_)
        unsure = np.array(self._unsure)
        sure = unsure <= max(_SURE * float(np.quantile(unsure, _BEST)), _LEAST_UNSURE * self.torque_Nm)
        speeds = np.abs(np.concatenate([turn.speed_rad_s for turn in turns]))
        ranked = np.sort(speeds[sure])
        above = np.searchsorted(ranked, (1.0 + SAME_SPEED) * speeds, side="right")
        shared = above - np.searchsorted(ranked, (1.0 - SAME_SPEED) * speeds) >= _SHARED * enough
        return np.asarray(sure & shared)

    def _departure(self, turns: list[TurnFeatures]) -> Departure:
        memory = self.settings.memory_turns
        first = self._known[0].band if self._known else None
        return Departure(band_of(turns, self.torque_Nm, memory, first), memory)

    def _worth(self, band: Band) -> FloatArray:
        s = self.settings
        load = s.least_cloth if self.has_pierce else 2.0 * s.least_share
        return alarm_thresholds(band, self.torque_Nm, load, s.least_share, s.least_phase_rad, s.least_pierce)

    def _clear(self) -> None:
        s, first = self.settings, self._known[0]
        small = first.size < _CALM * self._worth(first.band)
        for kind in self.active:
            k = self._shown.get(kind, SERIES.index(kind))
            calm = first.away[k] < s.clear_sigmas or small[k]
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
                self._suspected = True  # the fault may have begun within this turn, which then shows only part of it
            elif self._calm:
                self._settle(turn)
            return
        self._evidence.append(turn)
        if len(self._evidence) < s.evidence_turns:
            return
        kind, change = self._named(TurnFeatures.joined(self._evidence[-s.evidence_turns :]), against.band)
        if kind in ("profile", "noise") and len(self._evidence) < 2 * s.evidence_turns:
            return  # a slipped encoder disturbs the motion for some turns; only a lasting change is named
        evidence = TurnFeatures.joined(self._evidence)
        self._suspected, self._evidence = False, []
        if kind:
            self._tell(kind, change, evidence, against, alarms)

    def _named(self, recent: TurnFeatures, band: Band) -> tuple[str, float]:
        """Name the fault that turns show; empty if they agree with a band from before an alarm."""
        for k, earlier in enumerate(self._known[:-1]):
            if agrees_with(recent, earlier.band, self._worth(earlier.band)):
                self._go_back_to(k)
                return "", 0.0
        kind, change = named(recent, band, self._worth(band), self.has_pierce)
        return ("", 0.0) if self._settling and kind not in OF_SAMPLES else (kind, change)

    def _tell(self, kind: str, change: float, evidence: TurnFeatures, against: Departure, alarms: list[Alarm]) -> None:
        """Raise the alarm of a fault that is new, has grown or changed sign; then learn a new band."""
        s, speed = self.settings, float(np.mean(evidence.speed_rad_s))
        speed_known = any(each.band.knows_speed(speed) for each in self._known)
        size = change
        if kind in self._calm:
            before = self._raised[kind].size
            size += before
            grown = size / before
            raised = kind != "profile" and (grown >= _GROWN or grown <= -_TURNED)  # a profile's size has no sign
            del self._known[max(1, len(self._known) - 1) :]  # the new band takes its place
        else:
            # While an alarm stands, another speed explains changes in the effect of the sensor settings.
            raised = speed_known or not self._calm or kind in OF_SAMPLES
        self._since, self._settling = [], True
        if not raised:
            return
        name, text = alarm_text(kind, size, evidence, against.band, speed_known, self.has_pierce)
        turn, stamp = int(evidence.number[-1]), int(evidence.start_ns[-1])
        self._calm[kind] = 0
        series = SERIES.index(kind)
        # a load of another shape than the file's shows as other signatures
        self._shown[kind] = series if against.away[series] > s.raise_sigmas else int(np.argmax(against.away))
        self._raised[kind] = Alarm(name, SIDE[name], turn, stamp, size, float(against.away.max()), text)
        alarms.append(self._raised[kind])

    def _settle(self, turn: TurnFeatures) -> None:
        """Learn the band while alarms stand, from the first like turns, and refine it with more of them."""
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
        """Return true if this number of turns gives a clearly better band than the last one."""
        learnt = self._known[-1].band.turns
        return learnt < self.settings.learn_turns and turns >= min(2 * learnt, self.settings.learn_turns)

    def _go_back_to(self, number: int) -> None:
        """Return to an earlier band for comparison."""
        del self._known[number + 1 :]
        if number:
            self._known[number] = Departure(self._known[number].band, self.settings.memory_turns)
        self._since, self._settling = [], False


def _alike(rows: FloatArray, band: Band) -> bool:
    """Return true if the two halves of turns (t, series) agree within the scatter of single turns."""
    half = rows.shape[0] // 2
    own = np.median(np.abs(np.diff(rows, axis=0)), axis=0) / 0.954  # between neighbours, insensitive to a step
    apart = np.abs(rows[:half].mean(axis=0) - rows[half:].mean(axis=0))
    return bool(np.all(apart < _ALIKE * np.maximum(own, band.sigma) * math.sqrt(2.0 / half)))
