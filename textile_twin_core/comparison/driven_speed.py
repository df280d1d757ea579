"""Ripple of the shaft's speed compared with the ripple that the measured torque causes, by orders of the shaft."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import scipy

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack, shaft_track
from textile_twin_core.dynamics import Body
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine, TorqueFilter
from textile_twin_core.machine.drive import drive
from textile_twin_core.machine.sensors import Encoder
from textile_twin_core.twin import compile_machine

HIGHEST = 6
"""Highest order of the turn that is compared."""
_BINS = 720
_SETTLED = 0.15
_FEWEST_CYCLES = 3.0
_NEAR = 0.2
_TRIES, _STARTS = 3, 3
_LEAST_PASSED = 0.1
"""Least share of a wave of the torque that the sensor's filter passes, for the filter to be undone there."""
_FOLLOWS, _LATE_S, _OTHER_INERTIA, _WHEEL = 0.8, 1e-3, 0.03, 0.03


@dataclass(frozen=True)
class DrivenSpeed:
    """Ripple of the speed: measured, and caused by the measured torque.

    Attributes:
        orders: (k,) of the turn. seen, driven: (k,) complex amplitudes of the measured and the caused ripple
            [rad/s], as exp(i order angle).
        chosen: (k,) true for the orders that pitch errors of a toothed wheel do not disturb.
        speed_rad_s, cycles: mean speed, and cycles of the load in the record.
        added_inertia_kgm2, inertia_kgm2: inertia added to the machine file's, and the total mean over the cycle.
        delay_s: lag of the torque behind the speed that it causes.
        explained, explained_all: R2 of the chosen orders and of all, with that inertia and no delay.
        machine: with that inertia, and with the pitch errors of its toothed wheel that torque and motion show.
    """

    orders: FloatArray
    seen: np.ndarray
    driven: np.ndarray
    chosen: BoolArray
    speed_rad_s: float
    cycles: float
    added_inertia_kgm2: float
    inertia_kgm2: float
    delay_s: float
    explained: float
    explained_all: float
    machine: Machine

    @property
    def orders_text(self) -> str:
        """The chosen orders in words."""
        return ", ".join(f"{order:g}" for order in self.orders[self.chosen])

    @property
    def verdict(self) -> str:
        """Faults of torque, machine and wheel, in words."""
        if self.explained < _FOLLOWS:
            return f"the speed does not follow this torque: {1.0 - self.explained:.0%} of its ripple stays unexplained"
        said = []
        if abs(self.delay_s) > _LATE_S:
            said.append(f"the torque lags by {self.delay_s * 1e3:+.2f} ms")
        if abs(self.added_inertia_kgm2) > _OTHER_INERTIA * self.inertia_kgm2:
            nominal = self.inertia_kgm2 - self.added_inertia_kgm2
            said.append(f"the inertia is {self.inertia_kgm2 / nominal:.3f} times that of the machine file")
        if not self.chosen.all() and self.explained - self.explained_all > _WHEEL:
            said.append("the toothed wheel has pitch errors that read as ripple: settle them with calibrate --wheel")
        what = "; ".join(said) or "nothing is wrong"
        return f"{what}: the torque explains {self.explained:.1%} of the speed's ripple"

    def to_json(self) -> dict[str, Any]:
        """One object of plain lists and numbers; amplitudes as magnitudes and phases."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        del values["seen"], values["driven"], values["machine"]
        for name, wave in (("seen", self.seen), ("driven", self.driven)):
            values |= {f"{name}_rad_s": np.abs(wave), f"{name}_phase_rad": np.angle(wave)}
        out: dict[str, Any] = plain({"quantity": "speed", **values, "verdict": self.verdict})
        return out


def driven_speed(readings: Readings, machine: Machine) -> DrivenSpeed:
    """Compare the ripple of the shaft's speed with the one that the measured torque causes in this machine.

    The torque is averaged over the cycle (`cycle_turns` of the encoder), its mean, which the load takes, is subtracted,
    and `drive` turns it into a motion. Inertia and delay follow from the amplitudes and phases of the orders. Pitch
    errors of a toothed wheel read as ripple of whole orders, so with a wheel and a cycle of several turns only the
    other orders count.

    Raises RecordingError for a record with too few cycles at one speed.
    """
    encoder = machine.sensors.encoder
    origin = int(readings.angle_stamps_ns[0])
    track = shaft_track(
        readings.angle_stamps_ns, readings.angle, readings.velocities, origin_ns=origin, encoder=encoder
    )
    zero = encoder.zero_rad * encoder.direction * encoder.ratio
    cycle = TURN * encoder.cycle_turns
    late = _whole_cycles(track.theta_rad, track, cycle)
    theta = encoder.direction * track.theta_rad[late] - zero
    omega = encoder.direction * track.omega_rad_s[late]
    speed = _mean_over_angle(theta, omega)
    cycles = float(np.ptp(theta)) / cycle
    if not cycles > _FEWEST_CYCLES or float(np.mean(np.abs(omega / speed - 1.0) < _NEAR)) < 0.9:
        raise RecordingError(
            f"speed under a torque needs some cycles at one speed; here {cycles:.1f} cycles at"
            f" {omega.min():.4g} .. {omega.max():.4g} rad/s"
        )
    count = HIGHEST * encoder.cycle_turns
    orders = np.arange(1, count + 1) / encoder.cycle_turns
    seen = amplitudes(theta, omega, orders)
    chosen = np.ones(count, dtype=np.bool_)
    if encoder.teeth and encoder.cycle_turns > 1:
        chosen = np.arange(1, count + 1) % encoder.cycle_turns != 0
    torque = _mean_cycle(readings, track, machine, origin, cycle, speed)
    bare = replace(machine, loads=())
    inertia, added = _mean_inertia(bare), 0.0
    for _ in range(_TRIES):
        driven = _driven(_with_inertia(bare, added), torque, speed, cycle, orders)
        factor, delay = _factor_and_delay(seen[chosen], driven[chosen], orders[chosen] * speed)
        added += (inertia + added) * (1.0 / factor - 1.0)
        if abs(factor - 1.0) < 1e-4:
            break
    driven = driven * factor
    settled = _with_inertia(machine, added)
    if encoder.teeth:
        pitch = _pitch_errors(seen - driven, orders, speed, zero, encoder)
        pitch += np.array(track.pitch_errors_rad)
        wheel = replace(encoder, pitch_errors_rad=tuple(pitch.tolist()))
        settled = replace(settled, sensors=replace(machine.sensors, encoder=wheel))
    return DrivenSpeed(
        orders=orders,
        seen=seen,
        driven=driven,
        chosen=chosen,
        speed_rad_s=speed,
        cycles=cycles,
        added_inertia_kgm2=added,
        inertia_kgm2=inertia + added,
        delay_s=delay,
        explained=_explained(seen[chosen], driven[chosen]),
        explained_all=_explained(seen, driven),
        machine=settled,
    )


def _whole_cycles(theta: FloatArray, track: ShaftTrack, cycle: float) -> BoolArray:
    """Return true for the angles in the last whole cycles of a record, without its beginning."""
    gone = np.abs(theta - track.theta_rad[0])
    end = float(np.abs(track.theta_rad[-1] - track.theta_rad[0]))
    count = np.floor((1.0 - _SETTLED) * end / cycle)
    return np.asarray((gone > end - max(count, 1.0) * cycle) & (gone <= end))


def _pitch_errors(excess: np.ndarray, orders: FloatArray, speed: float, zero: float, encoder: Encoder) -> FloatArray:
    """Pitch errors (teeth,) [rad] that read as this ripple of whole orders.

    An angle error e(angle) reads as a speed error of speed times the slope of e, so each amplitude of e is that of
    the ripple over (i order speed). The true place of an edge is the reading less e.
    """
    whole = np.abs(orders - np.rint(orders)) < 1e-9
    tooth = encoder.direction * encoder.ratio * TURN * np.arange(encoder.teeth) / encoder.teeth - zero
    waves = np.exp(1j * np.outer(tooth, orders[whole]))
    off: FloatArray = (waves @ (excess[whole] / (1j * orders[whole] * speed))).real
    return -off


def amplitudes(theta: FloatArray, omega: FloatArray, orders: FloatArray) -> np.ndarray:
    """Complex amplitudes (k,) of a speed over the angle, by least squares with a slow change of the mean."""
    place = 2.0 * (theta - theta[0]) / (theta[-1] - theta[0]) - 1.0
    waves = np.exp(1j * np.outer(theta, orders))
    table = np.concatenate([np.polynomial.chebyshev.chebvander(place, 3), waves.real, waves.imag], axis=1)
    answer = np.linalg.lstsq(table, omega, rcond=None)[0]
    return np.asarray(answer[4 : 4 + orders.size] - 1j * answer[4 + orders.size :])


def _mean_over_angle(theta: FloatArray, omega: FloatArray) -> float:
    return float(scipy.integrate.trapezoid(omega, theta) / (theta[-1] - theta[0]))


def _mean_cycle(
    readings: Readings, track: ShaftTrack, machine: Machine, origin: int, cycle: float, speed: float
) -> FloatArray:
    """Measured torque over the cycle (bins,) less the machine's loads and less its mean [N m]."""
    sensor, encoder = machine.sensors.torque, machine.sensors.encoder
    time: FloatArray = np.asarray((readings.torque_stamps_ns - origin) * 1e-9 - sensor.delay_s, np.float64)
    theta, _, _, good = track.at(time)
    # From the same cycles as the speed, since cycles of an engine differ.
    good &= np.isfinite(readings.torque) & _whole_cycles(theta, track, cycle)
    theta = encoder.direction * theta[good] - encoder.zero_rad * encoder.direction * encoder.ratio
    torque = (readings.torque[good] - sensor.offset_Nm) / sensor.gain
    place = np.floor(np.mod(theta, cycle) / cycle * _BINS).astype(np.int64) % _BINS
    number = np.bincount(place, minlength=_BINS)
    if (number == 0).any():
        raise RecordingError("the torque comes too seldom for a mean over the cycle: record longer, or faster")
    mean = _unfiltered(np.bincount(place, torque, _BINS) / number, TorqueFilter.of(sensor), speed / cycle)
    if machine.loads:
        angle = (np.arange(_BINS) + 0.5) * cycle / _BINS
        load = compile_machine(machine, ["torque_load_Nm"]).evaluate(
            angle, np.full_like(angle, speed), np.zeros_like(angle)
        )
        mean = mean - load["torque_load_Nm"]
    return np.asarray(mean - mean.mean())


def _unfiltered(mean_Nm: FloatArray, torque_filter: TorqueFilter, cycles_per_s: float) -> FloatArray:
    """Undo the filter of the sensor on a mean over the cycle (bins,), up to where it passes too little of a wave."""
    if torque_filter.is_identity:
        return mean_Nm
    waves = np.fft.rfft(mean_Nm)
    passed = torque_filter.response(np.arange(waves.size) * cycles_per_s)
    clear = np.abs(passed) > _LEAST_PASSED
    waves[clear] /= passed[clear]
    waves[~clear] = 0.0
    return np.asarray(np.fft.irfft(waves, mean_Nm.size))


def _driven(machine: Machine, torque: FloatArray, speed: float, cycle: float, orders: FloatArray) -> np.ndarray:
    """Orders of the machine's speed under a torque over the cycle (bins,), simulated for three cycles.

    The initial speed is adjusted until the mean speed over the angle equals the measured one, because the ripple
    depends on it.
    """
    around = np.append(torque, torque[0])

    def law(time: float, theta: float, omega: float) -> float:
        place = np.mod(theta / cycle - 0.5 / _BINS, 1.0) * _BINS
        left = min(int(place), _BINS - 1)
        return float(around[left] + (place - left) * (around[left + 1] - around[left]))

    times, start = np.linspace(0.0, 3.0 * cycle / abs(speed), 1000), speed
    for _ in range(_STARTS):
        motion = drive(machine, law, 0.0, start, times, tolerance=1e-7)
        start += speed - _mean_over_angle(motion.theta_rad, motion.omega_rad_s)
    return amplitudes(motion.theta_rad, motion.omega_rad_s, orders)


def _factor_and_delay(seen: np.ndarray, driven: np.ndarray, rates: FloatArray) -> tuple[float, float]:
    """Fit the factor on the caused ripple and the delay of the torque [s] that match the measured ripple best."""

    def residual(x: FloatArray) -> FloatArray:
        difference = seen - x[0] * driven * np.exp(1j * rates * x[1] * 1e-3)
        return np.concatenate([difference.real, difference.imag])

    start = abs(np.vdot(driven, seen)) / max(np.vdot(driven, driven).real, 1e-300)
    best = min(
        (scipy.optimize.least_squares(residual, [start, late]) for late in np.linspace(-4.0, 4.0, 9)),
        key=lambda each: each.cost,
    )
    return float(best.x[0]), float(best.x[1]) * 1e-3


def _explained(seen: np.ndarray, driven: np.ndarray) -> float:
    residual = seen - driven
    return float(1.0 - np.vdot(residual, residual).real / np.vdot(seen, seen).real)


def _mean_inertia(machine: Machine) -> float:
    theta = TURN * np.arange(_BINS) / _BINS
    found = compile_machine(machine, ["equivalent_inertia_kgm2"]).evaluate(
        theta, np.ones_like(theta), np.zeros_like(theta)
    )
    return float(np.mean(found["equivalent_inertia_kgm2"]))


def _with_inertia(machine: Machine, added: float) -> Machine:
    """Return the machine with inertia added to its flywheel; a negative one is taken from it."""
    wheels = sum(body.inertia_kgm2 for body in machine.bodies if body.is_flywheel)
    others = tuple(body for body in machine.bodies if not body.is_flywheel)
    return replace(machine, bodies=(*others, Body.flywheel(max(wheels + added, 0.0))))


def driven_rows(found: DrivenSpeed) -> list[tuple[str, str]]:
    """Rows of names and values for display, the verdict last."""
    return [
        ("mean speed", f"{found.speed_rad_s * 30.0 / np.pi:.2f} rpm over {found.cycles:.1f} cycles of the load"),
        ("inertia beside the machine file's", f"{found.added_inertia_kgm2:+.5f} kg m2, as this ripple asks for"),
        ("inertia in all", f"{found.inertia_kgm2:.5f} kg m2, mean over the turn"),
        ("delay of the torque", f"{found.delay_s * 1e3:+.3f} ms"),
        ("speed ripple explained, R2", f"{found.explained:.4f}, of the orders {found.orders_text}"),
        ("R2 of all orders", f"{found.explained_all:.4f}"),
        ("verdict", found.verdict),
    ]
