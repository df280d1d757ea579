"""A known truth found again on many seeds: errors, standard deviations and coverage of the intervals.

Run from the root of the repository: python -m tests.benchmarks.identification FIRST_SEED LAST_SEED, or with `elastic`
instead of the seeds: the bias that a shaft brings which twists, while the model's does not.
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict
from dataclasses import replace

import numpy as np

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import START_NS, Case, healthy, record, torque_of
from tests.generators.shaft_law import Backing, Friction, tufting_law
from textile_twin_core.comparison import Estimate, Readings, identify

TRUTH = {
    "backing_force_N": 900.0,
    "free_force_N": 12.0,
    "shaft_viscous_Nms": 0.05,
    "shaft_coulomb_Nm": 0.3,
    "added_inertia_kgm2": 0.0,
    "torque_sensor_delay_s": 0.003,
    "torque_sensor_gain": 1.02,
    "torque_sensor_offset_Nm": 0.0,
    "encoder_zero_rad": 0.0,
}


def recorded_case(seed: int) -> Case:
    """The truth of a recording of 60 s."""
    case = healthy("tufting", seed, duration_s=60.0)
    return replace(
        case,
        backing=Backing(force_N=TRUTH["backing_force_N"], free_force_N=TRUTH["free_force_N"]),
        friction=Friction(TRUTH["shaft_viscous_Nms"], TRUTH["shaft_coulomb_Nm"]),
        torque=replace(case.torque, gain=TRUTH["torque_sensor_gain"], delay_s=TRUTH["torque_sensor_delay_s"]),
    )


def identified(seed: int) -> dict[str, Estimate]:
    """The parameters found in one recording."""
    case = recorded_case(seed)
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return dict(identify(readings, configured_machine(case)).parameters)


STIFFNESSES_NM_RAD = (math.inf, 80e3, 20e3, 5e3)
ELASTIC_SEED = 7000


def truly() -> dict[str, float]:
    """Every parameter as it is."""
    theta = np.linspace(0.0, 2.0 * np.pi, 2_000_001)
    inside = np.flatnonzero(tufting_law().at(theta)[3] >= Backing().entry_plane_m)
    return TRUTH | {"entry_angle_rad": float(theta[inside[0]]), "exit_angle_rad": float(theta[inside[-1]])}


def elastic() -> None:
    """Print a Markdown table of errors (and standard deviations) by the stiffness of the shaft behind the encoder.

    The encoder sits at the drive: the crank lags it by the torque over the stiffness.
    """
    case = recorded_case(ELASTIC_SEED)
    made = record(case)
    torque = torque_of(case, *made.plan.at((made.angle_stamps_ns - START_NS) * 1e-9))
    truth = truly()
    rows: dict[str, list[str]] = {}
    for stiffness in STIFFNESSES_NM_RAD:
        angle = np.mod(made.angle + torque / stiffness, 2.0 * np.pi)
        readings = Readings(made.angle_stamps_ns, angle, made.torque_stamps_ns, made.torque)
        found = identify(readings, configured_machine(case)).parameters
        product = found["backing_force_N"].value * found["torque_sensor_gain"].value
        rows.setdefault("force times gain, share", []).append(f"{product / (900.0 * 1.02) - 1.0:+.2g}")
        for name, each in found.items():
            rows.setdefault(name, []).append(f"{each.value - truth[name]:+.2g} ({each.sigma:.1g})")
        print(f"{stiffness:g} N m/rad: done", file=sys.stderr, flush=True)
    print("| parameter |", *(f"{stiffness:g} |" for stiffness in STIFFNESSES_NM_RAD))
    print("|---|" + "---|" * len(STIFFNESSES_NM_RAD))
    for name, errors in rows.items():
        print(f"| {name} |", *(f"{error} |" for error in errors))


def main(first: int, last: int) -> None:
    """Print a Markdown table."""
    truth = truly()
    errors, sigmas, covered = defaultdict(list), defaultdict(list), defaultdict(list)
    for seed in range(first, last):
        found = identified(seed)
        print(f"seed {seed}: {len(found)} parameters", file=sys.stderr, flush=True)
        for name, each in found.items():
            errors[name].append(each.value - truth[name])
            sigmas[name].append(each.sigma)
            covered[name].append(each.interval95[0] <= truth[name] <= each.interval95[1])
        product = found["backing_force_N"].value * found["torque_sensor_gain"].value
        errors["force times gain, share"].append(product / (900.0 * 1.02) - 1.0)
    print("| parameter | true | largest error | scatter of the error | mean sigma | truth in the interval |")
    print("|---|---|---|---|---|---|")
    for name, list_of in errors.items():
        told = f"{truth[name]:.6g}" if name in truth else ""
        inside_of = f"{sum(covered[name])} of {len(list_of)}" if name in covered else ""
        sigma = f"{np.mean(sigmas[name]):.2g}" if name in sigmas else ""
        largest, scatter = np.max(np.abs(list_of)), np.std(list_of)
        print(f"| {name} | {told} | {largest:.2g} | {scatter:.2g} | {sigma} | {inside_of} |")


if __name__ == "__main__":
    if sys.argv[1] == "elastic":
        elastic()
    else:
        main(int(sys.argv[1]), int(sys.argv[2]))
