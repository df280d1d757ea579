"""Measurement model: reading of the torque sensor under a hypothesis and values of the parameters."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.inference import blocks
from textile_twin_core.inference.chain import GRID_SPREAD, AngleRipple, EvenGrid, State, torque_filter
from textile_twin_core.inference.parameter import (
    BUTTERWORTH,
    COULOMB,
    DELAY,
    DRIFT,
    ECCENTRIC,
    GAIN,
    HELD,
    HIGH_PASS,
    LOW_PASS,
    OF_CHAIN,
    OFFSET,
    START,
    ZERO,
    ModelParameter,
    gain_factor,
)
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.robust import rms, robust_scale, rounding_bias
from textile_twin_core.inference.torque_model import TabulatedTorque, Torque
from textile_twin_core.machine.sensors import Sensors

_ZERO_STEP, _DELAY_STEP = 5e-4, 2e-4
"""Steps of the slopes by zero [rad] and delay [s], wide enough to average out the noise of the estimated motion."""
_SLOW = 0.6
"""Share of the record's slow speed above which a sample counts, so that no shift of time changes its friction."""
_KEPT = 3
"""Number of motions at different delays in the cache: a fit needs one delay and both sides of it."""
_FILTER_STEP = 0.02
"""Step of the slopes by a filter's parameter, as a share of its value."""
_LEAST_FILTER = {LOW_PASS: 1e-3, BUTTERWORTH: 1e-3, HIGH_PASS: 0.05}
_MOST_STARTS = 8
"""Most runs of a record whose first state of a high pass is estimated; of more, what settles within them counts."""
_WILD = 3.0
"""Scales of the residual beyond which a reading counts no more in its noise."""
_GUARD_S, _UNCERTAIN = 1e-3, 1e-3
"""Time beside a step of the load within which its side is uncertain; share of the working torque that matters."""

States = tuple[FloatArray, FloatArray, FloatArray, BoolArray]


@dataclass(frozen=True)
class Hypothesis:
    """Discrete settings of the sensors, about which the parameters depart.

    Attributes:
        turn: direction times ratio of the shaft's angle over that of the record's motion.
        gain: of the torque sensor with sign and unit.
        zero_rad: configured zero in shaft angle. delay_s, offset_Nm: configured.
        unit: factor of the unit of the logged torque and of a departure of the offset.
        filters: parameters of the torque sensor's filters that act.
    """

    turn: float
    gain: float
    zero_rad: float = 0.0
    delay_s: float = 0.0
    offset_Nm: float = 0.0
    unit: float = 1.0
    filters: frozenset[str] = frozenset()

    def shown_offset(self, departure_Nm: float) -> float:
        """Offset in the logged unit."""
        return self.offset_Nm + self.unit * departure_Nm

    def turned(self, factor: float) -> Hypothesis:
        """Return a copy with another direction or ratio."""
        return replace(self, turn=self.turn * factor, zero_rad=self.zero_rad * factor)


@dataclass(frozen=True)
class Expected:
    """Expected readings (m,), mask of the usable ones, shaft angle, sigma beside steps, slopes (m, k) or None."""

    torque_Nm: FloatArray
    good: BoolArray
    theta: FloatArray
    sigma: FloatArray
    slopes: FloatArray | None


class Measurement:
    """A record, the model of its machine, and the parameters in their order.

    The model is linear about the nominal values, or about those of `linearised`.

    Args:
        record: the samples. model: torque of the machine. parameters: in their order.
        working_torque_Nm: scale of the torque at work.
        uncertain_Nm: root mean square of the torque that the uncertainty of the motion makes.
    """

    def __init__(
        self,
        record: Record,
        model: TabulatedTorque,
        parameters: tuple[ModelParameter, ...],
        working_torque_Nm: float,
        uncertain_Nm: float = 0.0,
    ) -> None:
        self.record, self.model, self.parameters = record, model, parameters
        self.about = model.nominal
        self.names = tuple(p.name for p in parameters)
        self.place = {name: k for k, name in enumerate(self.names)}
        self.sloped = frozenset(self.names)
        self.nominal = np.array([p.nominal for p in parameters])
        self.working_torque_Nm, self.uncertain_Nm = working_torque_Nm, uncertain_Nm
        self.ripple = AngleRipple(parameters, record.shaft_per_encoder, record.speed_rad_s)
        self._motion: dict[tuple[bool, float, float], States] = {}

    @cached_property
    def grid(self) -> EvenGrid:
        """Even grid of time on which the torque is filtered."""
        return EvenGrid(self.record.time_s, self.record.speed_rad_s)

    @cached_property
    def apart_s(self) -> float:
        """Usual time between the record's samples [s]."""
        return float(np.median(np.diff(self.record.time_s)))

    def with_starts(self) -> Measurement:
        """Return a copy with the state in which a high pass enters each run: none has settled before a run begins."""
        size, begin = self.working_torque_Nm, self.grid.begin_s
        names = [f"{START}{each}" for each in begin] if len(begin) <= _MOST_STARTS else []
        starts = (ModelParameter(name, "motion", 0.0, size, size, size, 0.0, math.inf, "N m") for name in names)
        of_machine = self.working_torque_Nm, self.uncertain_Nm
        return Measurement(self.record, self.model, (*self.parameters, *starts), *of_machine)

    def off_nominal_chain(self, off_nominal: Collection[str]) -> tuple[str, ...]:
        """Return the names of the chain's parameters that depart, an order's sine with its cosine."""
        return tuple(p.name for p in self.parameters if p.kind in OF_CHAIN and p.departs(off_nominal))

    def chain_sensors(self, sensors: Sensors, x: FloatArray, off_nominal: Collection[str]) -> Sensors:
        """Return sensors with the departures of the measuring chain: eccentricity, low pass and high pass."""
        v = self.values(x)
        names = self.off_nominal_chain(off_nominal)
        torque, encoder = sensors.torque, sensors.encoder
        if LOW_PASS in names or BUTTERWORTH in names:
            second = v[BUTTERWORTH] if BUTTERWORTH in names else 0.0
            corner = 1.0 / (2.0 * math.pi * second) if second else 0.0
            first = 0.0 if second else v[LOW_PASS]
            torque = replace(torque, low_pass_s=first, low_pass_hz=corner, low_pass_order=2 if second else 1)
        if HIGH_PASS in names:
            torque = replace(torque, high_pass_hz=v[HIGH_PASS])
        if not set(names).isdisjoint(ECCENTRIC):
            known = (*encoder.eccentricity_rad, (0.0, 0.0), (0.0, 0.0))[:2]
            pairs = [(v[name], v[f"{name}.sine"]) for name in ECCENTRIC]
            moved = tuple((a + c, b + s) for (a, b), (c, s) in zip(known, pairs, strict=True))
            encoder = replace(encoder, eccentricity_rad=moved)
        return replace(sensors, encoder=encoder, torque=torque)

    def on(self, record: Record) -> Measurement:
        """Return a copy for another record, with the same linearisation."""
        of_machine = self.working_torque_Nm, self.uncertain_Nm
        other = Measurement(record, self.model, self.parameters, *of_machine)
        other.about = self.about
        return other

    def linearised(self, x: FloatArray, off_nominal: Collection[str]) -> Measurement:
        """Return a copy that is linear about the values (k,) of the off_nominal parameters."""
        about = self.model.linearised(self.values(x), off_nominal)
        if about is self.about:
            return self
        other = copy(self)
        other.about = about
        return other

    def with_slopes_by(self, names: Collection[str]) -> Measurement:
        """Return a copy whose slopes by all other parameters are zero."""
        other = copy(self)
        other.sloped = self.sloped.intersection(names)
        return other

    @property
    def start(self) -> FloatArray:
        """Values (k,) about which the torque is predicted: the nominal ones but for an elastic shaft's."""
        known = {} if self.record.predicted is None else self.record.predicted.start
        return np.array([known.get(p.name, p.nominal) for p in self.parameters])

    def values(self, x: FloatArray) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, x.tolist(), strict=True))

    def states(
        self, hypothesis: Hypothesis, v: Mapping[str, float], zero_rad: float = 0.0, late_s: float = 0.0
    ) -> tuple[States, States]:
        """Shaft's angle, speed and acceleration at the readings less the delay, and the mask of known ones.

        Args:
            hypothesis: discrete settings. v: values of the parameters.
            zero_rad, late_s: added to zero and delay.

        Returns the states of the shaft, and those of the record's motion from which they come.
        """
        delay, drift = hypothesis.delay_s + v[DELAY] + late_s, v[DRIFT]
        key = (bool(hypothesis.filters), delay, drift)
        if key not in self._motion:
            if len(self._motion) == _KEPT:
                self._motion.clear()
            time = self.grid.time_s if hypothesis.filters else self.record.time_s
            self._motion[key] = self._motion_at(time - delay - drift * (time - self.record.middle_s), hypothesis)
        *motion, good = self._motion[key]
        state: State = (motion[0], motion[1], motion[2])
        theta, omega, alpha = self.ripple.corrected(v, state)
        turn = hypothesis.turn
        shaft = turn * theta - hypothesis.zero_rad - v[ZERO] - zero_rad, turn * omega, turn * alpha, good
        return shaft, (*state, good)

    def _motion_at(self, time_s: FloatArray, hypothesis: Hypothesis) -> States:
        """Motion of the record at times (m,).

        For averages, an acceleration gets what it lacks, within a sample to either side, of the second difference of
        the angle: so its sums are second differences at the ends of a block, whatever is wrong with it at a step.
        """
        theta, omega, alpha, good = self.record.motion.at(time_s)
        fine = self.record.block_s and self.record.block_s > 2.0 * self.apart_s
        if fine and not hypothesis.filters:
            (before, _, first, known), (after, _, last, beside) = (
                self.record.motion.at(time_s + way * self.apart_s) for way in (-1.0, 1.0)
            )
            lacking = (after - 2.0 * theta + before) / self.apart_s**2 - (first + 10.0 * alpha + last) / 12.0
            alpha = np.where(known & beside, alpha + lacking, alpha)
            good = good & known & beside
        return theta, omega, alpha, good

    def expected(self, hypothesis: Hypothesis, x: FloatArray, slopes: bool = False) -> Expected:
        """Expected readings at the samples."""
        v = self.values(x)
        table = self.model.table(v, self.about)
        gain = hypothesis.gain * gain_factor(v[GAIN])
        (theta, omega, alpha, good), own = self.states(hypothesis, v)
        found, inside, columns = self.true_torque(hypothesis, v, (theta, omega, alpha), table, slopes)
        torque = found.torque_Nm
        if slopes and self.record.predicted is None:
            columns = self._slopes(hypothesis, v, table, found, own)
        good = (
            good
            & inside
            & (np.abs(omega) > _SLOW * abs(hypothesis.turn) * self.record.slow_rad_s)
            & np.isfinite(torque)
        )
        sigma = np.sqrt(found.variance)
        if hypothesis.filters:
            torque, sigma, theta, good, columns = self._filtered(hypothesis, v, torque, sigma, theta, good, columns)
        shown = gain * torque + hypothesis.shown_offset(v[OFFSET])
        sigma = abs(gain) * sigma
        if not slopes:
            return Expected(shown, good, theta, sigma, None)
        columns[GAIN] = torque * gain_factor(v[GAIN])
        columns[OFFSET] = np.full_like(torque, hypothesis.unit / gain)
        matrix = np.zeros((torque.size, len(self.names)))
        for name in self.sloped.intersection(columns):
            matrix[:, self.place[name]] = gain * columns[name]
        return Expected(shown, good & np.isfinite(matrix).all(axis=1), theta, sigma, matrix)

    def true_torque(
        self,
        hypothesis: Hypothesis,
        v: Mapping[str, float],
        state: State,
        table: FloatArray,
        slopes: bool = False,
        spread_rad: float = 0.0,
    ) -> tuple[Torque, BoolArray, dict[str, FloatArray]]:
        """Torque of the shaft at its states, a mask of the known ones, and slopes by the machine's parameters.

        That of an elastic shaft depends on the motion before: it comes from the record's prediction at the same times.
        """
        predicted = self.record.predicted
        if predicted is None:
            spread = spread_rad or self.spread_rad(hypothesis)
            found = self.model.torque(v, state, table, self.sloped if slopes else (), spread_rad=spread)
            return found, np.ones(found.torque_Nm.size, np.bool_), found.slopes
        time = self.grid.time_s if hypothesis.filters else self.record.time_s
        late = hypothesis.delay_s + v[DELAY] + v[DRIFT] * (time - self.record.middle_s)
        torque, rate, inside, columns = predicted.at(time - late, v, slopes)
        if slopes:
            columns[DELAY] = -rate
            columns[DRIFT] = -rate * (time - self.record.middle_s)
        none = np.zeros_like(torque)
        return Torque(torque, columns, none, none, none), inside, columns

    def spread_rad(self, hypothesis: Hypothesis) -> float:
        """Shaft angle over which a step of the load is smeared; a filter smears it by itself.

        In an average each sample stands for the time to its neighbours, as its acceleration does.
        """
        speed = abs(hypothesis.turn * self.record.speed_rad_s)
        if hypothesis.filters:
            return GRID_SPREAD * self.grid.period_s * speed
        apart = 0.5 * self.apart_s if self.record.block_s else 0.0
        return max(self.model.coarse_rad, apart * speed)

    def _slopes(
        self, hypothesis: Hypothesis, v: Mapping[str, float], table: FloatArray, found: Torque, own: States
    ) -> dict[str, FloatArray]:
        """Slopes of the true torque by all parameters but those of the sensor's scale and filters."""

        def at(zero: float, late: float) -> FloatArray:
            moved = self.states(hypothesis, v, zero, late)[0]
            return self.model.torque(v, moved[:3], table, spread_rad=self.spread_rad(hypothesis)).torque_Nm

        out = dict(found.slopes)
        if not self.sloped.isdisjoint((DELAY, DRIFT)):
            out[DELAY] = (at(0.0, _DELAY_STEP) - at(0.0, -_DELAY_STEP)) / (2.0 * _DELAY_STEP)
            time = self.grid.time_s if hypothesis.filters else self.record.time_s
            out[DRIFT] = out[DELAY] * (time - self.record.middle_s)
        if self.sloped.isdisjoint((ZERO, *(cosine for cosine, _ in self.ripple.names))):
            return out
        out[ZERO] = (at(_ZERO_STEP, 0.0) - at(-_ZERO_STEP, 0.0)) / (2.0 * _ZERO_STEP)
        turn = hypothesis.turn
        by = -turn * out[ZERO], turn * found.by_omega, turn * found.by_alpha
        return out | self.ripple.slopes(own[:3], by, self.sloped)

    def _filtered(
        self,
        hypothesis: Hypothesis,
        v: Mapping[str, float],
        torque: FloatArray,
        sigma: FloatArray,
        theta: FloatArray,
        good: BoolArray,
        columns: dict[str, FloatArray],
    ) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray, dict[str, FloatArray]]:
        """Torque on the grid and its slopes through the sensor's filter, at the samples; likewise angles and mask."""
        chosen, names = torque_filter(v), [name for name in columns if name in self.sloped]
        stacked = np.stack([torque, *(columns[name] for name in names)])
        known = good.copy()
        known[: int(np.argmax(good))] = True  # the state in which the motion begins, whatever the delay
        stacked[:, ~known | ~np.isfinite(stacked).all(axis=0)] = 0.0
        torque, through = stacked[0], self.grid.at_samples(self.grid.through(chosen, stacked))
        out = dict(zip(names, through[1:], strict=True))
        seen, settled = through[0], chosen
        begun = [f"{START}{each}" for each in self.grid.begin_s] if HIGH_PASS in hypothesis.filters else []
        if not set(begun) <= set(self.names):
            begun = []
        if begun:
            settled = replace(chosen, high_pass_hz=0.0)
            starts = self.grid.starts(chosen.high_pass_hz)
            seen = seen + starts @ np.array([v[name] for name in begun])
            out |= dict(zip(begun, starts.T, strict=True))
        if names:
            for name in hypothesis.filters & self.sloped:
                step = _FILTER_STEP * max(v[name], _LEAST_FILTER[name])
                low, high = max(v[name] - step, 0.0), v[name] + step
                ends = [self.grid.through(torque_filter({**v, name: each}), torque) for each in (low, high)]
                out[name] = self.grid.at_samples((ends[1] - ends[0]) / (high - low))
                if name == HIGH_PASS and begun:
                    change = (self.grid.starts(high) - self.grid.starts(low)) / (high - low)
                    out[name] += change @ np.array([v[each] for each in begun])
        low_pass = torque_filter({**v, HIGH_PASS: 0.0})
        uncertain = np.abs(self.grid.at_samples(self.grid.through(low_pass, np.where(good, sigma, 0.0))))
        return seen, uncertain, self.grid.at_samples(theta), self.grid.settled(settled, good), out

    def residual(self, hypothesis: Hypothesis, x: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the residual torque of each sample, and a mask of the usable ones, away from steps of the load."""
        v = self.values(x)
        (theta, omega, alpha, good), _ = self.states(hypothesis, v)
        guard = 0.5 * _GUARD_S * abs(hypothesis.turn * self.record.speed_rad_s)
        spread = self.spread_rad(hypothesis) if hypothesis.filters else guard
        table = self.model.table(v, self.about)
        found, inside, _ = self.true_torque(hypothesis, v, (theta, omega, alpha), table, spread_rad=spread)
        torque = found.torque_Nm
        good = good & inside & (np.abs(omega) > _SLOW * abs(hypothesis.turn) * self.record.slow_rad_s)
        if hypothesis.filters:
            sigma = np.sqrt(found.variance)
            torque, _, _, good, _ = self._filtered(hypothesis, v, torque, sigma, theta, good, {})
        else:
            good = good & (found.variance <= (_UNCERTAIN * self.working_torque_Nm) ** 2)
        gain = hypothesis.gain * gain_factor(v[GAIN])
        return self.record.torque_Nm - gain * torque - hypothesis.shown_offset(v[OFFSET]), good

    def error(self, seen: Expected) -> tuple[FloatArray, float]:
        """Return readings less their expected values (m,), which a rounding to a step shifts, and their scale."""
        record = self.record
        error = record.torque_Nm - seen.torque_Nm
        scale = robust_scale(error[seen.good])
        if record.step_Nm:
            most, known = _WILD * scale, error[seen.good]
            noise = rms(np.clip(known, -most, most))
            error -= rounding_bias(seen.torque_Nm, float(record.torque_Nm[0]), record.step_Nm, noise)
            # few readings differ much from what their rounding leaves: their median is not their scale
            scale = rms(np.clip(error[seen.good], -most, most))
        return error, scale

    def means(self, columns: FloatArray, good: BoolArray) -> tuple[FloatArray, BoolArray]:
        """Return values (m, k) at the samples, or their block averages, and a mask of the usable ones."""
        record = self.record
        if not record.block_s:
            return columns, good
        return blocks.means((record.time_s - record.time_s[0]) / record.block_s, columns, good)

    def at_standstill(
        self, hypothesis: Hypothesis, x: FloatArray, slopes: bool = False
    ) -> tuple[FloatArray, FloatArray | None]:
        """Residuals (s,) of the readings at standstill over their standard deviations, and slopes (s, k) of the model.

        The torque is then due to weight, springs and the sensor's offset; a brake may hold more. What a force
        law adds in one direction and takes in the other may be anything between.
        """
        rests = self.record.standstills
        if not rests or HIGH_PASS in hypothesis.filters:
            return np.empty(0), np.empty((0, len(self.names))) if slopes else None
        v = self.values(x)
        time, shown, sigma = np.array([(r.time_s, r.torque_Nm, r.sigma_Nm) for r in rests]).T
        own, _, _, _ = self.record.motion.at(time)
        own = self.ripple.corrected(v, (own, np.zeros_like(own), np.zeros_like(own)))[0]
        theta = hypothesis.turn * own - hypothesis.zero_rad - v[ZERO]
        none = np.zeros_like(theta)
        gain = hypothesis.gain * gain_factor(v[GAIN])
        rest, table = (theta, none, none), self.model.table(v, self.about)
        found = self.model.torque(v, rest, table, self.sloped if slopes else (), way=none)
        if self.model.has_laws:
            ways = (
                self.model.torque({**v, COULOMB: 0.0}, rest, table, way=none + way).torque_Nm for way in (1.0, -1.0)
            )
            sigma = np.hypot(sigma, 0.5 * gain * np.subtract(*ways))
        held = gain * (found.torque_Nm + v[HELD])
        residual = (shown - held - hypothesis.shown_offset(v[OFFSET])) / sigma
        if not slopes:
            return residual, None
        out = found.slopes | {GAIN: found.torque_Nm * gain_factor(v[GAIN]), HELD: none + 1.0}
        out[OFFSET] = none + hypothesis.unit / gain
        asked = (out.get(name, none) if name in self.sloped else none for name in self.names)
        columns = np.stack([gain * each for each in asked], 1)
        return residual, columns / sigma[:, None]
