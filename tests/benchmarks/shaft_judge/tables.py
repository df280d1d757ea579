"""The judge's tables, printed line by line as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from tests.benchmarks.engine_records import EngineRun, calibrated, paths, pitch_errors, read_run
from tests.benchmarks.shaft_judge.engine_score import KIND, leaves, predict
from tests.benchmarks.shaft_judge.kinds_score import HEADER, SKIP, row, score
from tests.benchmarks.shaft_judge.views import VIEWS, Factory, track, tuned
from tests.shaft.kinds import KINDS, OUTLIERS


def kinds_table(
    factory: Factory,
    kinds: Iterable[str] = tuple(KINDS),
    seeds: Sequence[int] = range(10),
    views: Iterable[str] = VIEWS,
    outliers: Iterable[str] = OUTLIERS,
) -> None:
    """RMS of omega and alpha relative to the tuned textbook, shares inside, divergences; medians over seeds."""
    print(
        f"Known truth, {len(seeds)} seeds a kind, the first {SKIP:.0%} of each record left out. omega, alpha: RMS error\n"
        "relative to a constant-acceleration Kalman filter (causal) or RTS smoother (lag, smooth) whose noises were tuned\n"
        "by likelihood on that very record, without its outliers; median and worst over seeds."
    )
    print(HEADER)
    for kind in kinds:
        for share in outliers:
            for view in views:
                print(row(kind + share, view, [score(factory, kind + share, s, view) for s in seeds]), flush=True)


def engine_runs(source: Path) -> list[EngineRun]:
    """From the git directory, or from a folder of caches that `engine_records` wrote."""
    caches = sorted(source.glob("run_*.npz"))
    if caches:
        return [EngineRun.load_file(file) for file in caches]
    return [read_run(source, path) for path in paths(source)]


def engine_tables(factory: Factory, source: Path, views: Iterable[str] = VIEWS, every: int = 1) -> None:
    """Every second tooth fed and the others predicted; all teeth fed; only every so manieth run, to be quick."""
    runs = engine_runs(source)
    pitch = pitch_errors(runs)
    runs = runs[::every]
    print(
        f"\nEngine, {len(runs)} runs, every second tooth fed, the others predicted, the first {SKIP:.0%} left out.\n"
        "RMS [rad], of the second half too, and shares within one and two sigma (reading included): medians over runs.\n"
        f"Pitch errors {np.rad2deg(pitch.std()):.3f} degrees RMS, {np.rad2deg(np.abs(pitch).max()):.2f} at most."
    )
    print(f"{'teeth':10} {'view':7} {'estimator':10} {'RMS':>8} {'worst':>8} {'half':>8}  {'1s':>5} {'2s':>5}  bad cov")
    sets: dict[str, Callable[[EngineRun], np.ndarray]] = {
        "calibrated": lambda run: calibrated(run, pitch),
        "raw": lambda run: run.angle_rad,
    }
    for name, angles in sets.items():
        for view in views:
            for who, maker in (("judged", factory), ("textbook", tuned)):
                if who == "textbook" and view == "lag":
                    continue
                made = [predict(maker, run, angles(run), view) for run in runs]
                rms = np.array([one.rms for one in made])
                half = np.median([one.rms_second_half for one in made])
                inside = np.median([one.inside for one in made], axis=0)
                print(
                    f"{name:10} {view:7} {who:10} {np.median(rms):8.5f} {rms.max():8.5f} {half:8.5f}  "
                    f"{inside[0]:5.2f} {inside[1]:5.2f}  {sum(one.bad for one in made)}",
                    flush=True,
                )
    print("\nEngine, all teeth fed: runs whose settled speed is off by half or whose angle is off by half a tooth")
    for name, angles in sets.items():
        for view in views:
            tracks = [track(factory, run.time_s, angles(run), KIND, view) for run in runs]
            left = sum(leaves(made, run) for made, run in zip(tracks, runs, strict=True))
            print(f"{name:10} {view:7} {left} of {len(runs)}", flush=True)
