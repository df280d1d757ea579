"""Recordings of machines whose load depends on a measure, by equations that share nothing with the engine.

The motion and sensors are those of `mill_recordings`; the force acts on the needle over its depth below the backing's
plane, or on the loom's sley over its arc from the rear.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.generators.mill_recordings import SPEED, START_NS, Case, MillRecording, healthy, record, shown_torque
from tests.generators.multibody import Floats
from tests.generators.shaft_law import loom_law, tufting_law

PLANE_M, FORCE_N = 0.55784, 772.0
_ROCKER_M, _TURN = 0.23, 2.0 * math.pi
Law = Callable[[Floats, Floats], Floats]
"""Force [N] over the share of the range (0 at its begin, 1 at its end) and the speed over the usual one."""


@dataclass(frozen=True)
class ForceLaw:
    """A force against the motion on the way in and on the way out, over the last `range_m` of the measure.

    range_m: 0: the needle's whole depth below the plane.
    """

    machine: str
    down: Law
    up: Law
    range_m: float = 0.0


def _bump(z: Floats, at: float, wide: float) -> Floats:
    return np.asarray(np.exp(-(((z - at) / wide) ** 2)))


LAWS: dict[str, ForceLaw] = {
    "rising": ForceLaw("tufting", lambda z, v: 0.4 + 0.8 * z, lambda z, v: 0.4 + 0.8 * z),
    "grip": ForceLaw("tufting", lambda z, v: 1.2 + 0.0 * z, lambda z, v: 0.3 + 0.0 * z),
    "pierce": ForceLaw("tufting", lambda z, v: 0.7 + 0.9 * _bump(z, 0.2, 0.12), lambda z, v: 0.35 + 0.0 * z),
    "constant": ForceLaw("tufting", lambda z, v: 1.0 + 0.0 * z, lambda z, v: 1.0 + 0.0 * z),
    "two pierces": ForceLaw(
        "tufting",
        lambda z, v: 0.5 + 0.7 * _bump(z, 0.18, 0.1) + 0.5 * _bump(z, 0.6, 0.1),
        lambda z, v: 0.3 + 0.1 * z,
    ),
    "by speed": ForceLaw("tufting", lambda z, v: (0.3 + z) * v, lambda z, v: 0.4 * v + 0.0 * z),
    "stick-slip": ForceLaw(
        "tufting", lambda z, v: 0.8 + 0.3 * z, lambda z, v: 0.4 + 0.15 * np.asarray(np.mod(6.0 * z, 1.0))
    ),
    "one side": ForceLaw("tufting", lambda z, v: 1.1 - 0.4 * z, lambda z, v: 0.0 * z),
    "beat-up": ForceLaw("loom", lambda z, v: 1.4 * z**1.5, lambda z, v: -0.8 * z**2, range_m=0.008),
}
"""Laws as multiples of FORCE_N."""


def measured(machine: str, theta: Floats) -> tuple[Floats, Floats]:
    """Compute the measure [m] and its slope: the needle's distance below C, or the sley's arc from the rear."""
    law = tufting_law() if machine == "tufting" else loom_law()
    _, _, _, travel, slope = law.at(theta)
    if machine == "tufting":
        return travel, slope
    half = 0.5 * _ROCKER_M  # the travel is the height of the rocker's middle, left of its pivot
    lowest = np.min(_rocker(loom_law().at(np.linspace(0.0, _TURN, 20_001))[3]))
    angle = _rocker(travel)
    return _ROCKER_M * (angle - lowest), _ROCKER_M * slope / (half * np.cos(angle))


def _rocker(height: Floats) -> Floats:
    return np.asarray(math.pi - np.arcsin(height / (0.5 * _ROCKER_M)))


def reach(machine: str) -> float:
    """Largest value of the measure [m]."""
    return float(np.max(measured(machine, np.linspace(0.0, _TURN, 20_001))[0]))


def force(law: ForceLaw, place: Floats, growing: bool, speed: float = 1.0) -> Floats:
    """Compute the true force [N] at values of the measure."""
    end = reach(law.machine)
    begin = end - law.range_m if law.range_m else PLANE_M
    z = (place - begin) / (end - begin)
    own = law.down if growing else law.up
    return np.where(place >= begin, FORCE_N * own(np.maximum(z, 0.0), np.full_like(place, speed)), 0.0)


def case_of(law: ForceLaw, seed: int, **changes: object) -> Case:
    """Return a healthy case of the law's machine, without the constant backing."""
    case = healthy(law.machine, seed, **changes)
    return replace(case, backing=replace(case.backing, force_N=0.0))


def record_law(law: ForceLaw, case: Case) -> MillRecording:
    """Sample a case's sensors, with the law's torque in the shaft."""
    made = record(case)
    return replace(made, torque=made.torque + case.torque.gain * law_torque(law, case, made))


def law_torque(law: ForceLaw, case: Case, made: MillRecording) -> Floats:
    """Compute the law's torque in the shaft at each measured torque, as the sensor's delay shows it [N m]."""
    end = reach(law.machine)
    begin = end - law.range_m if law.range_m else PLANE_M

    def at(theta: Floats, omega: Floats, _: Floats) -> Floats:
        place, slope = measured(law.machine, theta)
        z = np.maximum((place - begin) / (end - begin), 0.0)
        speed = np.abs(omega) / SPEED[law.machine]
        size = np.where(slope * omega > 0.0, law.down(z, speed), law.up(z, speed)) * FORCE_N
        return np.asarray(np.where(place >= begin, size, 0.0) * slope * np.sign(slope * omega))

    return shown_torque(case, made.plan, _late(case, made), at)


def _late(case: Case, made: MillRecording) -> Floats:
    """Time of the shaft that each measured torque shows [s]."""
    s = case.torque
    stamped = (made.torque_stamps_ns - START_NS) * 1e-9
    time = 0.0507 + np.rint((stamped - 0.0507) * s.rate_hz) / s.rate_hz  # the stamps' errors are far below an interval
    return np.asarray(np.clip(time - s.delay_s - s.drift * (time - 0.5 * case.duration_s), 0.0, case.duration_s))


def motion_at_torques(case: Case, made: MillRecording) -> tuple[Floats, Floats]:
    """Compute angle and speed of the shaft that each measured torque shows."""
    theta, omega, _ = made.plan.at(_late(case, made))
    return theta, omega


def pierce_in_cloth(
    case: Case, growth: Callable[[Floats], Floats], cloth: Callable[[Floats], Floats], with_pierce: bool
) -> MillRecording:
    """Record the law "pierce" with needles and cloth that change.

    Args:
        case: of the machine.
        growth, cloth: change of the pierce and of the cloth's force, as shares, by the number of the turn.
        with_pierce: the cloth changes the pierce, too, and not only the force beside it.
    """
    made = record_law(LAWS["pierce"], case)
    theta, _ = motion_at_torques(case, made)
    turn = (theta - theta[0]) / _TURN
    pierce = law_torque(ForceLaw("tufting", lambda z, v: 0.9 * _bump(z, 0.2, 0.12), lambda z, v: 0.0 * z), case, made)
    whole = law_torque(LAWS["pierce"], case, made)
    grown = pierce * growth(turn)
    other = cloth(turn) * (whole + grown if with_pierce else whole - pierce)
    return replace(made, torque=made.torque + case.torque.gain * (grown + other))
