"""The live state of an elastic main shaft against a simulation by other equations, as tables.

Run from the root of the repository: python -m tests.benchmarks.elastic_shaft [--seconds 8] [--wrong]

Sixteen tufting linkages on 4 m of steel, 14-bit encoder at 1 kHz at the end of the drive, in phase and rows half a
turn apart. Errors are root mean square over the largest torque of the first piece, after four seconds. `--wrong`: also
how they grow where stiffness or damping of the machine file are wrong.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import time

import numpy as np

import textile_twin_core as ttc
from tests.generators.elastic_shaft import Record, WideMachine, needle_m, simulate
from tests.twin.test_elastic_session import FAR, TORQUE, declared
from textile_twin_core.machine import Machine

DIAMETERS_M, SPEEDS_RPM = (0.04, 0.06, 0.08, 0.1), (160.0, 300.0, 500.0)
_AFTER_S = 4.0
_STAGGERED = tuple(math.pi * (k % 2) for k in range(16))


def row(machine: Machine, made: Record) -> tuple[float, float, float, float]:
    """Error of the torque over its peak, share within sigma, far needle [m], processor time a sample [s]."""
    session = ttc.compile(machine, outputs=[TORQUE, FAR]).session()
    used = time.process_time()
    samples = session.step(made.stamps_ns, made.encoder_rad)
    used = time.process_time() - used
    late = made.time_s[samples.index] > _AFTER_S
    off = samples[TORQUE] - made.torque_Nm[samples.index]
    phase = machine.linkages[-1].phase_rad
    far = samples[FAR] - needle_m(made.angles_rad[samples.index, -1] + phase)
    return (
        float(np.sqrt(np.mean(off[late] ** 2)) / np.abs(made.torque_Nm).max()),
        float(np.mean(np.abs(off) < samples.torque_sigma_Nm, where=late)),
        float(np.sqrt(np.mean(far[late] ** 2))),
        used / len(samples),
    )


def changed(machine: Machine, stiffness: float = 1.0, damping: float = 1.0) -> Machine:
    """The machine with a shaft that is stiffer or more damped than it is."""
    shaft = machine.shaft
    assert shaft is not None
    pieces = tuple(
        dataclasses.replace(
            piece,
            shear_modulus_Pa=stiffness * piece.shear_modulus_Pa,
            damping_Nms_rad=damping * piece.damping_Nms_rad,
        )
        for piece in shaft.pieces
    )
    return dataclasses.replace(machine, shaft=dataclasses.replace(shaft, pieces=pieces))


def main() -> None:
    """Simulate, observe and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--wrong", action="store_true", help="also with wrong stiffness and damping")
    options = parser.parse_args()
    for phases in (None, _STAGGERED):
        print("rows half a turn apart" if phases else "in phase")
        print(f"{'mm':>4} {'rpm':>4} {'drive':>8} {'torque':>8} {'in sigma':>8} {'far um':>7} {'us':>6}", flush=True)
        for diameter in DIAMETERS_M:
            wide = WideMachine(diameter, phases_rad=phases)
            for rpm in SPEEDS_RPM:
                made = simulate(wide, rpm, options.seconds)
                cases = {"known": declared(wide, True), "unknown": declared(wide, False)}
                if options.wrong:
                    cases |= {
                        "k +1 %": changed(cases["known"], 1.01),
                        "k +5 %": changed(cases["known"], 1.05),
                        "c x 1.5": changed(cases["known"], 1.0, 1.5),
                    }
                for name, machine in cases.items():
                    error, inside, far, used = row(machine, made)
                    place = f"{1e3 * diameter:4.0f} {rpm:4.0f} {name:>8}"
                    print(f"{place} {100 * error:7.3f}% {inside:8.2f} {1e6 * far:7.2f} {1e6 * used:6.1f}", flush=True)


if __name__ == "__main__":
    main()
