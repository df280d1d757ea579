"""Faults of every kind and size on many seeds: how often they are found, named rightly, and after how many turns.

Run from the root of the repository: python -m tests.benchmarks.faults FIRST_SEED LAST_SEED, or with `hours` before the
seeds: false alarms in recordings of one hour each of a healthy machine; with `pairs`: a fault beside one that stands;
with `standing`: what is said in ten minutes after the alarm of a fault that stays as it is.
"""

from __future__ import annotations

import statistics
import sys
from collections import Counter
from itertools import permutations, product

import numpy as np

from tests.generators.configured_machine import configured_machine
from tests.generators.faults import EXPECTED, SIZES, faulty, with_fault
from tests.generators.mill_recordings import SPEED, Case, MillRecording
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
        watched = monitor_recording(readings, configured_machine(made.case))
        false += len(watched.alarms)
        turns = len(watched.columns["turn"])
        print(f"seed {seed}: {turns} turns, alarms: {[alarm.text for alarm in watched.alarms]}", flush=True)
    print(f"{false} false alarms in {last - first} h")


def pairs(first: int, last: int) -> None:
    """Print the pairs of a middle and a large fault, 30 s apart, that are not reported one after the other."""
    right, seen = 0, 0
    # Behind a value that stands still nothing shows.
    for seed, (one, two) in product(range(first, last), permutations(SIZES, 2)):
        if one == "stuck":
            continue
        made = faulty(one, SIZES[one][len(SIZES[one]) // 2], seed, duration_s=108.0)
        told = _kinds(with_fault(made.recording, made.case, two, SIZES[two][-1], 78.0), made.case)
        seen += 1
        if told == [EXPECTED[one], EXPECTED[two]]:
            right += 1
        else:
            print(f"seed {seed}: {one}, then {two}: {told}", flush=True)
    print(f"{right} of {seen} pairs told rightly")


def standing(first: int, last: int) -> None:
    """Print repeated alarms within ten minutes of a standing fault."""
    more, seen = 0, 0
    for seed, kind in product(range(first, last), SIZES):
        for size in SIZES[kind]:
            made = faulty(kind, size, seed, duration_s=648.0)
            told, seen = _kinds(made.recording, made.case), seen + 1
            if len(told) > 1:
                more += 1
                print(f"seed {seed}: {kind} {size:g}: {told}", flush=True)
    print(f"{more} of {seen} faults told with another")


def _kinds(r: MillRecording, case: Case) -> list[str]:
    readings = Readings(r.angle_stamps_ns, r.angle, r.torque_stamps_ns, r.torque)
    return [alarm.kind for alarm in monitor_recording(readings, configured_machine(case)).alarms]


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
                alarms = monitor_recording(readings, configured_machine(made.case)).alarms
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
    modes = {each.__name__: each for each in (hours, pairs, standing)}
    if sys.argv[1] in modes:
        modes[sys.argv[1]](int(sys.argv[2]), int(sys.argv[3]))
    else:
        main(int(sys.argv[1]), int(sys.argv[2]))
