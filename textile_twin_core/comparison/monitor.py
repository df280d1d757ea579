"""Monitor of a machine, live or from a file: angles and torque in; turns, alarms and trends out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.expected_reading import filtered_at
from textile_twin_core.comparison.fault_band import SERIES
from textile_twin_core.comparison.fault_signatures import (
    KINDS,
    Signatures,
    TurnFeatures,
    WatchedTorque,
    signatures,
    slow_speed,
    turn_features,
)
from textile_twin_core.comparison.fault_watch import Alarm, FaultWatch, WatchSettings
from textile_twin_core.comparison.gather import hypothesis_of
from textile_twin_core.comparison.inputs import usable_measurements
from textile_twin_core.comparison.motion_cycles import Reversals, WatchedSpan, labelled, numbers
from textile_twin_core.comparison.process_force import ProcessForce
from textile_twin_core.comparison.range_ends import RangeEnds, range_end_note
from textile_twin_core.comparison.readings import FEWEST_TORQUES_PER_TURN, Readings
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.machine import Machine, TorqueFilter
from textile_twin_core.shaft import SampleReport, create_estimator
from textile_twin_core.twin.session import encoder_settings

_KEPT_S = 60.0
_PEAK_SAMPLES = 720
_BLOCK = 8192
_MOSTLY = 0.9
_PART = 0.2
"""Share of a turn that may be missing where a record begins or ends, and least share of it that has torques."""


@dataclass(frozen=True)
class Trend:
    """Turns by column, (t,) each, the alarms they raised, notes for a person, and how many turns the band took.

    cycles: the shaft reverses, and cycles of its motion, there and back, take the place of turns.
    """

    columns: Mapping[str, FloatArray | IntArray]
    alarms: tuple[Alarm, ...]
    notes: tuple[str, ...] = ()
    unwatched: int = 0
    cycles: bool = False


class Monitor:
    """Monitor of a machine while samples come, with equal results from a live topic and from a recording.

    Args:
        machine: with calibrated sensors (see `calibrate`).
        settings: settings of the watch.
        shaft: estimator of the shaft's motion, causal or lag.

    Attributes:
        process: force of the process in each turn; None for a machine without a load over a measure.
    """

    def __init__(self, machine: Machine, settings: WatchSettings | None = None, shaft: str = "lag") -> None:
        self._machine = WatchedTorque(machine)
        self._filter = TorqueFilter.of(machine.sensors.torque)
        self.process = ProcessForce.of(machine) if self._filter.is_identity else None
        self._sensors = hypothesis_of(machine)
        encoder = machine.sensors.encoder
        self._encoder = encoder
        self._estimator = create_estimator(shaft, **encoder_settings(replace(encoder, direction=1, zero_rad=0.0)))
        self._inertia = self._mean_inertia(machine)
        self._reversals, self._cycles = Reversals(), 0
        self.watch = FaultWatch(
            self._torque_size(machine), settings or WatchSettings(), self._machine.pierce is not None
        )
        self._states: list[FloatArray] = []
        self._torque: list[tuple[IntArray, FloatArray]] = []
        self._ends = RangeEnds()
        self._origin_ns: int | None = None
        self.turns = 0

    def add_angles(
        self, stamps_ns: npt.ArrayLike, angles_rad: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> None:
        """Take encoder angles (n,) as logged."""
        encoder = self._encoder
        speeds = None if velocities is None else encoder.true_speed(angles_rad, velocities) * encoder.ratio
        angles = encoder.true_angle(angles_rad) * encoder.ratio
        self._take_states(self._estimator.step(np.asarray(stamps_ns, np.int64), angles, speeds))

    def add_torques(self, stamps_ns: npt.ArrayLike, torque_Nm: npt.ArrayLike) -> None:
        """Take measured torque (n,)."""
        self._torque.append((np.asarray(stamps_ns, np.int64), np.asarray(torque_Nm, np.float64)))

    def finish(self) -> Trend:
        """Watch the last turns, after the last sample."""
        self._take_states(self._estimator.finish())
        return self.advance(last=True)

    @property
    def report(self) -> SampleReport:
        """Counts of accepted and rejected angles since the start or the last restart."""
        return self._estimator.report

    @property
    def newest(self) -> tuple[int, float] | None:
        """Stamp [ns] and angle [rad] of the shaft's newest state, which counts its turns; None without any."""
        if not self._states or self._origin_ns is None:
            return None
        time_s, theta = self._states[-1][-1, :2].tolist()
        return self._origin_ns + round(time_s * 1e9), theta

    def restart(self) -> None:
        """Restart after time was set back: keep the learnt band, drop the samples of incomplete turns."""
        self._estimator.reset()
        self._reversals = Reversals()
        self._states.clear()
        self._torque.clear()
        self._origin_ns = None

    def advance(self, last: bool = False) -> Trend:
        """Watch the turns completed by now; return their trend and alarms."""
        trend = self._advance(last)
        self._limit_memory()
        return trend

    def _advance(self, last: bool) -> Trend:
        if self._origin_ns is None or not self._torque or sum(map(len, self._states)) < 2:
            return Trend({}, ())
        rows = np.concatenate(self._states)
        stamps = np.concatenate([stamps for stamps, _ in self._torque])
        torque = np.concatenate([values for _, values in self._torque])
        order = np.argsort(stamps, kind="stable")
        stamps, torque = stamps[order], torque[order]
        track = ShaftTrack(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], 5.0 * float(np.median(np.diff(rows[:, 0]))))
        time = (stamps - self._origin_ns) * 1e-9 - self._sensors.delay_s
        theta, omega, alpha, good = track.at(time)
        s = self._sensors
        states = s.turn * theta - s.zero_rad, s.turn * omega, s.turn * alpha
        place = (s.turn * rows[:, 1] - s.zero_rad) / TURN
        spans, over = self._spans(rows[:, 0], place, time, last)
        label, ready = labelled(spans, time, _turn(states[0]))
        ready &= good
        if np.count_nonzero(ready) < FEWEST_TORQUES_PER_TURN:
            return Trend({}, ())
        self._take_spans(spans, over)
        filtered, seen = None, torque[ready]
        if not self._filter.is_identity:
            filtered, settled = self._filtered(track, time[ready])
            seen[~settled] = np.nan
        at = states[0][ready], states[1][ready], states[2][ready]
        found = turn_features(self._machine, s, stamps[ready], seen, at, self._ends, filtered, label[ready])
        kept = _whole(found, float(np.median(np.diff(time))))
        own, _ = labelled(spans, rows[:, 0], np.floor(place).astype(np.int64))
        unsure = self._inertia * np.array([np.quantile(rows[own == number, 4], _MOSTLY) for number in kept.number])
        kept = replace(kept, number=numbers(spans, kept.number))
        cycles = any(span.cycle is not None for span in spans)
        alarms, away = self.watch.take(kept, unsure)
        forces: Mapping[str, FloatArray] = {}
        if self.process is not None:
            slow = slow_speed(at[1], _turn(at[0]))
            residual = (seen - s.offset_Nm) / s.gain - self._machine.at(*at, slow)[0]
            moving = np.isfinite(residual) & (np.abs(at[1]) > slow) & (not cycles)  # a cycle is no whole stitch
            forces = self.process.turns(residual, at, moving).columns(kept.number)
        self.turns += kept.number.size
        self._forget(float(time[ready].max()), stamps, torque)
        cut_off = int(kept.cut_off.sum())
        notes = (range_end_note(cut_off, self._ends.values_Nm, "turns are watched"),) if cut_off else ()
        trend = replace(_trend(kept, away, alarms, notes, self.watch.unwatched), cycles=cycles)
        return replace(trend, columns={**trend.columns, **forces})

    def _spans(
        self, time_s: FloatArray, place: FloatArray, torque_s: FloatArray, last: bool
    ) -> tuple[list[WatchedSpan], int]:
        """Return the spans to watch now, and the number of strokes that are over with them.

        Complete turns are those that the shaft and its torque have left, in either direction; a cycle is complete at
        its second reversal. The turn in which a long stroke reverses is left out.

        Args:
            time_s, place: of the states, the place in turns. torque_s: times of the torques. last: nothing follows.
        """
        strokes, until = self._reversals.strokes, min(float(time_s[-1]), float(torque_s[-1]))
        spans, k, cycle = list[WatchedSpan](), 0, self._cycles

        def place_at(at_s: float) -> float:
            return float(np.interp(at_s, time_s, place))

        while k < len(strokes):
            stroke, over = strokes[k], strokes[k].end_s <= until
            if stroke.long or (last and not stroke.reversed and not over):
                sense, partial = int(self._sensors.turn) * stroke.sense, set[int]()
                begin, end = place_at(max(stroke.begin_s, float(torque_s[0]))), place_at(min(stroke.end_s, until))
                if stroke.fresh and (stroke.reversed or _missing(begin, sense) > _PART):
                    partial.add(math.floor(begin))
                if over or (last and _missing(end, -sense) > _PART):
                    partial.add(math.floor(end))
                incomplete = None if over or last else math.floor(end)
                spans.append(
                    WatchedSpan(stroke.begin_s, stroke.end_s, None, sense or 1, incomplete, frozenset(partial))
                )
            elif over and stroke.reversed and k + 1 < len(strokes) and not strokes[k + 1].long:
                if strokes[k + 1].end_s > until:
                    break
                spans.append(WatchedSpan(stroke.begin_s, strokes[k + 1].end_s, cycle))
                cycle, k = cycle + 1, k + 1
            if not over:
                break
            k += 1
        return spans, k

    def _take_spans(self, spans: list[WatchedSpan], over: int) -> None:
        """Take spans as watched, and drop the strokes that are over."""
        strokes = self._reversals.strokes
        self._cycles += sum(span.cycle is not None for span in spans)
        del strokes[:over]
        if strokes and strokes[0].long:
            strokes[0].fresh = False

    def _filtered(self, track: ShaftTrack, time_s: FloatArray) -> tuple[Signatures, BoolArray]:
        """Return the signatures behind the filter of the sensor at times (m,), and where the filter has settled."""
        s = self._sensors
        theta, omega = s.turn * track.theta_rad - s.zero_rad, s.turn * track.omega_rad_s
        whole = signatures(self._machine, theta, omega, s.turn * track.alpha_rad_s2, slow_speed(omega, _turn(theta)))
        columns = [getattr(whole, field.name) for field in fields(whole)]
        good = np.isfinite(np.stack(columns)).all(axis=0)
        found, settled = filtered_at(
            self._filter, track.time_s[good], [column[good] for column in columns], theta[good],
            self._machine.step_angles_rad, time_s,
        )  # fmt: skip
        return Signatures(*found), settled

    def _take_states(self, states: Any) -> None:
        if not len(states):
            return
        stamps = np.asarray(states.stamps, np.int64)
        if self._origin_ns is None:
            self._origin_ns = int(stamps[0])
        rows = np.stack(
            [
                (stamps - self._origin_ns) * 1e-9,
                states.theta_rad,
                states.omega_rad_s,
                states.alpha_rad_s2,
                states.sigma[:, 2],
            ],
            axis=1,
        )
        usable = states.settled & np.isfinite(rows).all(axis=1)
        if usable.any():
            self._states.append(rows[usable])
            self._reversals.take(rows[usable, 0], rows[usable, 1])

    def _forget(self, until_s: float, stamps: IntArray, torque: FloatArray) -> None:
        """Drop the samples of watched turns."""
        assert self._origin_ns is not None
        rows = np.concatenate(self._states)
        keep = rows[:, 0] > until_s - max(1.0, 2.0 * self._filter.settling_s)
        self._states = [rows[keep]] if keep.any() else [rows[-1:]]
        late = (stamps - self._origin_ns) * 1e-9 - self._sensors.delay_s > until_s
        self._torque = [(stamps[late], torque[late])]

    def _limit_memory(self) -> None:
        """Keep at most a minute of samples while no turn ends: at standstill, or with a silent sensor."""
        newest_ns: int | None = None
        if self._states and self._origin_ns is not None:
            rows = np.concatenate(self._states)
            self._states = [rows[rows[:, 0] >= rows[-1, 0] - _KEPT_S]]
            newest_ns = self._origin_ns + round(rows[-1, 0] * 1e9)
        if self._torque:
            stamps, torque = (np.concatenate(column) for column in zip(*self._torque, strict=True))
            kept = np.abs(stamps - (stamps[-1:] if newest_ns is None else newest_ns)) <= round(_KEPT_S * 1e9)
            self._torque = [(stamps[kept], torque[kept])]

    def _mean_inertia(self, machine: Machine) -> float:
        theta, none = machine.shaft_angles(_PEAK_SAMPLES), np.zeros(_PEAK_SAMPLES)
        faster, even = (self._machine.at(theta, none, none + alpha, 0.0)[0] for alpha in (1.0, 0.0))
        return float(np.nanmean(faster - even))

    def _torque_size(self, machine: Machine) -> float:
        theta = machine.shaft_angles(_PEAK_SAMPLES)
        speed = np.full(_PEAK_SAMPLES, machine.nominal_speed_rad_s)
        return float(np.nanmax(np.abs(self._machine.at(theta, speed, np.zeros(_PEAK_SAMPLES), 0.0)[0])))


def _turn(theta: FloatArray) -> IntArray:
    return np.floor(theta / TURN).astype(np.int64)


def _missing(place: float, sense: float) -> float:
    """Share of a turn before a place in it, as the shaft turns."""
    share = place - math.floor(place)
    return share if sense > 0.0 else 1.0 - share


def monitor_recording(
    readings: Readings,
    machine: Machine,
    settings: WatchSettings | None = None,
    progress: Callable[[int], object] | None = None,
) -> Trend:
    """Watch a whole recording: learn from its first turns, then watch the others.

    `progress` is called with the number of angles taken, and again when all of them have been watched.
    """
    monitor = Monitor(machine, settings)
    monitor.add_torques(*usable_measurements(readings.torque_stamps_ns, readings.torque)[:2])
    for start in range(0, len(readings.angle), _BLOCK):
        part = slice(start, start + _BLOCK)
        speeds = None if readings.velocities is None else readings.velocities[part]
        monitor.add_angles(readings.angle_stamps_ns[part], readings.angle[part], speeds)
        if progress is not None:
            progress(len(readings.angle[part]))
    trend = monitor.finish()
    if progress is not None:
        progress(len(readings.angle))
    return trend


def _whole(found: TurnFeatures, step_s: float) -> TurnFeatures:
    """Drop turns with too few torques, `step_s` apart."""
    covered = found.count * np.abs(found.speed_rad_s) * step_s  # part of a slow turn may hold many samples
    kept = (found.count >= FEWEST_TORQUES_PER_TURN) & (covered >= _PART * TURN)
    return found.where(kept)


def _trend(turns: TurnFeatures, away: FloatArray, alarms: list[Alarm], notes: tuple[str, ...], unwatched: int) -> Trend:
    columns: dict[str, FloatArray | IntArray] = {
        "turn": turns.number,
        "stamp_ns": turns.start_ns,
        "samples": turns.count,
        "cut_off": turns.cut_off,
        "speed_rad_s": turns.speed_rad_s,
        "rms_Nm": turns.rms_Nm,
        "noise_Nm": turns.noise_Nm,
    }
    columns |= {f"{kind}_size": turns.sizes[:, k] for k, kind in enumerate(KINDS)}
    columns |= {f"{name}_sigmas": away[:, k] for k, name in enumerate(SERIES)}
    return Trend(columns, tuple(alarms), notes, unwatched)
