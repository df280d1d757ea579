"""A real drive whose inertia and friction are stated: the verdict and `identify`, from measured and commanded torque.

Run from the root of the repository: python -m tests.benchmarks.two_motor_drive FOLDER, with the files
Data/Identification/*.mat of the repository malik-robert/HSM150-data in it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from textile_twin_core.comparison import Readings, assess, identify
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensors import Sensors, TorqueSensor
from textile_twin_core.mechanism import Crank

INERTIA_KGM2, VISCOUS_NMS = 1.2e-4, 7.03e-5
"""As stated beside the recordings."""
POSITION, COMMANDED, MEASURED = 2, 4, 5
"""Columns of the recordings."""


def rotor(inertia_kgm2: float, viscous_Nms: float, coulomb_Nm: float = 0.0, torque_offset_Nm: float = 0.0) -> Machine:
    """Return a rotor with friction as a machine, for drives without a linkage."""
    return Machine(
        name="rotor",
        points={"O": (0.0, 0.0)},
        groups=(Crank("rotor", at="O", end="A", length_m=0.01),),
        bodies=(Body("rotor", 0.0, inertia_kgm2),),
        loads=(ShaftFriction(viscous_Nms, coulomb_Nm),),
        gravity_m_s2=(0.0, 0.0),
        sensors=Sensors(torque=TorqueSensor(offset_Nm=torque_offset_Nm)),
    )


def main(folder: Path) -> None:
    """Print a Markdown table: inertia and viscous friction [1e-4 kg m2, 1e-5 N m s] with 95 % intervals."""
    twin = rotor(INERTIA_KGM2, VISCOUS_NMS)
    print("| recording | torque | verdict | J, 1e-4 kg m2 | B, 1e-5 N m s |")
    print("|---|---|---|---|---|")
    for path in sorted(folder.glob("idf_*.mat")):
        data = loadmat(path)["data"]
        stamps = np.rint(data[:, 0] * 1e9).astype(np.int64)
        for column, name in ((MEASURED, "measured"), (COMMANDED, "commanded")):
            readings = Readings(stamps, data[:, POSITION], stamps, data[:, column])
            assessment = assess(readings, twin)
            said = "; ".join(cause.text for cause in assessment.verdict) or "nothing"
            try:
                found = identify(readings, twin).parameters
                rows = []
                for key, stated, unit in (
                    ("added_inertia_kgm2", INERTIA_KGM2, 1e-4),
                    ("shaft_viscous_Nms", 0.0, 1e-5),
                ):
                    if key not in found:
                        rows.append("not identifiable")
                        continue
                    each = found[key]
                    low, high = ((stated + end) / unit for end in each.interval95)
                    rows.append(f"{(stated + each.value) / unit:.3f} ({low:.3f} to {high:.3f})")
            except RecordingError as error:
                rows = [str(error), ""]
            print(f"| {path.stem} | {name} | {said} | {rows[0]} | {rows[1]} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
