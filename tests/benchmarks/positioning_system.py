"""A real drive whose mass and friction are published: the verdict and `identify`, with the file's mass wrong too.

Run from the root of the repository: python -m tests.benchmarks.positioning_system FOLDER, with DATA_EMPS.mat and
DATA_EMPS_PULSES.mat of the benchmark by Janot, Gautier and Brunot (2019) in it, as in examples/EMPS/data of the
repository forgi86/sysid-neural-continuous.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from tests.benchmarks.two_motor_drive import rotor
from textile_twin_core.comparison import Cause, Identification, Readings, assess, identify
from textile_twin_core.machine import Machine

MASS_KG, VISCOUS_NS_M, COULOMB_N, OFFSET_N = 95.1089, 203.5034, 20.3935, -3.1648
"""As published, by least squares on the first recording (IDIM-LS)."""
METRES_A_RADIAN = 0.0025 / (2.0 * math.pi)
"""Of the carriage: 50 000 counts in a turn of the screw, 50 nm each."""
SHARES = (1.0, 0.5, 0.2, 0.05)
"""Of the mass, in the machine file."""


def machine(share: float) -> Machine:
    """The screw with a share of the published mass."""
    r = METRES_A_RADIAN
    return rotor(share * MASS_KG * r**2, VISCOUS_NS_M * r**2, COULOMB_N * r, OFFSET_N * r)


def readings(path: Path) -> Readings:
    """Angle of the screw, and its torque: the controller's command times the drive's gain."""
    found = loadmat(path)
    time, way, asked = (found[name].ravel() for name in ("t", "qm", "vir"))
    stamps = np.rint(time * 1e9).astype(np.int64)
    torque = float(found["gtau"].item()) * asked * METRES_A_RADIAN
    return Readings(stamps, way / METRES_A_RADIAN, stamps, torque)


def shown(cause: Cause, share: float) -> str:
    """A cause in the units of the carriage."""
    if cause.cause == "unmodelled_inertia" and isinstance(cause.value, float):
        mass, sigma = (value / METRES_A_RADIAN**2 for value in (cause.value, cause.sigma))
        return f"mass {share * MASS_KG + mass:.2f} +- {sigma:.2f} kg"
    if cause.cause == "delay" and isinstance(cause.value, float):
        return f"delay {cause.value * 1e3:.2f} +- {cause.sigma * 1e3:.2f} ms"
    return cause.text


def identified(found: Identification, share: float) -> str:
    """Mass, viscous and dry friction in the units of the carriage."""
    r, said = METRES_A_RADIAN, []
    for name, unit, factor, told in (
        ("added_inertia_kgm2", "kg", r**-2, share * MASS_KG),
        ("shaft_viscous_Nms", "N s/m", r**-2, 0.0),
        ("shaft_coulomb_Nm", "N", 1.0 / r, 0.0),
    ):
        each = found.parameters[name]
        said.append(f"{told + each.value * factor:.2f} +- {each.sigma * factor:.2f} {unit}")
    return ", ".join(said)


def main(folder: Path) -> None:
    """Print a Markdown table."""
    print("| recording | mass in the file | verdict | `identify` |")
    print("|---|---|---|---|")
    for name in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        record = readings(folder / f"{name}.mat")
        for share in SHARES:
            twin = machine(share)
            said = "; ".join(shown(cause, share) for cause in assess(record, twin).verdict)
            print(f"| {name} | {share:.0%} | {said} | {identified(identify(record, twin), share)} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
