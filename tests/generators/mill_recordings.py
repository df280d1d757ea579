"""Recordings of a mill's logger, healthy or with one mistake in the recording or the machine file.

The truth is `shaft_law` over `planned_motion`; the sensors are here. `CASES` holds every mistake by name, with the
causes that a verdict may name first.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import scipy

from tests.generators.multibody import Floats
from tests.generators.planned_motion import Plan, run_up_and_down, steady
from tests.generators.rocker_spring import spring_torque
from tests.generators.shaft_law import LOOM_FRICTION, Backing, Friction, loom_law, tufting_law

Stamps = npt.NDArray[np.int64]
START_NS = 1_767_081_600_000_000_000
_FINE_S = 5e-5
SPEED = {"tufting": 16.755, "loom": 14.0}


@dataclass(frozen=True)
class Encoder:
    """shaft = (q - zero) * direction * ratio; one turn of the encoder is logged as `turn`.

    measured = q + c cos q + s sin q + .. with the pairs (c, s) of `run_out_rad`, once per turn of the encoder, ...
    """

    zero_rad: float = 0.0
    direction: int = 1
    ratio: float = 1.0
    turn: float = 2.0 * math.pi
    bits: int = 14
    rate_hz: float = 500.0
    wrapped: bool = True
    run_out_rad: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class TorqueSensor:
    """measured(t) = gain * filtered torque(t - delay) + offset, delay growing by `drift` seconds a second.

    Noise is added before the gain, behind the filters: low passes of order 1 or 2, a high pass of order 1; 0: none.
    hum: (size [N m], Hz) of a line in time. step_Nm: of the readings. hold_hz: rate of a drive that repeats its values.
    """

    gain: float = 1.0
    offset_Nm: float = 0.0
    delay_s: float = 0.0
    drift: float = 0.0
    noise_Nm: float = 0.08
    rate_hz: float = 500.0
    low_pass_hz: float = 0.0
    low_pass_order: int = 1
    high_pass_hz: float = 0.0
    hum: tuple[float, float] = (0.0, 50.0)
    step_Nm: float = 0.0
    hold_hz: float = 0.0


@dataclass(frozen=True)
class Settings:
    """Sensor and friction values in the machine file."""

    zero_rad: float = 0.0
    direction: int = 1
    ratio: float = 1.0
    gain: float = 1.0
    offset_Nm: float = 0.0
    delay_s: float = 0.0
    friction: bool = True


@dataclass(frozen=True)
class Case:
    """A recording's truth and the user's machine file; `spring`: both have that of `rocker_spring`."""

    machine: str = "tufting"
    configured_machine: str = ""
    encoder: Encoder = field(default_factory=Encoder)
    torque: TorqueSensor = field(default_factory=TorqueSensor)
    configured: Settings = field(default_factory=Settings)
    backing: Backing = field(default_factory=Backing)
    friction: Friction = field(default_factory=Friction)
    added_inertia_kgm2: float = 0.0
    duration_s: float = 24.0
    run_up: bool = True
    seed: int = 0
    start_rad: float | None = None
    stamp_error_s: float = 20e-6
    loss: float = 0.02
    spring: bool = False


@dataclass(frozen=True)
class MillRecording:
    """Logged angle and torque with their stamps."""

    angle_stamps_ns: Stamps
    angle: Floats
    torque_stamps_ns: Stamps
    torque: Floats
    plan: Plan = field(compare=False)


def healthy(machine: str, seed: int, **changes: object) -> Case:
    """Return a case without a mistake; the loom has its friction, also in the file."""
    friction = LOOM_FRICTION if machine == "loom" else Friction()
    case = Case(machine=machine, configured_machine=machine, friction=friction, seed=seed)
    return dataclasses.replace(case, **changes)  # type: ignore[arg-type]


def torque_of(case: Case, theta: Floats, omega: Floats, alpha: Floats) -> Floats:
    """Compute the true torque of a case's machine."""
    law, backing = (tufting_law(), case.backing) if case.machine == "tufting" else (loom_law(), None)
    torque = law.torque(theta, omega, alpha, case.friction, backing, case.added_inertia_kgm2)
    return torque + spring_torque(case.machine, theta) if case.spring else torque


def record(case: Case) -> MillRecording:
    """Sample a case's sensors."""
    rng = np.random.default_rng([case.seed, 20260101, case.machine == "loom"])
    make = run_up_and_down if case.run_up else steady
    plan = make(case.duration_s, SPEED[case.machine], rng)
    if case.start_rad is not None:
        plan = replace(plan, start_rad=case.start_rad)
    e, s = case.encoder, case.torque

    time = np.arange(0.05, case.duration_s - 0.05, 1.0 / e.rate_hz)
    theta, _, _ = plan.at(time)
    turned = theta / (e.direction * e.ratio) + e.zero_rad
    angle = turned.copy()
    for order, (c, s_) in enumerate(e.run_out_rad, 1):
        angle += c * np.cos(order * turned) + s_ * np.sin(order * turned)
    step = 2.0 * math.pi / (1 << e.bits)
    angle = np.rint(angle / step) * step
    if e.wrapped:
        angle = np.mod(angle, 2.0 * math.pi)
    angle *= e.turn / (2.0 * math.pi)
    angle_stamps, kept = _stamped(time, case, rng)
    angle = angle[kept]

    time = np.arange(0.0507, case.duration_s - 0.05, 1.0 / s.rate_hz)
    late = time - s.delay_s - s.drift * (time - 0.5 * case.duration_s)
    late = np.clip(late, 0.0, case.duration_s)
    torque = shown_torque(case, plan, late, lambda *state: torque_of(case, *state))
    torque = s.gain * (torque + s.noise_Nm * rng.standard_normal(time.size)) + s.offset_Nm
    torque += s.hum[0] * np.sin(2.0 * math.pi * s.hum[1] * time + 0.4)
    if s.step_Nm:
        torque = np.rint(torque / s.step_Nm) * s.step_Nm
    if s.hold_hz:
        torque = torque[np.searchsorted(time, np.floor(time * s.hold_hz) / s.hold_hz).clip(0, time.size - 1)]
    torque_stamps, kept = _stamped(time, case, rng)
    return MillRecording(angle_stamps, angle, torque_stamps, torque[kept], plan)


def shown_torque(case: Case, plan: Plan, time: Floats, torque_at: Callable[[Floats, Floats, Floats], Floats]) -> Floats:
    """Torque over the shaft's states behind the filters of a case's sensor, computed on a fine grid."""
    s = case.torque
    if not (s.low_pass_hz or s.high_pass_hz):
        return torque_at(*plan.at(time))
    fine = np.arange(0.0, case.duration_s + _FINE_S, _FINE_S)
    torque = torque_at(*plan.at(np.minimum(fine, case.duration_s)))
    if s.high_pass_hz:
        torque = torque - (torque[0] if case.run_up else torque.mean())
        torque = _filtered(torque, 1, s.high_pass_hz, "high")
    if s.low_pass_hz:
        torque = torque[0] + _filtered(torque - torque[0], s.low_pass_order, s.low_pass_hz, "low")
    return np.interp(time, fine, torque)


def _filtered(values: Floats, order: int, corner_hz: float, kind: str) -> Floats:
    """Filter values of the fine grid, from rest."""
    b, a = scipy.signal.butter(order, 2.0 * math.pi * corner_hz, kind, analog=True)
    b, a, _ = scipy.signal.cont2discrete((b, a), _FINE_S, "foh")
    return np.asarray(scipy.signal.lfilter(np.ravel(b), a, values))


def _stamped(time: Floats, case: Case, rng: np.random.Generator) -> tuple[Stamps, npt.NDArray[np.bool_]]:
    kept = rng.random(time.size) >= case.loss
    stamps = np.rint((time + case.stamp_error_s * rng.standard_normal(time.size)) * 1e9).astype(np.int64) + START_NS
    return stamps[kept], kept


Mistake = Callable[[Case, np.random.Generator], Case]


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def _zero(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, encoder=replace(case.encoder, zero_rad=math.radians(_either(rng, 4.0, 90.0))))


def _sign(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, torque=replace(case.torque, gain=-case.torque.gain))


def _newton_cm(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, torque=replace(case.torque, gain=100.0 * case.torque.gain))


def _gain(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, torque=replace(case.torque, gain=(1.0 + _either(rng, 0.05, 0.25)) * case.torque.gain))


def _offset(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, torque=replace(case.torque, offset_Nm=-float(rng.uniform(0.8, 4.0))))


def _delay(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, torque=replace(case.torque, delay_s=float(rng.uniform(0.002, 0.03))))


def _drift(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, torque=replace(case.torque, drift=_either(rng, 3e-4, 1e-3)))


def _direction(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, encoder=replace(case.encoder, direction=-case.encoder.direction))


def _ratio(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, encoder=replace(case.encoder, ratio=float(rng.choice([0.5, 2.0, 3.0, 1.0 / 3.0]))))


def _degrees(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, encoder=replace(case.encoder, turn=360.0))


def _slow(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, encoder=replace(case.encoder, rate_hz=20.0))


def _other(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, configured_machine="loom" if case.machine == "tufting" else "tufting")


def _half_turn(case: Case, rng: np.random.Generator) -> Case:
    # switched on in the second half of the shaft's turn, which the wrapped encoder reports as the first
    start = float(rng.uniform(3.3, 5.2))
    configured = replace(case.configured, ratio=0.5)
    return replace(case, encoder=replace(case.encoder, ratio=0.5), configured=configured, start_rad=start)


def _friction(case: Case, rng: np.random.Generator) -> Case:
    friction = Friction(float(rng.uniform(0.0, 0.06)), float(rng.uniform(0.8, 2.0)))
    return replace(case, friction=friction, configured=replace(case.configured, friction=False))


def _force(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, backing=replace(case.backing, force_N=1000.0 * (1.0 + _either(rng, 0.1, 0.3))))


def _flywheel(case: Case, rng: np.random.Generator) -> Case:
    return replace(case, added_inertia_kgm2=float(rng.uniform(0.02, 0.2)))


MISTAKES: dict[str, tuple[Mistake, tuple[str, ...]]] = {
    "zero": (_zero, ("encoder_zero",)),
    "sign": (_sign, ("torque_sign",)),
    "newton_cm": (_newton_cm, ("torque_unit",)),
    "gain": (_gain, ("torque_gain",)),
    "offset": (_offset, ("torque_offset",)),
    "delay": (_delay, ("delay",)),
    "drift": (_drift, ("clocks_drift",)),
    "direction": (_direction, ("encoder_direction",)),
    "ratio": (_ratio, ("encoder_ratio",)),
    "degrees": (_degrees, ("angle_unit",)),
    "slow_angle": (_slow, ("angle_rate",)),
    "other_machine": (_other, ("other_machine",)),
    "half_turn": (_half_turn, ("encoder_zero",)),
    "friction": (_friction, ("unmodelled_friction",)),
    "flywheel": (_flywheel, ("unmodelled_inertia",)),
    "load_force": (_force, ("load_force",)),
}
"""Function that makes each mistake, and the correct first causes."""

ONLY_TUFTING = ("load_force",)


def mistaken(machine: str, names: tuple[str, ...], seed: int, **changes: object) -> tuple[Case, set[str]]:
    """Return a case with the named mistakes, and the correct causes; without a run-up zero and delay are equivalent."""
    case, right = healthy(machine, seed, **changes), set[str]()
    rng = np.random.default_rng([seed, 7])
    for name in names:
        make, causes = MISTAKES[name]
        case = make(case, rng)
        right.update(causes)
    if not case.run_up and right & {"encoder_zero", "delay"} and "half_turn" not in names:
        right = (right - {"encoder_zero", "delay"}) | {"zero_or_delay"}
    return case, right
