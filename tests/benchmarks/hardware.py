"""Error of the live torque of the tufting machine by encoder, samples a turn, and stamps.

The shaft turns at 160 rpm with a ripple of 2 % once, 0.5 % twice and 0.2 % four times a turn, in closed form. The
encoder rounds, stamps are off at random. The table has the RMS error of the `causal` torque over its peak, in
percent, from the third second on, away from the discontinuities at the needle's entry and exit.
"""

from __future__ import annotations

import sys

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray

RPM, SECONDS = 160.0, 20.0
RIPPLE = ((1, 0.02, 0.3), (2, 0.005, 1.1), (4, 0.002, 2.0))
"""Order, relative amplitude of the speed, phase [rad]."""
BITS = (8, 9, 10, 12, 14, 16)
COLUMNS = ((100, 0.0), (100, 1e-4), (100, 1e-3), (16, 1e-4))
"""Samples a turn, and standard deviation of the stamps [s]."""
GUARD_RAD = 0.02
TORQUE = "balancing_torque_Nm"


def motion(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angle, speed and acceleration of the shaft in closed form."""
    rate = RPM * np.pi / 30.0
    theta, omega, alpha = rate * time, np.full(time.size, rate), np.zeros(time.size)
    for order, size, phase in RIPPLE:
        turning = order * rate * time + phase
        theta = theta + size / order * np.sin(turning)
        omega = omega + size * rate * np.cos(turning)
        alpha = alpha - size * order * rate**2 * np.sin(turning)
    return theta, omega, alpha


def error_percent(bits: int, per_turn: int, jitter_s: float, seed: int = 0) -> float:
    """RMS error of the live torque over its peak [%]."""
    rng = np.random.default_rng(seed)
    rate_hz = per_turn * RPM / 60.0 * 1.0137  # no whole number of readings a turn
    time = np.arange(int(SECONDS * rate_hz)) / rate_hz
    theta, omega, alpha = motion(time)
    step = 2.0 * np.pi / 2**bits
    stamps = np.sort(time + rng.normal(0.0, jitter_s, time.size) if jitter_s else time)
    twin = ttc.compile(ttc.machines.tufting(), [TORQUE])
    true = twin.evaluate(theta, omega, alpha)[TORQUE]
    found = twin.session(shaft="causal").step(np.round(stamps * 1e9).astype(np.int64), np.floor(theta / step) * step)
    events = [event.angle_rad for event in ttc.machines.tufting().events() if event.name.endswith("_backing")]
    late = time[found.index] > 3.0
    angle = theta[found.index]
    for event in events:
        late &= np.abs(np.remainder(angle - event + np.pi, 2.0 * np.pi) - np.pi) > GUARD_RAD
    missed = (found[TORQUE] - true[found.index])[late]
    return 100.0 * float(np.sqrt(np.mean(missed**2)) / np.abs(true).max())


def main() -> int:
    """Print the table."""
    heads = (f"{per_turn} samples a turn, stamps +- {1e3 * jitter_s:g} ms" for per_turn, jitter_s in COLUMNS)
    print("| encoder | " + " | ".join(heads) + " |")
    print("|---|" + "--:|" * len(COLUMNS))
    for bits in BITS:
        cells = (error_percent(bits, per_turn, jitter_s) for per_turn, jitter_s in COLUMNS)
        print(f"| {bits} bits | " + " | ".join(f"{each:.2g} %" for each in cells) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
