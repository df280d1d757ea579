"""Time of a fresh process to its first prediction, before and after compilation, part by part.

Run from the root of the repository: python -m tests.benchmarks.first_prediction [MACHINE ..]

Processor time, which other programs on the computer lengthen little; wall time beside it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

_FRESH = """
import sys, time
begun = time.process_time()
def told(what):
    global begun
    now = time.process_time()
    print(f"{what} {now - begun:.2f} s", end=", ")
    begun = now
import numpy as np
import textile_twin_core as ttc
from textile_twin_core.shaft import create_estimator
told("imports")
stamps, angles = np.arange(200) * 2_000_000, np.arange(200) * 0.03
create_estimator("causal").step(stamps, angles)
told("shaft")
session = ttc.compile(ttc.machines.create(sys.argv[1])).session()
for k in range(4):
    found = session.step_one(int(stamps[k]), float(angles[k]))
assert found
told("machine")
"""


def measure(machine: str, cache: str) -> str:
    """The parts' processor times in a fresh process, as text, and the whole."""
    begin, used = time.perf_counter(), os.times()
    process = subprocess.run(
        [sys.executable, "-c", _FRESH, machine],
        env=os.environ | {"TEXTILE_TWIN_CACHE_DIR": cache},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    ended = os.times()
    whole = ended.children_user + ended.children_system - used.children_user - used.children_system
    return f"{process.stdout}whole {whole:.2f} s (wall {time.perf_counter() - begin:.2f} s)"


def main() -> None:
    """Print two lines for each machine."""
    for machine in sys.argv[1:] or ["tufting", "needle_transfer"]:
        with tempfile.TemporaryDirectory() as cache:
            for what in ("cold", "warm"):
                print(f"{machine}, {what}: {measure(machine, cache)}", flush=True)


if __name__ == "__main__":
    main()
