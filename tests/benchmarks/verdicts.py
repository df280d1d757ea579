"""Every mistake, and pairs of them, on many seeds of two machines: how often the right cause is named first.

Run from the root of the repository: python -m tests.benchmarks.verdicts FIRST_SEED LAST_SEED [MISTAKE+MISTAKE ..]
"""

from __future__ import annotations

import sys

from tests.generators.mill_recordings import MISTAKES, ONLY_TUFTING, mistaken, record
from tests.generators.told_machine import told_machine
from textile_twin_core.comparison import Assessment, Readings, assess


def judged(machine: str, names: tuple[str, ...], seed: int, run_up: bool) -> tuple[set[str], Assessment]:
    """The causes that are right to name first, and the assessment."""
    case, right = mistaken(machine, names, seed, run_up=run_up)
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return right, assess(readings, told_machine(case))


def main(first: int, last: int, asked: list[str]) -> None:
    """Print a line for each mistake, machine and kind of recording."""
    seeds = range(first, last)
    for machine in ("tufting", "loom"):
        for run_up in (True, False):
            for mistake in asked or ["", *MISTAKES]:
                names = tuple(name for name in mistake.split("+") if name)
                if machine == "loom" and any(name in ONLY_TUFTING for name in names):
                    continue
                wrong = []
                for seed in seeds:
                    right, found = judged(machine, names, seed, run_up)
                    named = found.verdict[0].cause if found.verdict else None
                    if (named not in right) if right else named is not None:
                        wrong.append(f"{seed}: {named}")
                kind = "run-up" if run_up else "one speed"
                count = len(seeds) - len(wrong)
                print(
                    f"{machine:8} {kind:9} {mistake or 'healthy':24} {count}/{len(seeds)} {'; '.join(wrong)}",
                    flush=True,
                )


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
