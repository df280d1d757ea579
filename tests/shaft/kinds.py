"""Kinds of shaft recordings with known truth, by seed: what mills and test benches deliver, without one machine's form.

`make(kind, seed)` gives a record; a name that ends in `+1%` or `+3%` is that kind with this share of readings half a
radian off. The parameters of a kind (speed, noise, disturbance, ripple, start) vary with the seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.shaft.disturbances import pulses, steps, wander
from tests.shaft.shaft_motion import Law, ShaftMotion

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Record:
    """Readings and the truth at their stamps.

    Attributes:
        kind, seed: what it was made from.
        time_s: (n,) reported stamps.
        angle_rad: (n,) readings, unwrapped.
        wrapped: whether the estimator gets them wrapped.
        theta, omega, alpha: (n,) the truth at the stamps.
    """

    kind: str
    seed: int
    time_s: np.ndarray
    angle_rad: np.ndarray
    wrapped: bool
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray

    @property
    def fed_rad(self) -> np.ndarray:
        """The readings as the estimator gets them."""
        return np.mod(self.angle_rad, TURN) if self.wrapped else self.angle_rad


def make(kind: str, seed: int) -> Record:
    """The record of that kind and seed.

    Raises:
        KeyError: no such kind.
    """
    base, _, share = kind.partition("+")
    record = _begun_late(KINDS[base](np.random.default_rng([seed, len(base)]), seed), np.random.default_rng([seed, 78]))
    if share:
        rng = np.random.default_rng([seed, 77])
        wrong = rng.random(record.time_s.size) < float(share.removesuffix("%")) / 100.0
        wrong[:3] = False
        leap = rng.choice((-0.5, 0.5), record.time_s.size)
        record = replace(record, angle_rad=record.angle_rad + np.where(wrong, leap, 0.0))
    return replace(record, kind=kind)


def _sampled(
    rng: np.random.Generator, seed: int, motion: ShaftMotion, rate_hz: float, jitter_s: float, step_rad: float
) -> Record:
    """Read at a steady rate: the stamp differs from the time of the reading by a normal error; a step of the angle."""
    stamps = np.arange(1, int((motion.duration_s - 0.01) * rate_hz)) / rate_hz
    read, _, _ = motion.at(stamps + np.clip(rng.normal(0.0, jitter_s, stamps.size), -0.4 / rate_hz, 0.4 / rate_hz))
    read = np.round(read / step_rad) * step_rad
    return Record("", seed, stamps, read, bool(seed % 2), *motion.at(stamps))


def _begun_late(record: Record, rng: np.random.Generator) -> Record:
    """Drop up to a quarter of the beginning: recording starts at any moment of the motion."""
    cut = slice(int(rng.uniform(0.0, 0.25) * record.time_s.size), None)
    names = ("time_s", "angle_rad", "theta", "omega", "alpha")
    return replace(record, **{name: getattr(record, name)[cut] for name in names})


def _start(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.0, TURN))


def _waves(rng: np.random.Generator, orders: tuple[float, ...], size: float) -> np.ndarray:
    return np.array([(k, size / max(k, 1.0) * rng.uniform(0.3, 1.0), rng.uniform(0.0, TURN)) for k in orders])


def slow(rng: np.random.Generator, seed: int) -> Record:
    """50 to 180 rpm at 50 Hz, stamps wrong by 0.4 ms, 12 to 14 bits, ripple of two orders, moderate disturbance."""
    speed, dt, n = rng.uniform(50.0, 180.0) * TURN / 60.0, 5e-4, 40_001
    times = np.exp(rng.uniform(np.log(0.1), np.log(2.0), 2))
    push = sum((wander(rng, n, dt, t, rng.uniform(0.005, 0.03) * speed / t) for t in times), np.zeros(n))
    waves = _waves(rng, (1.0, 2.0), rng.uniform(0.0, 0.02))
    motion = ShaftMotion.solve(Law(dt, push, np.full(n, speed), rng.uniform(0.5, 3.0), waves, np.ones(n)), _start(rng))
    return _sampled(rng, seed, motion, 50.0, 4e-4, TURN / 2 ** rng.integers(12, 15))


def scales(rng: np.random.Generator, seed: int) -> Record:
    """12 bits at 500 Hz, disturbances of every time scale from 3 ms to 3 s, ripple in half the seeds."""
    speed, dt, n = rng.uniform(80.0, 300.0) * TURN / 60.0, 1e-4, 60_001
    push = np.zeros(n)
    for time in (0.003, 0.03, 0.3, 3.0):
        push += wander(rng, n, dt, time, 0.006 * 10.0 ** rng.uniform(-2.0, 0.0) * speed / time)
    push += steps(rng, n, dt, rng.uniform(0.3, 3.0), rng.uniform(0.01, 0.1) * speed)
    push += pulses(rng, n, dt, rng.uniform(0.5, 4.0), rng.uniform(0.001, 0.02) * speed)
    waves = _waves(rng, (1.0, 2.0, 3.0), rng.choice((0.0, 0.01)))
    motion = ShaftMotion.solve(Law(dt, push, np.full(n, speed), rng.uniform(1.0, 5.0), waves, np.ones(n)), _start(rng))
    return _sampled(rng, seed, motion, 500.0, 20e-6, TURN / 4096)


def coarse(rng: np.random.Generator, seed: int) -> Record:
    """6 to 8 samples a turn in steps of 1 degree; starts, runs at several speeds, stops."""
    rate, dt, n = 100.0, 2e-4, 75_001
    top = TURN * rate / rng.uniform(6.0, 8.0)
    time, level, clock, speed = [0.0], [0.0], 0.0, 0.0
    while clock < n * dt:
        clock += rng.uniform(0.5, 1.5)
        time.append(clock)
        level.append(speed)
        goal = 0.0 if speed > 0.0 and rng.random() < 0.4 else top * rng.choice((0.6, 0.8, 1.0))
        clock += abs(goal - speed) / top * rng.uniform(0.3, 0.8) + 0.02
        time.append(clock)
        level.append(goal)
        speed = goal
    smooth = np.hanning(int(0.06 / dt))
    target = np.convolve(np.interp(np.arange(n + smooth.size - 1) * dt, time, level), smooth / smooth.sum(), "valid")
    push = wander(rng, n, dt, 0.1, rng.uniform(0.0, 0.2) * top) * target / top
    waves = _waves(rng, (1.0, 2.0), rng.uniform(0.0, 0.03))
    motion = ShaftMotion.solve(Law(dt, push, target, 20.0, waves, np.ones(n)), _start(rng))
    return _sampled(rng, seed, motion, rate, 1e-4, TURN / 360)


def teeth(rng: np.random.Generator, seed: int) -> Record:
    """57 of 60 teeth at 2800 to 3300 rpm, edge times wrong by 1 to 3 us, half orders that vary from cycle to cycle."""
    return _teeth(rng, seed, 0.0)


def pitch(rng: np.random.Generator, seed: int) -> Record:
    """Toothed wheel as `teeth`, with pitch errors of 0.08 degrees RMS."""
    return _teeth(rng, seed, np.deg2rad(0.08))


def _teeth(rng: np.random.Generator, seed: int, pitch_rad: float) -> Record:
    speed, dt, n = rng.uniform(2800.0, 3300.0) * TURN / 60.0, 2e-5, 35_001
    cycle = 2.0 * TURN / speed
    depth = 1.0 + wander(rng, n, dt, 4.0 * cycle, rng.uniform(0.02, 0.06))
    push = wander(rng, n, dt, 0.05, rng.uniform(0.0, 0.2) * speed) + wander(rng, n, dt, 0.004, 0.3 * speed)
    sizes = 0.02 * 2.0 ** -np.arange(0.0, 6.0, 0.5) * rng.uniform(0.3, 1.0, 12)
    waves = np.stack([np.arange(0.5, 6.1, 0.5), sizes, rng.uniform(0.0, TURN, 12)], axis=1)
    motion = ShaftMotion.solve(Law(dt, push, np.full(n, speed), 5.0, waves, depth), _start(rng))
    errors = rng.normal(0.0, pitch_rad, 57) if pitch_rad else np.zeros(57)
    first = int(motion.theta[0] / TURN * 60.0) + 2
    place = np.arange(first, int(motion.theta[-1] / TURN * 60.0) - 2)
    place = place[place % 60 < 57]
    nominal = place * TURN / 60.0
    edges = motion.passes(nominal + (errors - errors.mean())[place % 60])
    stamps = edges + rng.normal(0.0, rng.uniform(1e-6, 3e-6), edges.size)
    return Record("", seed, stamps, nominal, False, *motion.at(stamps))


def standstill(rng: np.random.Generator, seed: int) -> Record:
    """12 bits at 500 Hz: standstill with a flicker of one step, a short run at 30 to 200 rpm, standstill again."""
    dt, n = 2e-4, 35_001
    speed = rng.uniform(30.0, 200.0) * TURN / 60.0
    target = np.interp(np.arange(n) * dt, [3.0, 3.4, 4.6, 5.0], [0.0, speed, speed, 0.0])
    motion = ShaftMotion.solve(Law(dt, np.zeros(n), target, 20.0, _waves(rng, (1.0,), 0.01), np.ones(n)), _start(rng))
    record = _sampled(rng, seed, motion, 500.0, 20e-6, TURN / 4096)
    flicker = rng.random(record.time_s.size) < rng.uniform(0.0, 0.3)
    return replace(record, angle_rad=record.angle_rad + np.where(flicker, TURN / 4096, 0.0))


def runs(rng: np.random.Generator, seed: int) -> Record:
    """Runs, run-downs and standstills of up to 6 s, reversals; 100 Hz to 1 kHz, 10 bits or more or not rounded."""
    rate, dt, n = rng.choice((100.0, 250.0, 500.0, 1000.0)), 2e-4, 150_001
    top, level, clock, time = rng.uniform(3.0, 40.0), 0.0, rng.uniform(0.0, 3.0), np.arange(n) * dt
    target = np.zeros(n)
    while clock < time[-1]:
        goal = top * (rng.choice((0.0, 0.0, 1.0, 0.6, 0.8, -0.5)) if target.any() else 1.0)
        length = rng.uniform(0.3, 6.0)
        x = np.clip((time - clock) / length, 0.0, 1.0)
        target += (goal - level) * (x - np.sin(TURN * x) / TURN)
        level, clock = goal, clock + length + rng.uniform(0.2, 6.0)
    waves = _waves(rng, (1.0, 2.0), rng.choice((0.0, 0.03)))
    motion = ShaftMotion.solve(Law(dt, np.zeros(n), target, 20.0, waves, np.ones(n)), _start(rng))
    step = rng.choice((TURN / 2**10, TURN / 2**12, TURN / 2**13, TURN / 2**14, TURN / 2**16, 1e-12))
    return _sampled(rng, seed, motion, rate, rng.choice((2e-6, 2e-5, 1e-4)), step)


KINDS: dict[str, Callable[[np.random.Generator, int], Record]] = {
    kind.__name__: kind for kind in (slow, scales, coarse, teeth, pitch, standstill, runs)
}
OUTLIERS = ("", "+1%", "+3%")
