"""Every mistake, and pairs of them, on many seeds of two machines: how often the right cause is named first.

Run from the root of the repository: python -m tests.benchmarks.verdicts FIRST_SEED LAST_SEED [MACHINE ..]
"""

from __future__ import annotations

import math
import sys

import numpy as np

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import MISTAKES, ONLY_TUFTING, Case, mistaken, record
from textile_twin_core.comparison import Assessment, Readings, assess
from textile_twin_core.inference.parameter import DELAY, ZERO

PAIRS = (
    "zero+sign",
    "newton_cm+sign",
    "direction+delay",
    "ratio+gain",
    "degrees+sign",
    "zero+friction",
    "direction+newton_cm",
    "delay+gain",
    "zero+delay",
    "drift+zero",
    "offset+sign",
)
WITHOUT_RUN_UP = ("", "zero", "delay", "half_turn", "sign", "direction", "zero+sign")


def judged(machine: str, names: tuple[str, ...], seed: int, run_up: bool) -> tuple[set[str], Assessment, Case]:
    """The causes that are right to name first, the assessment, and the truth."""
    case, right = mistaken(machine, names, seed, run_up=run_up)
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return right, assess(readings, configured_machine(case)), case


Errors = tuple[float, float]
"""Of zero [deg of the shaft] and delay [ms]."""


def errors(found: Assessment, case: Case) -> tuple[Errors, Errors]:
    """Errors of the verdict's values, and of calibrate's given the file exactly; nan where nothing was explained."""
    if found.found is None:
        return (math.nan, math.nan), (math.nan, math.nan)
    settled, known, hypothesis = found.found.settled, found.found.posterior, found.found.posterior.hypothesis
    true = case.encoder.zero_rad * case.encoder.direction * case.encoder.ratio

    def of(zero: float, delay: float) -> Errors:
        away = math.degrees(math.remainder(hypothesis.zero_rad + zero - true, 2.0 * math.pi))
        return away, (hypothesis.delay_s + delay - case.torque.delay_s) * 1e3

    exact = of(*(settled.given_file(name)[0] if name in settled.free else math.nan for name in (ZERO, DELAY)))
    return of(known.value(ZERO), known.value(DELAY)), exact


def main(first: int, last: int, asked: list[str]) -> None:
    """Print a row for each mistake, machine and kind of recording."""
    seeds = range(first, last)
    print("| machine | recording | mistake | named first | zero, deg, delay, ms: verdict / given the file | else |")
    print("|---|---|---|---|---|---|")
    for machine in ("tufting", "loom"):
        for run_up in (True, False):
            every = ("", *MISTAKES, *PAIRS) if run_up else WITHOUT_RUN_UP
            for mistake in every:
                names = tuple(name for name in mistake.split("+") if name)
                if machine == "loom" and any(name in ONLY_TUFTING for name in names):
                    continue
                if asked and machine not in asked:
                    continue
                wrong, missed = [], []
                for seed in seeds:
                    right, found, case = judged(machine, names, seed, run_up)
                    named = found.verdict[0].cause if found.verdict else None
                    if (named not in right) if right else named is not None:
                        wrong.append(f"{seed}: {named}")
                    missed.append(errors(found, case))
                largest_errors = ""
                if run_up and set(names) <= {"zero", "delay", "sign", "gain", "newton_cm", "friction"}:
                    largest = np.nanmax(np.abs(np.array(missed)), axis=0)
                    largest_errors = " / ".join(f"{zero:.3f}, {delay:.3f}" for zero, delay in largest.tolist())
                kind = "run-up" if run_up else "one speed"
                count = f"{len(seeds) - len(wrong)} of {len(seeds)}"
                print(
                    f"| {machine} | {kind} | {mistake or 'none'} | {count} | {largest_errors} | {'; '.join(wrong)} |",
                    flush=True,
                )


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
