"""Measurement model: reading of the torque sensor under a hypothesis and values of the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.inference import blocks
from textile_twin_core.inference.parameter import DELAY, DRIFT, GAIN, HELD, OFFSET, ZERO, ModelParameter, gain_factor
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.torque_model import TabulatedTorque

_ZERO_STEP, _DELAY_STEP = 5e-4, 2e-4
"""Steps of the slopes by zero [rad] and delay [s], wide enough to average out the noise of the estimated motion."""
_SLOW = 0.6
"""Share of the record's slow speed above which a sample counts, so that no shift of time changes its friction."""
_KEPT = 3
"""Number of motions at different delays in the cache: a fit needs one delay and both sides of it."""
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
    """

    turn: float
    gain: float
    zero_rad: float = 0.0
    delay_s: float = 0.0
    offset_Nm: float = 0.0
    unit: float = 1.0

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
    """A record, the model of its machine, and the parameters in their order."""

    def __init__(
        self, record: Record, model: TabulatedTorque, parameters: tuple[ModelParameter, ...], working_torque_Nm: float
    ) -> None:
        self.record, self.model, self.parameters = record, model, parameters
        self.names = tuple(p.name for p in parameters)
        self.place = {name: k for k, name in enumerate(self.names)}
        self.nominal = np.array([p.nominal for p in parameters])
        self.working_torque_Nm = working_torque_Nm
        self._motion: dict[tuple[float, float], States] = {}

    def on(self, record: Record) -> Measurement:
        """Return a copy for another record."""
        return Measurement(record, self.model, self.parameters, self.working_torque_Nm)

    def values(self, x: FloatArray) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, x.tolist(), strict=True))

    def states(self, hypothesis: Hypothesis, delay_s: float, drift: float, zero_rad: float) -> States:
        """Return angle, speed and acceleration of the shaft at the samples less the delay, and a mask of known ones."""
        if (delay_s, drift) not in self._motion:
            if len(self._motion) == _KEPT:
                self._motion.clear()
            late = delay_s + drift * (self.record.time_s - self.record.middle_s)
            self._motion[delay_s, drift] = self.record.motion.at(self.record.time_s - late)
        theta, omega, alpha, good = self._motion[delay_s, drift]
        turn = hypothesis.turn
        return turn * theta - hypothesis.zero_rad - zero_rad, turn * omega, turn * alpha, good

    def expected(self, hypothesis: Hypothesis, x: FloatArray, slopes: bool = False) -> Expected:
        """Expected readings at the samples."""
        v = self.values(x)
        table = self.model.table(v)
        gain = hypothesis.gain * gain_factor(v[GAIN])
        delay = hypothesis.delay_s + v[DELAY]
        theta, omega, alpha, good = self.states(hypothesis, delay, v[DRIFT], v[ZERO])
        found = self.model.torque(v, (theta, omega, alpha), table, slopes)
        torque = found.torque_Nm
        good = good & (np.abs(omega) > _SLOW * abs(hypothesis.turn) * self.record.slow_rad_s) & np.isfinite(torque)
        shown = gain * torque + hypothesis.shown_offset(v[OFFSET])
        sigma = abs(gain) * np.sqrt(found.variance)
        if not slopes:
            return Expected(shown, good, theta, sigma, None)
        out = found.slopes

        def at(zero: float, late: float) -> FloatArray:
            moved = self.states(hypothesis, delay + late, v[DRIFT], v[ZERO] + zero)[:3]
            return self.model.torque(v, moved, table).torque_Nm

        out[ZERO] = (at(_ZERO_STEP, 0.0) - at(-_ZERO_STEP, 0.0)) / (2.0 * _ZERO_STEP)
        out[DELAY] = (at(0.0, _DELAY_STEP) - at(0.0, -_DELAY_STEP)) / (2.0 * _DELAY_STEP)
        out[DRIFT] = out[DELAY] * (self.record.time_s - self.record.middle_s)
        out[GAIN] = torque * gain_factor(v[GAIN])
        out[OFFSET] = np.full_like(torque, hypothesis.unit / gain)
        out[HELD] = np.zeros_like(torque)
        columns = gain * np.stack([out[name] for name in self.names], 1)
        return Expected(shown, good & np.isfinite(columns).all(axis=1), theta, sigma, columns)

    def residual(self, hypothesis: Hypothesis, x: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the residual torque of each sample, and a mask of the usable ones, away from steps of the load."""
        v = self.values(x)
        *state, good = self.states(hypothesis, hypothesis.delay_s + v[DELAY], v[DRIFT], v[ZERO])
        guard = _GUARD_S * abs(hypothesis.turn * self.record.speed_rad_s)
        theta, omega, alpha = state
        found = self.model.torque(v, (theta, omega, alpha), self.model.table(v), spread_rad=0.5 * guard)
        good = good & (np.abs(omega) > _SLOW * abs(hypothesis.turn) * self.record.slow_rad_s)
        good = good & (found.variance <= (_UNCERTAIN * self.working_torque_Nm) ** 2)
        gain = hypothesis.gain * gain_factor(v[GAIN])
        return self.record.torque_Nm - gain * found.torque_Nm - hypothesis.shown_offset(v[OFFSET]), good

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

        The torque is then due to weight, springs and the sensor's offset; a brake may hold more.
        """
        rests = self.record.standstills
        if not rests:
            return np.empty(0), np.empty((0, len(self.names))) if slopes else None
        v = self.values(x)
        time, shown, sigma = np.array([(r.time_s, r.torque_Nm, r.sigma_Nm) for r in rests]).T
        theta = hypothesis.turn * self.record.motion.at(time)[0] - hypothesis.zero_rad - v[ZERO]
        none = np.zeros_like(theta)
        gain = hypothesis.gain * gain_factor(v[GAIN])
        found = self.model.torque(v, (theta, none, none), self.model.table(v), slopes, way=none)
        held = gain * (found.torque_Nm + v[HELD])
        residual = (shown - held - hypothesis.shown_offset(v[OFFSET])) / sigma
        if not slopes:
            return residual, None
        out = found.slopes | {GAIN: found.torque_Nm * gain_factor(v[GAIN]), HELD: none + 1.0}
        out[OFFSET] = none + hypothesis.unit / gain
        columns = np.stack([gain * out.get(name, none) for name in self.names], 1)
        return residual, columns / sigma[:, None]
