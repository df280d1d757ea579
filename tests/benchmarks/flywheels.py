"""Right files of machines with a flywheel that hides the ripple of the speed, and a wrong force or delay beside it.

Run from the root of the repository: python -m tests.benchmarks.flywheels FIRST_SEED LAST_SEED [force|delay]

Inertia 3 to 100 times the linkage's, stiff and soft drives, 12 to 17 bits, 500 Hz to 4 kHz. The truth is by equations
of its own.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import healthy
from tests.generators.shaft_law import Backing
from tests.generators.speed_controlled_motion import speed_controlled_motion
from textile_twin_core.comparison import Readings, assess
from textile_twin_core.dynamics import Body

TURN = 2.0 * math.pi
_OWN_KGM2 = {"tufting": 0.006, "loom": 0.012}
"""Inertia of the linkage about the shaft."""
_NOISE_NM = 0.08
_RPM = {"tufting": (160.0, 500.0), "loom": (100.0, 250.0)}


def main(first: int, last: int, mistake: str) -> None:
    """Print a line for each recording, then in how many something false was named, or the mistake was."""
    false = named = 0
    for seed in range(first, last):
        rng = np.random.default_rng([seed, 2718])
        name = "loom" if mistake != "force" and rng.random() < 0.5 else "tufting"
        low, high = (float(np.log(rpm * TURN / 60.0)) for rpm in _RPM[name])
        speed = float(np.exp(rng.uniform(low, high)))
        inertia = _OWN_KGM2[name] * float(np.exp(rng.uniform(np.log(3.0), np.log(100.0))))
        settling_s = float(rng.uniform(0.15, 0.4) if rng.random() < 0.5 else rng.uniform(0.02, 0.05))
        bits, rate_hz = int(rng.integers(12, 18)), float(rng.choice([500.0, 1000.0, 2000.0, 4000.0]))
        case = replace(healthy(name, seed, duration_s=16.0), added_inertia_kgm2=inertia)
        machine = configured_machine(case)
        machine = replace(machine, bodies=(*machine.bodies, Body("main_shaft", 1.0, inertia)))
        if mistake == "force":
            case = replace(case, backing=Backing(force_N=1150.0))
        fine, angle, _, torque = speed_controlled_motion(case, inertia / settling_s, (0.6 * speed, speed))
        late_s = 0.003 if mistake == "delay" else 0.0
        time, step = np.arange(0.9, case.duration_s - 0.1, 1.0 / rate_hz), TURN / 2**bits
        read = np.rint(np.interp(time, fine, angle) / step) * step
        true = np.interp(time - late_s, fine, torque)
        stamps = np.rint(time * 1e9).astype(np.int64)
        shown = true + _NOISE_NM * rng.standard_normal(time.size)
        found = assess(Readings(stamps, read, stamps, shown), machine)
        causes = [cause.cause for cause in found.verdict]
        right = {"force": "load_force", "delay": "delay"}.get(mistake, "")
        false += bool(set(causes) - {right, "unmodelled_friction"})
        named += right in causes
        drawn = f"{60.0 * speed / TURN:.0f} rpm, {inertia:.3f} kg m2, {settling_s:.3f} s, {bits} bits, {rate_hz:.0f} Hz"
        print(name, seed, drawn, *(f"{cause.cause} {cause.value}" for cause in found.verdict), flush=True)
    print(f"a false cause in {false} of {last - first}" + (f", {mistake} named in {named}" if mistake else ""))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else "")
