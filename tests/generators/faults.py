"""Faults during operation: healthy turns, then a fault of a kind and size, with the truth of `shaft_law`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tests.generators.mill_recordings import Case, MillRecording, healthy, record, torque_of
from tests.generators.multibody import Floats

EXPECTED = {
    "needle_force": "load_force",
    "friction": "constant_torque",
    "sensor_gain": "sensor_gain",
    "sensor_offset": "sensor_offset",
    "encoder_slip": "phase",
    "noise": "noise",
    "bearing_bump": "profile",
    "dropout": "dropout",
    "stuck": "stuck",
}
"""The correct kind of alarm for each fault."""

SIZES = {
    "needle_force": (0.05, 0.1, 0.2),
    "friction": (0.3, 0.6, 1.2),
    "sensor_gain": (0.03, 0.06, 0.12),
    "sensor_offset": (-0.3, -0.6, -1.2),
    "encoder_slip": (0.01, 0.03, 0.1),
    "noise": (1.5, 2.0, 4.0),
    "bearing_bump": (0.3, 0.6, 1.2),
    "dropout": (0.3, 0.5, 0.8),
    "stuck": (1.0,),
}
"""Shares, N m, rad, factors; small, middle, large."""


@dataclass(frozen=True)
class Faulty:
    """A recording with a fault from `onset_s` after its beginning."""

    recording: MillRecording
    case: Case
    onset_s: float


def faulty(
    kind: str, size: float, seed: int, duration_s: float = 70.0, onset_s: float = 48.0, rate: float = 500.0
) -> Faulty:
    """Record a tufting machine at one speed with a fault of a kind and size; kind '' is healthy."""
    case = healthy("tufting", seed, run_up=False, duration_s=duration_s)
    if rate != 500.0:
        case = replace(case, encoder=replace(case.encoder, rate_hz=rate), torque=replace(case.torque, rate_hz=rate))
    return Faulty(with_fault(record(case), case, kind, size, onset_s), case, onset_s)


def with_fault(
    made: MillRecording, case: Case, kind: str, size: float, onset_s: float, until_s: float = math.inf
) -> MillRecording:
    """Add a fault to a recording of a case, from one time after its beginning until another [s]."""
    rng = np.random.default_rng([case.seed, 99])
    time = (made.torque_stamps_ns - made.torque_stamps_ns[0]) * 1e-9 + 0.0507
    on = (time > onset_s) & (time <= until_s)
    torque, stamps, angle = made.torque.copy(), made.torque_stamps_ns, made.angle.copy()
    theta, omega, alpha = made.plan.at(np.clip(time, 0.0, case.duration_s))
    true = torque_of(case, theta, omega, alpha)
    if kind == "needle_force":
        torque[on] += size * (true - _without_backing(case, theta, omega, alpha))[on]
    elif kind in ("friction", "sensor_offset"):
        torque[on] += size
    elif kind == "sensor_gain":
        torque[on] *= 1.0 + size
    elif kind == "noise":
        torque[on] += np.sqrt(size**2 - 1.0) * case.torque.noise_Nm * rng.standard_normal(np.count_nonzero(on))
    elif kind == "bearing_bump":
        away = np.remainder(theta - 4.2 + np.pi, 2.0 * np.pi) - np.pi
        torque[on] += (size * np.exp(-0.5 * (away / 0.12) ** 2))[on]
    elif kind == "stuck":
        torque[on] = torque[on][0]
    elif kind == "dropout":
        kept = ~on | (rng.random(time.size) > size)
        torque, stamps = torque[kept], stamps[kept]
    elif kind == "encoder_slip":
        late = (made.angle_stamps_ns - made.angle_stamps_ns[0]) * 1e-9 + 0.05
        late_on = (late > onset_s) & (late <= until_s)
        angle[late_on] = np.mod(angle[late_on] + size, 2.0 * np.pi)
    return MillRecording(made.angle_stamps_ns, angle, stamps, torque, made.plan)


def _without_backing(case: Case, theta: Floats, omega: Floats, alpha: Floats) -> Floats:
    bare = replace(case, backing=replace(case.backing, force_N=0.0))
    return torque_of(bare, theta, omega, alpha)
