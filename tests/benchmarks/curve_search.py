"""Our search for a coupler curve beside pylinkage's own optimiser, on a task that both can do; printed, not asserted.

    python -m tests.benchmarks.curve_search

The task: 24 points on the coupler curve of a known crank-rocker. pylinkage's particle swarm gets the fixed pivots
and the ranges of the five lengths and angles; our search gets the points alone. Processor time, one process.
"""

from __future__ import annotations

import math
import time

import numpy as np
import pylinkage

from textile_twin_core.synthesis import FourBarDesign, fit_curve
from textile_twin_core.synthesis.turn import over_turn

KNOWN = FourBarDesign((0.0, 0.0), (0.3, 0.05), 0.08, 0.25, 0.22, (0.15, 0.1), "left")
STEPS = 120


def main() -> None:
    """Run both and print a row of each."""
    targets = KNOWN.points(np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False) + 0.01)
    begin = time.process_time()
    ours = fit_curve([(z.real, z.imag) for z in targets], seed=0)
    _say("textile-twin, pivots unknown", ours.designs, time.process_time() - begin, ours.rms_m)
    begin = time.process_time()
    calls, rms = _pylinkage(targets)
    _say("pylinkage, pivots given", calls, time.process_time() - begin, rms)


def _say(who: str, designs: int, seconds: float, rms_m: float) -> None:
    rate = designs / seconds
    print(f"{who:30}{designs:8} designs {seconds:6.1f} s {rate:9.0f} designs/s  RMS distance {1e3 * rms_m:.3f} mm")


def _pylinkage(targets: np.ndarray) -> tuple[int, float]:
    ground, pivot = pylinkage.Ground(0.0, 0.0), pylinkage.Ground(0.3, 0.05)
    crank = pylinkage.Crank(ground, 0.08, 2.0 * math.pi / STEPS, 0.0)
    stand = KNOWN.machine().model
    x, y = (float(v[0]) for v in over_turn([stand.output("point_B_x_m"), stand.output("point_B_y_m")], np.zeros(1)))
    joint = pylinkage.RRRDyad(crank, pivot, 0.25, 0.22, x=x, y=y)
    point = pylinkage.FixedDyad(crank, joint, abs(complex(*KNOWN.point_m)), math.atan2(0.1, 0.15))
    linkage = pylinkage.Linkage([ground, pivot, crank, joint, point], [crank, joint, point])
    calls = 0

    @pylinkage.kinematic_minimization
    def distance(loci: object, **_: object) -> float:
        nonlocal calls
        calls += 1
        path = np.array([step[-1] for step in loci], dtype=np.float64)  # type: ignore[attr-defined]
        curve = path[:, 0] + 1j * path[:, 1]
        return float(np.sqrt(np.mean(np.abs(curve[None, :] - targets[:, None]).min(axis=1) ** 2)))

    low, high = [0.04, 0.15, 0.15, 0.05, 0.2], [0.12, 0.4, 0.4, 0.3, 1.2]
    found = pylinkage.particle_swarm_optimization(
        distance, linkage, bounds=(low, high), n_particles=60, iterations=60, order_relation=min, verbose=False
    )
    return calls, float(min(found.scores["score"]))


if __name__ == "__main__":
    main()
