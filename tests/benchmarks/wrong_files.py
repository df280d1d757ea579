"""Files wrong in one body or length, and files off within their tolerances: results of verdict and calibrate.

Run from the root of the repository: python -m tests.benchmarks.wrong_files wrong|tolerances FIRST_SEED LAST_SEED
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict

import numpy as np

from tests.generators.mill_recordings import Case, healthy, record
from tests.generators.wrong_files import off_within_tolerances, wrong_files
from textile_twin_core.comparison import Estimate, Readings, assess, calibrate
from textile_twin_core.comparison.assessment import Judged
from textile_twin_core.inference.map_fit import fit_with_prior_update, prior_variance

SENSORS = ("encoder_", "torque_", "delay", "zero_or_delay", "clocks_drift", "angle_")
ABOVE_NATS = 10.0
"""Gain from which a mistake is above the noise: the odds of a wrong number of a body, 1 to 500, take 6.2 of them."""


def readings(case: Case) -> Readings:
    """The case's recording."""
    made = record(case)
    return Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)


def gained_nats(found: Judged, path: str) -> float:
    """Log posterior that the departure of one number gains over a fit with all numbers within their tolerances.

    This is what the mistake leaves beyond the noise once sensors, friction and all tolerances have taken their part:
    half of what chi squared falls by, with residuals of one turn counted as they scatter.
    """
    p = found.posterior
    m, hypothesis, inflation, scale = p.measurement, p.hypothesis, p.fit.inflation, p.fit.scale

    def log_posterior(off_nominal: tuple[str, ...]) -> float:
        fits = [
            fit_with_prior_update(m, hypothesis, x, off_nominal, inflation=inflation, scale=scale, relinearise=True)
            for x in (m.nominal.copy(), p.fit.x)
        ]
        return max(
            fit.log_likelihood - 0.5 * float(np.sum((fit.x - m.nominal) ** 2 / prior_variance(m, off_nominal, fit.x)))
            for fit in fits
        )

    return log_posterior((path,)) - log_posterior(())


def wrong(seeds: range) -> None:
    """A row for each mistake, and how often the number or an equivalent one was named, nothing, or a sensor."""
    count: dict[tuple[str, str], int] = defaultdict(int)
    cases = (healthy(m, seed, spring=spring) for seed in seeds for m in ("tufting", "loom") for spring in (False, True))
    for case in cases:
        seen = readings(case)
        for path, factor, machine in wrong_files(case):
            found = assess(seen, machine)
            hit = any(path in (cause.parameter, *cause.equivalents) for cause in found.verdict)
            sensor = any(cause.cause.startswith(SENSORS) for cause in found.verdict)
            outcome = "named" if hit else "else" if found.verdict else "nothing"
            nats = gained_nats(found.found, path) if found.found is not None else math.nan
            size = "in the noise" if nats < ABOVE_NATS else "above the noise"
            count[size, outcome] += 1
            count[size, "sensor"] += sensor
            named = "; ".join(
                f"{cause.cause} {cause.parameter} ({', '.join(cause.equivalents)})" for cause in found.verdict
            )
            print(
                f"| {case.machine} | {case.seed} | {path} | {factor:.3f} | {nats:.1f} | {outcome} | {named} |",
                flush=True,
            )
    for (size, outcome), times in sorted(count.items()):
        print(f"| {size} | {outcome} | {times} |")


def tolerances(seeds: range) -> None:
    """Coverage of the 95 % intervals of calibrate with files that are off within their tolerances."""
    held: dict[tuple[str, str], list[bool]] = {}
    for case in (healthy(machine, seed) for seed in seeds for machine in ("tufting", "loom")):
        machine = off_within_tolerances(case)
        found = calibrate(readings(case), machine)
        true = {"zero": (found.zero_rad, 0.0), "gain": (found.gain, 1.0)}
        true |= {"offset": (found.offset_Nm, 0.0), "delay": (found.delay_s, 0.0)}
        assert found.assessment.found is not None
        settled = found.assessment.found.settled
        for known in settled.posterior.measurement.parameters:
            if known.kind == "force":
                value, sigma = settled.value(known.name), settled.sigma(known.name)
                true["force"] = Estimate(value, sigma, settled.interval95(known.name)), case.backing.force_N
        for name, (estimate, value) in true.items():
            low, high = estimate.interval95
            held.setdefault((case.machine, name), []).append(low <= value <= high)
        named = [cause.cause for cause in found.assessment.verdict]
        print(f"| {case.machine} | {case.seed} | {', '.join(named) or 'nothing'} | ", end="")
        print(" | ".join(f"{(e.value - v) / e.sigma:+.2f}" for e, v in true.values()), "|", flush=True)
    for (machine_name, name), each in held.items():
        print(f"| {machine_name} | {name} | {sum(each)} of {len(each)} |")


if __name__ == "__main__":
    {"wrong": wrong, "tolerances": tolerances}[sys.argv[1]](range(int(sys.argv[2]), int(sys.argv[3])))
