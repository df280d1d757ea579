"""Files wrong in one body or length, and files off within their tolerances: what the verdict and calibrate say.

Run from the root of the repository: python -m tests.benchmarks.wrong_files wrong|tolerances FIRST_SEED LAST_SEED
"""

from __future__ import annotations

import sys

from tests.generators.mill_recordings import Case, healthy, record
from tests.generators.wrong_files import off_within_tolerances, wrong_files
from textile_twin_core.comparison import Readings, assess, calibrate

SENSORS = ("encoder_", "torque_", "delay", "zero_or_delay", "clocks_drift", "angle_")


def readings(case: Case) -> Readings:
    """The case's recording."""
    made = record(case)
    return Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)


def wrong(seeds: range) -> None:
    """A row for each mistake, and how often the number or an equivalent one was named, nothing, or a sensor."""
    count = {"named": 0, "nothing": 0, "else": 0, "sensor": 0}
    for case in (healthy(machine, seed) for seed in seeds for machine in ("tufting", "loom")):
        seen = readings(case)
        for path, factor, machine in wrong_files(case):
            found = assess(seen, machine)
            hit = any(path in (cause.parameter, *cause.equivalents) for cause in found.verdict)
            sensor = any(cause.cause.startswith(SENSORS) for cause in found.verdict)
            outcome = "named" if hit else "else" if found.verdict else "nothing"
            count[outcome] += 1
            count["sensor"] += sensor
            named = "; ".join(
                f"{cause.cause} {cause.parameter} ({', '.join(cause.equivalents)})" for cause in found.verdict
            )
            print(
                f"| {case.machine} | {case.seed} | {path} | {factor:.3f} | {outcome} | {named} |",
                flush=True,
            )
    print(count)


def tolerances(seeds: range) -> None:
    """How often the 95 % intervals of calibrate hold the truth with files that are off within their tolerances."""
    held: dict[tuple[str, str], list[bool]] = {}
    for case in (healthy(machine, seed) for seed in seeds for machine in ("tufting", "loom")):
        found = calibrate(readings(case), off_within_tolerances(case))
        true = {"zero": (found.zero_rad, 0.0), "gain": (found.gain, 1.0)}
        true |= {"offset": (found.offset_Nm, 0.0), "delay": (found.delay_s, 0.0)}
        for name, (estimate, value) in true.items():
            low, high = estimate.interval95
            held.setdefault((case.machine, name), []).append(low <= value <= high)
        named = [cause.cause for cause in found.assessment.verdict]
        print(f"| {case.machine} | {case.seed} | {', '.join(named) or 'nothing'} | ", end="")
        print(" | ".join(f"{(e.value - v) / e.sigma:+.2f}" for e, v in true.values()), "|", flush=True)
    for (machine, name), each in held.items():
        print(f"| {machine} | {name} | {sum(each)} of {len(each)} |")


if __name__ == "__main__":
    {"wrong": wrong, "tolerances": tolerances}[sys.argv[1]](range(int(sys.argv[2]), int(sys.argv[3])))
