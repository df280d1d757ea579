"""Faults of every kind and size on many seeds: how often they are found, named rightly, and after how many turns.

Run from the root of the repository: python -m tests.benchmarks.faults FIRST_SEED LAST_SEED, or with `hours` before the
seeds: false alarms in recordings of one hour each of a healthy machine.
"""

from __future__ import annotations

import statistics
import sys
from collections import Counter

import numpy as np

from tests.generators.faults import EXPECTED, SIZES, faulty
from tests.generators.mill_recordings import SPEED
from tests.generators.told_machine import told_machine
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.monitor import monitor_recording

_TURN_NS = 2.0 * np.pi / SPEED["tufting"] * 1e9


def hours(first: int, last: int) -> None:
    """Print the alarms of an hour of a healthy machine for each seed."""
    false = 0
    for seed in range(first, last):
        made = faulty("", 0.0, seed, duration_s=3600.0)
        r = made.recording
        readings = Readings(r.angle_stamps_ns, r.angle, r.torque_stamps_ns, r.torque)
        watched = monitor_recording(readings, told_machine(made.case))
        false += len(watched.alarms)
        turns = len(watched.columns["turn"])
        print(f"seed {seed}: {turns} turns, alarms: {[alarm.text for alarm in watched.alarms]}", flush=True)
    print(f"{false} false alarms in {last - first} h")


def main(first: int, last: int) -> None:
    """Print a row of a Markdown table for each kind and size."""
    print("| fault | size | found | named rightly | turns until the alarm, median | named otherwise |")
    print("|---|---|---|---|---|---|")
    for kind in ("", *SIZES):
        for size in SIZES.get(kind, (0.0,)):
            found, turns, others = 0, [], Counter[str]()
            for seed in range(first, last):
                made = faulty(kind, size, seed)
                r = made.recording
                readings = Readings(r.angle_stamps_ns, r.angle, r.torque_stamps_ns, r.torque)
                alarms = monitor_recording(readings, told_machine(made.case)).alarms
                if not alarms:
                    continue
                found += 1
                if alarms[0].kind == EXPECTED.get(kind):
                    onset = r.torque_stamps_ns[0] + made.onset_s * 1e9
                    turns.append(float(alarms[0].stamp_ns - onset) / _TURN_NS)
                else:
                    others[alarms[0].kind] += 1
            late = f"{statistics.median(turns):.0f}" if turns else ""
            named = ", ".join(f"{name} {count}" for name, count in others.items())
            count = last - first
            print(
                f"| {kind or 'healthy'} | {size:g} | {found}/{count} | {len(turns)}/{count} | {late} | {named} |",
                flush=True,
            )


if __name__ == "__main__":
    if sys.argv[1] == "hours":
        hours(int(sys.argv[2]), int(sys.argv[3]))
    else:
        main(int(sys.argv[1]), int(sys.argv[2]))
