"""Each kind of measuring chain, and pairs of them: whether it is named, what else, and errors in stated sigmas.

Run from the root of the repository: python -m tests.benchmarks.measuring_chains FIRST_SEED LAST_SEED [KIND[+KIND] ..]

Tufting machine and loom at 160 rpm, with and without a run-up; the needle's force, gain, delay, offset and friction
differ from the file, too. The truth is by equations of its own.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case, healthy, record
from tests.generators.shaft_law import Friction
from textile_twin_core.comparison import Readings, assess
from textile_twin_core.inference.parameter import DELAY, GAIN, ZERO, gain_factor
from textile_twin_core.inference.posterior import Posterior

_BEYOND = 3.0
_NAMES = {
    "healthy": set[str](),
    "run_out": {"encoder_eccentricity"},
    "run_out_twice": {"encoder_eccentricity"},
    "low_pass": {"torque_low_pass"},
    "butterworth": {"torque_low_pass"},
    "blocked_mean": {"torque_high_pass"},
    "hum": {"periodic_noise"},
    "steps": set[str](),
    "hold": set[str](),
}
"""Causes of each kind; steps of the readings and a drive that repeats its values are noise."""
_OTHERS = {"load_force", "torque_gain", "delay", "zero_or_delay", "torque_offset", "unmodelled_friction"}
"""Causes that are right beside it, since the file is off in these."""


def _case(machine: str, kinds: list[str], seed: int, run_up: bool) -> Case:
    rng = np.random.default_rng([seed, 99])
    case = healthy(machine, seed, run_up=run_up, duration_s=24.0)
    force = 1000.0 * (1.0 + rng.uniform(-0.25, 0.25))
    gain, late, offset = 1.0 + rng.uniform(-0.025, 0.025), rng.uniform(0.0005, 0.004), rng.uniform(-0.2, 0.2)
    torque = replace(case.torque, gain=gain, delay_s=late, offset_Nm=offset)
    waves = [(0.0, 0.0), (0.0, 0.0)]
    for kind in kinds:
        if kind in ("run_out", "run_out_twice"):
            twice = kind == "run_out_twice"
            size, phase = math.radians(rng.uniform(0.2, 0.4) if twice else rng.uniform(0.3, 0.7)), rng.uniform(0.0, 6.0)
            waves[twice] = size * math.sin(phase), size * math.cos(phase)
        elif kind == "low_pass":
            torque = replace(torque, low_pass_hz=1.0 / (2.0 * math.pi * rng.uniform(0.004, 0.02)), low_pass_order=1)
        elif kind == "butterworth":
            torque = replace(torque, low_pass_hz=rng.uniform(12.0, 40.0), low_pass_order=2)
        elif kind == "blocked_mean":
            torque = replace(torque, high_pass_hz=rng.uniform(0.2, 0.8))
        elif kind == "hum":
            peak = 20.0 if machine == "tufting" else 30.0
            torque = replace(torque, hum=(0.05 * peak, float(rng.choice([50.02, 59.97, 100.03]))))
        elif kind == "steps":
            torque = replace(torque, step_Nm=0.5)
        elif kind == "hold":
            torque = replace(torque, hold_hz=50.0)
    loom = machine == "loom"
    viscous = case.friction.viscous_Nms if loom else rng.uniform(0.01, 0.03)
    coulomb = (case.friction.coulomb_Nm if loom else 0.0) + rng.uniform(0.1, 0.3)
    encoder = replace(case.encoder, run_out_rad=tuple(waves) if any(map(any, waves)) else ())
    backing = replace(case.backing, force_N=force)
    return replace(case, torque=torque, encoder=encoder, backing=backing, friction=Friction(viscous, coulomb))


def _errors(found: Posterior, case: Case) -> Iterator[tuple[str, float]]:
    """Names of values, and their errors in sigmas: force, gain, delay and zero, at one speed their sum as an angle."""
    for known in found.measurement.parameters:
        if known.kind == "force" and "free" not in known.name and case.machine == "tufting":
            yield "force", (found.value(known.name) - case.backing.force_N) / found.sigma(known.name)
    gain = found.hypothesis.gain * gain_factor(found.value(GAIN))
    yield "gain", (gain - case.torque.gain) / (found.sigma(GAIN) * abs(gain))
    late = found.value(DELAY) + found.hypothesis.delay_s - case.torque.delay_s
    if found.measurement.record.one_speed:
        both = np.array([abs(found.measurement.record.speed_rad_s), 1.0])
        sigma = math.sqrt(both @ found.covariance([DELAY, ZERO]) @ both)
        yield "delay and zero", float(both @ [late, found.value(ZERO)]) / sigma
    else:
        yield "delay", late / found.sigma(DELAY)
        yield "zero", found.value(ZERO) / found.sigma(ZERO)


def main(first: int, last: int, asked: list[str]) -> None:
    """Print a line for each recording, then how many kinds were named, and how many values are right."""
    named = recordings = right = values = accused = 0
    for together in asked or list(_NAMES):
        kinds = together.split("+")
        wanted = set[str]().union(*(_NAMES[kind] for kind in kinds))
        for seed in range(first, last):
            for machine, run_up in (("tufting", False), ("tufting", True), ("loom", False), ("loom", True)):
                case = _case(machine, kinds, seed, run_up)
                made = record(case)
                readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
                found = assess(readings, configured_machine(case))
                causes = {cause.cause for cause in found.verdict}
                false = causes - wanted - _OTHERS
                errors = [] if found.found is None else list(_errors(found.found.posterior, case))
                wrong = [f"{name} {error:+.1f}" for name, error in errors if abs(error) > _BEYOND]
                recordings, named, accused = recordings + 1, named + (wanted <= causes), accused + bool(false)
                values, right = values + len(errors), right + len(errors) - len(wrong)
                said = "named" if wanted <= causes else "not named"
                print(
                    together,
                    machine,
                    seed,
                    "run-up" if run_up else "one speed",
                    said,
                    *sorted(false),
                    *wrong,
                    flush=True,
                )
    print(f"named in {named} of {recordings}, a false cause in {accused}; values within 3 sigma {right} of {values}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
