"""Comparison of a measured travel, angle or speed with the machine's: scale, delay, zero and residual."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.evidence import REST_SHARE
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack, shaft_track
from textile_twin_core.comparison.uncertainty import Estimate, uncertainty_by_turns
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.robust import HUBER, robust_scale
from textile_twin_core.machine import Machine
from textile_twin_core.twin import Twin, compile_rigid
from textile_twin_core.twin.sense import negligible_speed

_ZEROS, _DELAYS, _HALVINGS = 72, 48, 40
_LONGEST_DELAY_S = 1.0
_FEWEST = 64
_STEPS = {"zero_rad": 1e-5, "delay_s": 1e-6}
_GUARD_S = 0.001
"""Samples this close to a discontinuity of the quantity may lie on either side of it."""
_LEAP = 1e-4
_BESIDE_RAD = 1e-7
_TELLS, _CONSTANT = 1e-6, 1e-9
"""Relative variation of the slope over the angle below which it determines no zero; relative variation below which a
quantity is constant."""
_COARSE_SAMPLES = 4000
_TURNING_SHARE = 0.1  # of the fast end of the recorded speeds
_UNITS = {
    "_m": ("mm", 1e3), "_m_s": ("m/s", 1.0), "_m_s2": ("m/s²", 1.0), "_rad": ("deg", 180.0 / math.pi),
    "_rad_s": ("rad/s", 1.0), "_rad_s2": ("rad/s²", 1.0), "_Nm": ("N m", 1.0), "_N": ("N", 1.0), "_J": ("J", 1.0),
    "_kgm2": ("kg m²", 1.0),
}  # fmt: skip


def shown_unit(name: str) -> tuple[str, float]:
    """Return the unit in which an output of this name is displayed, and its factor from SI."""
    return next((shown for ending, shown in _UNITS.items() if name.endswith(ending)), ("", 1.0))


@dataclass(frozen=True)
class Trace:
    """A measured quantity (m,) with its stamps [ns], beside the encoder's angles (n,) with theirs."""

    stamps_ns: IntArray
    values: FloatArray
    angle_stamps_ns: IntArray
    angle_rad: FloatArray
    velocities: FloatArray | None = None


@dataclass(frozen=True)
class QuantityComparison:
    """measured(t) = scale * machine's(angle(t - delay) - zero) + offset, in the quantity's SI unit.

    Attributes:
        name: of the output. scale, offset, delay_s: as fitted. zero_rad: in shaft angle, beside the machine file's.
        rms: residual. rms_configured: residual with scale 1, no delay, the machine file's zero, and the best offset.
        explained: share of the mean square about the mean. measured_range, machine_range: highest less lowest over a
            turn at speed_rad_s, the shaft's usual speed; the measured one from the fit, without noise.
        one_speed: zero and delay are not distinguishable; their sum is stated as a delay.
        at_rest: samples at standstill, left out of a quantity with dry friction, which is then indeterminate;
            0 for other quantities, whose samples at standstill count.
        time_s, measured, expected, theta_rad: (k,) the usable samples.
    """

    name: str
    scale: Estimate
    offset: Estimate
    delay_s: Estimate
    zero_rad: Estimate
    rms: float
    rms_configured: float
    explained: float
    measured_range: float
    machine_range: float
    speed_rad_s: float
    one_speed: bool
    at_rest: int
    time_s: FloatArray
    measured: FloatArray
    expected: FloatArray
    theta_rad: FloatArray

    def to_json(self) -> dict[str, Any]:
        """Return the numbers as one object."""
        numbers = {name: each for name, each in asdict(self).items() if not isinstance(each, np.ndarray)}
        out: dict[str, Any] = plain({"quantity": numbers.pop("name"), **numbers, "samples": self.time_s.size})
        return out


class _Model:
    """The machine's quantity at the instants of the samples; not known where the shaft is slower than `slow_rad_s`."""

    def __init__(
        self,
        twin: Twin,
        name: str,
        track: ShaftTrack,
        time_s: FloatArray,
        direction: int,
        zero: float,
        slow_rad_s: float,
    ) -> None:
        self._twin, self._name, self._track, self._time = twin, name, track, time_s
        self._slow_rad_s = slow_rad_s
        self.direction, self._zero = direction, zero
        self._steps = [e.angle_rad for e in twin.machine.events() if _is_discontinuous(twin, name, e.angle_rad)]

    def at(self, zero_rad: float, delay_s: float) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the quantity, the shaft angle, and a mask of the samples where both are known."""
        theta, omega, alpha, good = self._track.at(self._time - delay_s)
        theta = self.direction * theta - self._zero - zero_rad
        found = self._twin.evaluate(theta, self.direction * omega, self.direction * alpha)[self._name]
        quantity = np.broadcast_to(found, theta.shape)
        return quantity, theta, good & np.isfinite(quantity) & (np.abs(omega) >= self._slow_rad_s)

    def clear(self, zero_rad: float, delay_s: float) -> BoolArray:
        """Return true for the samples away from discontinuities, such as a reaction's at the needle's entry."""
        theta, omega, _, _ = self._track.at(self._time - delay_s)
        theta, clear = self.direction * theta - self._zero - zero_rad, np.ones(theta.size, np.bool_)
        for step in self._steps:
            clear &= np.abs(np.remainder(theta - step + np.pi, TURN) - np.pi) > np.abs(omega) * _GUARD_S
        return clear


def compare_quantity(trace: Trace, machine: Machine, name: str) -> QuantityComparison:
    """Compare a measured quantity with the machine's output of that name.

    Zeros around the turn are tried with scale and offset solved for; from the best one all four are fitted by least
    squares with Huber's loss. Intervals by `uncertainty_by_turns`.

    Raises RecordingError with too few samples, less than a turn, or a constant quantity.
    """
    encoder = machine.sensors.encoder
    origin = int(trace.angle_stamps_ns[0])
    track = shaft_track(trace.angle_stamps_ns, trace.angle_rad, trace.velocities, origin_ns=origin, encoder=encoder)
    finite = np.isfinite(trace.values)
    time: FloatArray = np.asarray((trace.stamps_ns[finite] - origin) * 1e-9, np.float64)
    measured = trace.values[finite]
    if time.size:
        track = track.between(float(time.min()), float(time.max()))
    twin = compile_rigid(machine, [name])
    slow_rad_s = REST_SHARE * track.fast_rad_s if _depends_on_sense(twin, name) else 0.0
    _, omega, _, inside = track.at(time)
    _check_beside(name, inside)
    turning = ~inside | (np.abs(omega) >= slow_rad_s)
    at_rest = int(np.count_nonzero(~turning))
    time, measured = time[turning], measured[turning]
    if at_rest and time.size < _FEWEST:
        raise RecordingError(
            f"only {time.size} samples of {name} while the shaft turns, and {at_rest} at rest, where dry friction may"
            " be anything: record it at work"
        )
    _check(name, track, time, measured)
    configured_zero = encoder.zero_rad * encoder.direction * encoder.ratio
    few = np.linspace(0, time.size - 1, min(time.size, _COARSE_SAMPLES)).astype(np.int64)
    model, coarse = (
        _Model(twin, name, track, some, encoder.direction, configured_zero, slow_rad_s) for some in (time, time[few])
    )
    _check_machine(coarse, name)
    one_speed = track.at_one_speed
    values = {"scale": 1.0, "offset": 0.0, "zero_rad": 0.0, "delay_s": 0.0}
    free: tuple[str, ...] = ("scale", "offset", "delay_s")
    if _tells_zero(coarse):
        values["zero_rad"], values["delay_s"] = _start(coarse, measured[few], _usual_speed(track), one_speed)
        free = free if one_speed else (*free, "zero_rad")
    values = _fit(model, measured, values, free)
    # The common step may stop at a discontinuity; scale and offset are then fitted alone.
    values = _fit(model, measured, values, ("scale", "offset"))
    quantity, theta, good = model.at(values["zero_rad"], values["delay_s"])
    expected = values["scale"] * quantity + values["offset"]
    good &= model.clear(values["zero_rad"], values["delay_s"])
    residual = (measured - expected)[good]
    jacobian = _slopes(model, values, free)[good]
    found = uncertainty_by_turns(jacobian, residual, np.floor(theta[good] / TURN).astype(np.int64))
    known = {each: found.estimate(k, values[each]) for k, each in enumerate(free)}
    fitted = {each: known.get(each, Estimate(values[each])) for each in values}
    usual = encoder.direction * _usual_speed(track)
    around = np.broadcast_to(_over_a_turn(twin, name, usual), (720,))
    return QuantityComparison(
        name=name,
        **fitted,
        rms=float(np.sqrt(np.mean(residual**2))),
        rms_configured=_nominal_rms(model, measured),
        explained=1.0 - float(np.mean(residual**2)) / max(float(np.var(measured[good])), 1e-300),
        measured_range=abs(values["scale"]) * float(np.ptp(around)),
        machine_range=float(np.ptp(around)),
        speed_rad_s=usual,
        one_speed=one_speed,
        at_rest=at_rest,
        time_s=time[good],
        measured=measured[good],
        expected=expected[good],
        theta_rad=theta[good],
    )


def _check(name: str, track: ShaftTrack, time: FloatArray, measured: FloatArray) -> None:
    if track.turns < 1.0:
        raise RecordingError(f"the shaft makes {track.turns:.2f} of a turn: record {name} over some turns")
    inside = track.at(time)[3]
    _check_beside(name, inside)
    if float(np.ptp(measured[inside])) == 0.0:
        raise RecordingError(f"{name} is {measured[0]:g} throughout: a dead sensor, or not connected")


def _check_beside(name: str, inside: BoolArray) -> None:
    if np.count_nonzero(inside) < _FEWEST:
        raise RecordingError(
            f"only {np.count_nonzero(inside)} of {inside.size} samples of {name} lie beside shaft angles; both must be"
            " stamped by one clock"
        )


def _line(quantity: FloatArray, measured: FloatArray) -> tuple[float, float]:
    """Least-squares scale and offset."""
    centred = quantity - quantity.mean()
    scale = float(centred @ measured) / max(float(centred @ centred), 1e-300)
    return scale, float(measured.mean() - scale * quantity.mean())


def _start(model: _Model, measured: FloatArray, speed_rad_s: float, one_speed: bool) -> tuple[float, float]:
    """Search the start values of zero [rad] and delay [s]: zeros around the turn, delays within half a turn.

    At one speed their sum is taken as a delay, since a lagging camera is more likely than a wrong zero. The search
    refines by halved steps, not by slopes, which a discontinuous quantity does not have.
    """
    zeros = TURN * np.arange(_ZEROS) / _ZEROS
    best = min((_left(model, measured, zero, 0.0), zero, 0.0) for zero in zeros.tolist())
    speed = model.direction * speed_rad_s
    step_rad = TURN / _ZEROS
    if one_speed:
        late, step_s, step_rad = math.remainder(best[1], TURN) / speed, step_rad / abs(speed), 0.0
        best = (_left(model, measured, 0.0, late), 0.0, late)
    else:
        longest = min(_LONGEST_DELAY_S, 0.5 * TURN / abs(speed))
        lates, step_s = np.linspace(-longest, longest, 2 * _DELAYS + 1, retstep=True)
        # the zero changes too, so that the phase at the usual speed stays
        tried = ((best[1] - speed * late, late) for late in lates.tolist())
        best = min(best, *((_left(model, measured, *each), *each) for each in tried))
    for _ in range(_HALVINGS):
        _, zero, delay = best
        moves = [(zero, delay - step_s), (zero, delay + step_s)]
        if not one_speed:
            moves += [(zero - step_rad, delay), (zero + step_rad, delay)]
            moves += [(zero - speed * late, delay + late) for late in (-step_s, step_s)]
        found = min((_left(model, measured, *each), *each) for each in moves)
        if found[0] < best[0]:
            best = found
        else:
            step_rad, step_s = 0.5 * step_rad, 0.5 * step_s
    return math.remainder(best[1], TURN), best[2]


def _left(model: _Model, measured: FloatArray, zero_rad: float, delay_s: float) -> float:
    """Mean square of the residual at a zero and a delay; infinite for a mirrored trace or with few samples."""
    quantity, _, good = model.at(zero_rad, delay_s)
    if 2 * np.count_nonzero(good) < good.size:
        return math.inf
    scale, offset = _line(quantity[good], measured[good])
    return float(np.mean((measured[good] - max(scale, 0.0) * quantity[good] - offset) ** 2))


def _nominal_rms(model: _Model, measured: FloatArray) -> float:
    quantity, _, good = model.at(0.0, 0.0)
    return float(np.std(measured[good] - quantity[good]))


def _fit(model: _Model, measured: FloatArray, start: dict[str, float], free: tuple[str, ...]) -> dict[str, float]:
    """Least squares with Huber's loss in the free values, each scaled by its effect."""
    quantity, _, good = model.at(start["zero_rad"], start["delay_s"])
    scale, offset = _line(quantity[good], measured[good])
    start = start | {"scale": scale, "offset": offset}
    size = np.sqrt(np.mean(_slopes(model, start, free)[good] ** 2, axis=0)) + 1e-300
    noise = robust_scale((measured - scale * quantity - offset)[good])

    def at(x: FloatArray) -> dict[str, float]:
        return start | dict(zip(free, (x / size).tolist(), strict=True))

    def residual(x: FloatArray) -> FloatArray:
        values = at(x)
        found = model.at(values["zero_rad"], values["delay_s"])[0]
        return np.asarray((values["scale"] * found + values["offset"] - measured)[good] / noise)

    def jacobian(x: FloatArray) -> FloatArray:
        return np.asarray(_slopes(model, at(x), free)[good] / (size * noise))

    begin = np.array([start[name] for name in free]) * size
    return at(scipy.optimize.least_squares(residual, begin, jacobian, loss="huber", f_scale=HUBER, max_nfev=40).x)


def _slopes(model: _Model, values: dict[str, float], free: tuple[str, ...]) -> FloatArray:
    """Derivatives (m, k) of the expected quantity by the free values."""
    quantity, _, _ = model.at(values["zero_rad"], values["delay_s"])
    columns = []
    for name in free:
        if name in _STEPS:
            step = _STEPS[name]
            ends = [values | {name: values[name] + side * step} for side in (-1.0, 1.0)]
            low, high = (model.at(end["zero_rad"], end["delay_s"])[0] for end in ends)
            clear = model.clear(values["zero_rad"], values["delay_s"])
            columns.append(np.where(clear, values["scale"] * (high - low) / (2.0 * step), 0.0))
        else:
            columns.append(quantity if name == "scale" else np.ones_like(quantity))
    return np.stack(columns, axis=1)


def _over_a_turn(twin: Twin, name: str, omega_rad_s: float) -> FloatArray:
    theta = TURN * np.arange(720) / 720
    return np.asarray(twin.evaluate(theta, np.full_like(theta, omega_rad_s), np.zeros_like(theta))[name])


def _usual_speed(track: ShaftTrack) -> float:
    """Median speed [rad/s] of a shaft while it turns."""
    omega = track.omega_rad_s
    return float(np.median(omega[np.abs(omega) > _TURNING_SHARE * track.fast_rad_s]))


def _is_discontinuous(twin: Twin, name: str, angle_rad: float) -> bool:
    """Return true if a quantity is discontinuous at an angle of the shaft."""
    low, high = (float(twin.evaluate(angle_rad + side * _BESIDE_RAD, 1.0, 0.0)[name]) for side in (-1.0, 1.0))
    return abs(high - low) > _LEAP * float(np.ptp(_over_a_turn(twin, name, 1.0)))


def _depends_on_sense(twin: Twin, name: str) -> bool:
    """Return true if a quantity contains dry friction: at standstill it has a value for each sense of rotation.

    The two values differ by more than rounding, relative to the quantity at speed.
    """
    theta = TURN * np.arange(720) / 720
    forward, back = (twin.evaluate(theta, negligible_speed(np.full(720, way)), 0.0)[name] for way in (1.0, -1.0))
    usual = np.abs(_over_a_turn(twin, name, 1.0))
    return bool(np.nanmax(np.abs(forward - back)) > _CONSTANT * np.nanmax(usual))


def _tells_zero(model: _Model) -> bool:
    """Return true if the quantity is not linear in the shaft's angle, where a zero would act as an offset."""
    (slope,) = _slopes(model, {"scale": 1.0, "offset": 0.0, "zero_rad": 0.0, "delay_s": 0.0}, ("zero_rad",)).T
    quantity, _, good = model.at(0.0, 0.0)
    return bool(np.ptp(slope[good]) > _TELLS * (np.abs(slope[good]).max() + np.ptp(quantity[good])))


def _check_machine(model: _Model, name: str) -> None:
    """Raise RecordingError if the machine's quantity is constant."""
    quantity, _, good = model.at(0.0, 0.0)
    if np.ptp(quantity[good]) <= _CONSTANT * np.abs(quantity[good]).max():
        raise RecordingError(
            f"the machine's {name} stays {quantity[good][0]:g} in this recording: nothing can be held against it;"
            " choose another output, or record other speeds"
        )
