"""The verdict on wide machines whose file has a rigid shaft: four diameters, three speeds, in phase and staggered.

Run from the root of the repository: python -m tests.benchmarks.elastic_verdict [SEED]
"""

from __future__ import annotations

import dataclasses
import math
import sys

import textile_twin_core as ttc
from tests.generators.elastic_shaft import WideMachine, simulate
from textile_twin_core.comparison import Readings, assess
from textile_twin_core.machine import ShaftPlace

SECONDS = 5.0


def main(seed: int) -> None:
    """Print a Markdown table."""
    print("| diameter, mm | rpm | rows | causes named | first mode, Hz: true, named |\n|---|---|---|---|---|")
    for diameter_m in (0.04, 0.06, 0.08, 0.1):
        for rpm in (160.0, 300.0, 500.0):
            for rows, apart in (("in phase", 0.0), ("staggered", math.pi)):
                phases = tuple(apart * (k % 2) for k in range(16))
                wide = WideMachine(diameter_m, phases_rad=phases)
                made = simulate(wide, rpm, SECONDS, settle_s=1.0, seed=seed)
                machine = dataclasses.replace(ttc.machines.tufting(), linkages=tuple(map(ShaftPlace, phases)))
                verdict = assess(
                    Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns, made.measured_Nm), machine
                ).verdict
                causes = ", ".join(cause.cause for cause in verdict)
                named = next((c.value["first_mode_Hz"] for c in verdict if isinstance(c.value, dict)), math.nan)
                true = wide.first_mode_rad_s / (2.0 * math.pi)
                print(
                    f"| {1e3 * diameter_m:.0f} | {rpm:.0f} | {rows} | {causes} | {true:.1f}, {named:.1f} |", flush=True
                )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
