"""The inertia of a real engine from the ripple of its speed under the gas torque: over all runs, by load.

Run from the root of the repository: python -m tests.benchmarks.engine_inertia CACHE_FOLDER MACHINE_FILE, with what
`engine_records` keeps in the folder and the machine file of docs/quantities.md.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

import textile_twin_core as ttc
from tests.benchmarks.engine_records import EngineRun
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.driven_speed import DrivenSpeed, driven_speed
from textile_twin_core.machine import Machine


def found_in(run: EngineRun, machine: Machine) -> DrivenSpeed:
    """Result of one run."""
    encoder = replace(machine.sensors.encoder, zero_rad=run.tdc_rad)
    stamps, gas = (np.rint((time + 1.0) * 1e9).astype(np.int64) for time in (run.time_s, run.gas_time_s))
    readings = Readings(stamps, run.angle_rad, gas, run.gas_torque_Nm)
    return driven_speed(readings, replace(machine, sensors=replace(machine.sensors, encoder=encoder)))


def main(folder: Path, machine: Machine) -> None:
    """Print a Markdown table."""
    by_load: dict[str, list[DrivenSpeed]] = defaultdict(list)
    for file in sorted(folder.glob("run_*.npz")):
        run = EngineRun.load_file(file)
        found_there = found_in(run, machine)
        for group in (run.load, "all"):
            by_load[group].append(found_there)
    print("| load | runs | inertia, kg m2 | spread | R2, mean and least | largest delay, ms |")
    print("|---|---|---|---|---|---|")
    for load, found in by_load.items():
        inertia, explained = (
            np.array([getattr(each, name) for each in found]) for name in ("inertia_kgm2", "explained")
        )
        late = 1e3 * max(abs(each.delay_s) for each in found)
        spread = np.std(inertia, ddof=1) / np.mean(inertia)
        share = f"{explained.mean():.3f}, {explained.min():.3f}"
        print(f"| {load} | {len(found)} | {inertia.mean():.5f} | {spread:.2%} | {share} | {late:.2f} |")


if __name__ == "__main__":
    chosen = ttc.load_machine(sys.argv[2])
    assert isinstance(chosen, Machine)
    main(Path(sys.argv[1]), chosen)
