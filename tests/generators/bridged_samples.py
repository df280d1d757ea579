"""Angle and torque of a tufting machine with stamps of a bridge: in bursts, on arrival.

The shaft's motion is a closed form with a run-up and a ripple, so that true times, angles and torques are known.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.recordings import BagWriter

TURN = 2.0 * np.pi
LAG_S, FRICTION_NM, FROM_S = 0.002, 0.3, 604_000.0
TORQUE = "balancing_torque_Nm"


@dataclass(frozen=True)
class Sampled:
    """Samples of angle (n,) and torque (m,), their true times [s] and their stamps [ns]."""

    angle_s: FloatArray
    angle: FloatArray
    torque_s: FloatArray
    torque_Nm: FloatArray
    angle_stamps: IntArray
    torque_stamps: IntArray


def shaft_angle(time_s: FloatArray, run_up_s: float = 0.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute angle, speed and acceleration at times (n,) [s]: 16.755 rad/s after a run-up from half that speed."""
    t = np.asarray(time_s)
    full = TURN * 160.0 / 60.0
    rise = max(run_up_s, 1e-9)
    part = np.clip(t / rise, 0.0, 1.0) if run_up_s else np.ones(t.size)
    # speed = full (0.5 + 0.5 s(part)), s = 3p^2 - 2p^3; its integral is rise (p^3 - p^4 / 2)
    speed = full * (0.5 + 0.5 * (3.0 * part**2 - 2.0 * part**3))
    travelled = full * (0.5 * t + 0.5 * (rise * (part**3 - 0.5 * part**4) + np.maximum(t - rise, 0.0)))
    slope = full * 0.5 * (6.0 * part - 6.0 * part**2) / rise
    if not run_up_s:
        travelled, slope = full * t, np.zeros(t.size)
    # theta = phi + sum a sin(k phi + b), a ripple of some per cent
    theta, first, second = travelled.copy(), np.ones(t.size), np.zeros(t.size)
    for k, a, b in ((1, 0.012, 0.7), (2, 0.004, 2.1)):
        theta += a * np.sin(k * travelled + b)
        first += a * k * np.cos(k * travelled + b)
        second -= a * k * k * np.sin(k * travelled + b)
    return theta, first * speed, second * speed**2 + first * slope


def sampled(
    rate_Hz: float,
    duration_s: float = 12.0,
    seed: int = 1,
    lost: float = 0.01,
    wrapped: bool = True,
    run_up_s: float = 0.0,
    jitter_s: float = 20e-6,
    drift: float = 3e-5,
) -> Sampled:
    """Sample with correct stamps from an even clock that is `drift` slow, the torque 0.25 ms after the angle."""
    rng = np.random.default_rng(seed)
    number = np.arange(int(duration_s * rate_Hz))
    even = number * (1.0 + drift) / rate_Hz + rng.uniform(0.0, 1.0 / rate_Hz)
    angle_s = even + jitter_s * rng.standard_normal(even.size)
    torque_s = even + 2.5e-4 + jitter_s * rng.standard_normal(even.size)
    angle_s, torque_s = (each[rng.random(each.size) >= lost] for each in (angle_s, torque_s))
    step = TURN / 2**16
    angle = np.round(shaft_angle(angle_s, run_up_s)[0] / step) * step
    theta, omega, alpha = shaft_angle(torque_s - LAG_S, run_up_s)
    twin = ttc.compile(ttc.machines.tufting(), outputs=[TORQUE])
    torque = twin.evaluate(theta, omega, alpha)[TORQUE] + FRICTION_NM * np.sign(omega)
    torque = torque + 0.05 * rng.standard_normal(torque.size)
    angle = np.mod(angle, TURN) if wrapped else angle
    stamps = [np.round((FROM_S + each) * 1e9).astype(np.int64) for each in (angle_s, torque_s)]
    return Sampled(angle_s, angle, torque_s, torque, *stamps)


def bridged(
    samples: Sampled,
    period_s: float,
    inside_s: float,
    which: str = "both",
    seed: int = 2,
    late_s: float = 0.0,
) -> Sampled:
    """Replace the stamps by those of a bridge: bursts every `period_s`, with messages `inside_s` apart.

    Args:
        which: "angle", "torque" or "both", the signals that pass the bridge, in the order of sampling.
        late_s: standard deviation of the instants of sending [s], one-sided.
    """
    rng = np.random.default_rng(seed)
    times = [samples.angle_s, samples.torque_s]
    through = [which in ("angle", "both"), which in ("torque", "both")]
    of = np.concatenate([np.full(times[k].size, k) for k in (0, 1) if through[k]])
    taken = np.concatenate([times[k] for k in (0, 1) if through[k]])
    order = np.argsort(taken, kind="stable")
    burst = np.ceil((taken[order] + FROM_S) / period_s).astype(np.int64)
    first = np.searchsorted(burst, burst)
    late = np.abs(late_s * rng.standard_normal(int(burst[-1] - burst[0]) + 1))[burst - burst[0]]
    stamp = burst * period_s + late + (np.arange(burst.size) - first) * inside_s
    stamp = np.round(np.maximum.accumulate(stamp) * 1e9).astype(np.int64)
    stamps = [samples.angle_stamps, samples.torque_stamps]
    for k in (0, 1):
        if through[k]:
            stamps[k] = stamp[of[order] == k]
    return Sampled(samples.angle_s, samples.angle, samples.torque_s, samples.torque_Nm, *stamps)


def write_samples(path: Path, samples: Sampled) -> Path:
    """Write a recording of the samples to `path`, and return the path."""
    with BagWriter(path) as bag:
        bag.write_joint_states("main_shaft/angle", samples.angle_stamps, ["main_shaft"], samples.angle)
        bag.write_wrenches("balancing_torque/measured", samples.torque_stamps, samples.torque_Nm)
    return path
