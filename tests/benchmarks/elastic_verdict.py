"""The verdict `elastic_shaft`: on wide machines whose file has a rigid shaft, and on healthy rigid machines.

Run from the root of the repository: python -m tests.benchmarks.elastic_verdict [--varied | --rigid] [SEED]

Without an option: four diameters, three speeds, in phase and staggered, 16 linkages on 4 m. `--varied`: as many with
drawn diameter, length, 12 or 20 linkages, speed, drive, damping, encoder, noise, and a motor torque that wanders.
`--rigid`: healthy rigid machines of 2 kinds, run-ups and steady work, with drawn encoder, rate, noise and stamps.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Iterator

import numpy as np

import textile_twin_core as ttc
from tests.generators.configured_machine import configured_machine
from tests.generators.elastic_shaft import Record, WideMachine, simulate
from tests.generators.mill_recordings import Encoder, TorqueSensor, healthy, record
from textile_twin_core.comparison import Readings, assess
from textile_twin_core.comparison.elastic_hypothesis import elastic_hypothesis
from textile_twin_core.comparison.gather import gather, hypothesis_of
from textile_twin_core.comparison.readings import angle_unit
from textile_twin_core.machine import ShaftPlace

SECONDS = 5.0
RIGID = 40


def grid(seed: int) -> Iterator[tuple[WideMachine, float, str, Record]]:
    """Machine, speed, rows and record of each case of the grid."""
    for diameter_m in (0.04, 0.06, 0.08, 0.1):
        for rpm in (160.0, 300.0, 500.0):
            for rows, apart in (("in phase", 0.0), ("staggered", math.pi)):
                wide = WideMachine(diameter_m, phases_rad=tuple(apart * (k % 2) for k in range(16)))
                yield wide, rpm, rows, simulate(wide, rpm, SECONDS, settle_s=1.0, seed=seed)


def varied(seed: int) -> Iterator[tuple[WideMachine, float, str, Record]]:
    """The same of drawn cases."""
    rng = np.random.default_rng([seed, 4646])
    for k in range(24):
        stations, apart = (12, 20)[k % 2], (0.0, math.pi)[(k // 2) % 2]
        wide = WideMachine(
            round(rng.uniform(0.04, 0.1), 4),
            round(rng.uniform(3.0, 5.0), 2),
            stations,
            tuple(apart * (i % 2) for i in range(stations)),
            rng.uniform(0.005, 0.03),
            rng.uniform(0.5, 2.0),
            rng.uniform(20.0, 150.0),
        )
        rpm = round(rng.uniform(150.0, 550.0))
        bits, noise_Nm, wander_Nm = int(rng.integers(13, 17)), rng.uniform(0.3, 3.0), rng.uniform(0.0, 3.0)
        made = simulate(
            wide,
            rpm,
            rng.uniform(4.0, 8.0),
            settle_s=1.0,
            encoder_bits=bits,
            torque_noise_Nm=noise_Nm,
            motor_wander_Nm=wander_Nm,
            seed=seed + k,
        )
        yield wide, rpm, f"{stations}, {'staggered' if apart else 'in phase'}, {bits} bits, {noise_Nm:.1f} N m", made


def elastic(cases: Iterator[tuple[WideMachine, float, str, Record]]) -> None:
    """Print a Markdown table of the causes named."""
    print("| diameter, mm | length, m | rpm | rows | causes | first mode, Hz: true, named |\n|---|---|---|---|---|---|")
    right = count = 0
    for wide, rpm, rows, made in cases:
        places = tuple(map(ShaftPlace, wide.phases_rad or ()))
        machine = dataclasses.replace(ttc.machines.tufting(), linkages=places)
        readings = Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns, made.measured_Nm)
        verdict = assess(readings, machine).verdict
        causes = [cause.cause for cause in verdict]
        named = next((c.value["first_mode_Hz"] for c in verdict if isinstance(c.value, dict)), math.nan)
        true = wide.first_mode_rad_s / (2.0 * math.pi)
        place = f"{1e3 * wide.diameter_m:.0f} | {wide.length_m:.1f} | {rpm:.0f} | {rows}"
        print(f"| {place} | {', '.join(causes)} | {true:.1f}, {named:.1f} |", flush=True)
        right, count = right + (causes[:1] == ["elastic_shaft"]), count + 1
    print(f"\n`elastic_shaft` first in {right} of {count}")


def rigid(seed: int) -> None:
    """Print how many healthy rigid records are accused of an elastic shaft."""
    rng = np.random.default_rng([seed, 64])
    accused = []
    for k in range(RIGID):
        kind = ("tufting", "loom")[k % 2]
        rate_hz = float(rng.choice([200.0, 500.0, 1000.0]))
        case = healthy(
            kind,
            seed + k,
            encoder=Encoder(bits=int(rng.integers(11, 17)), rate_hz=rate_hz),
            torque=TorqueSensor(rate_hz=rate_hz, noise_Nm=0.08 * 10.0 ** rng.uniform(-1.0, 1.0)),
            duration_s=rng.uniform(8.0, 30.0),
            run_up=bool(rng.random() < 0.5),
            stamp_error_s=rng.uniform(0.0, 2e-4),
            loss=rng.uniform(0.0, 0.05),
        )
        made, machine = record(case), configured_machine(case)
        readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
        evidence = gather(readings, machine, angle_unit(readings.angle))
        if elastic_hypothesis(evidence, machine, hypothesis_of(machine)) is not None:
            accused.append(case)
    print(f"{len(accused)} of {RIGID} healthy rigid records accused of an elastic shaft")
    for case in accused:
        print(case)


def main() -> None:
    """Run one of the three."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seed", nargs="?", type=int, default=1)
    parser.add_argument("--varied", action="store_true")
    parser.add_argument("--rigid", action="store_true")
    options = parser.parse_args()
    if options.rigid:
        rigid(options.seed)
    else:
        elastic(varied(options.seed) if options.varied else grid(options.seed))


if __name__ == "__main__":
    main()
