"""Stiffness, damping and drive of an elastic shaft from its drive's end, over seeds of the noise, as a table.

Run from the root of the repository: python -m tests.benchmarks.shaft_identification [SEEDS] [MOTOR_WANDER_NM]
[FIRST_SEED]

Sixteen tufting linkages on 4 m of 60 mm at 300 rpm, 8 s, torque noise 1 N m, 14-bit encoder at 1 kHz; the machine file
is 8 % below or 10 % above the truth in all four numbers. With a motor torque that wanders every record has a motion of
its own; without, records differ by the noise of the torque alone.
"""

from __future__ import annotations

import dataclasses
import sys

import numpy as np

from tests.comparison.test_shaft_identification import misdeclared, truth
from tests.generators.elastic_shaft import WideMachine, simulate
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.shaft_identification import identify_shaft


def main(seeds: int, wander_Nm: float, first: int) -> None:
    """Print a Markdown table."""
    wide, rows = WideMachine(0.06), []
    made = simulate(wide, 300.0, 8.0, settle_s=1.0)
    for seed in range(first, first + seeds):
        if wander_Nm:
            made = simulate(wide, 300.0, 8.0, settle_s=1.0, seed=seed, motor_wander_Nm=wander_Nm)
        noise = np.random.default_rng(seed).normal(0.0, 1.0, made.time_s.size)
        made = dataclasses.replace(made, measured_Nm=made.torque_Nm + noise)
        readings = Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns, made.measured_Nm)
        found = identify_shaft(readings, misdeclared(wide, (0.92, 1.1)[seed % 2]))
        for name, value in truth(wide).items():
            each = found.parameters[name]
            low, high = each.interval95
            rows.append((name, each.value / value - 1.0, (each.value - value) / each.sigma, low <= value <= high))
        print(f"seed {seed}, the last is {first + seeds - 1}", file=sys.stderr, flush=True)
    print("| parameter | largest error | mean error | scatter of z | truth in interval |\n|---|--:|--:|--:|--:|")
    for name in truth(wide):
        errors, scores, inside = (
            np.array(each) for each in zip(*(row[1:] for row in rows if row[0] == name), strict=True)
        )
        largest, mean = 100.0 * np.abs(errors).max(), 100.0 * errors.mean()
        print(f"| `{name}` | {largest:.3f} % | {mean:+.3f} % | {scores.std():.2f} | {inside.sum()} of {inside.size} |")


if __name__ == "__main__":
    seeds, wander, first = sys.argv[1:] + ["20", "0", "0"][len(sys.argv) - 1 :]
    main(int(seeds), float(wander), int(first))
