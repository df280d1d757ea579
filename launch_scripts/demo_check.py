"""Check that the demonstration's nodes lost no sample and agree with the engine on the same bag."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import TwinError
from textile_twin_core.recordings import AngleSamples, TorqueSamples, open_bag

ANGLE, MEASURED, PREDICTED = "main_shaft/angle", "balancing_torque/measured", "balancing_torque/predicted"
AGREEMENT = 1e-9
"""Largest difference between the torque of the nodes and that computed here, over the peak."""


def predict(machine: str, angles: AngleSamples) -> tuple[FloatArray | IntArray, FloatArray]:
    """Return stamps [ns] and balancing torque [N m] from the angles of a recording, by the estimator of the node."""
    session = ttc.compile(ttc.machines.create(machine), outputs=["balancing_torque_Nm"]).session(shaft="causal")
    samples = session.step(angles.stamps, angles.angles_rad, angles.velocities)
    return samples.stamps, samples["balancing_torque_Nm"]


def difference(published: TorqueSamples, stamps: FloatArray | IntArray, torque_Nm: FloatArray) -> float:
    """Return the largest difference of published and computed torque over the peak; inf if stamps differ."""
    if not np.array_equal(published.stamps, stamps):
        return np.inf
    return float(np.max(np.abs(published.torque_Nm - torque_Nm)) / np.max(np.abs(torque_Nm)))


def check(played_path: Path, recorded_path: Path, machine: str) -> int:
    """Print the counts of played, recorded and computed samples; return 1 if samples are lost or differ."""
    played, recorded = open_bag(played_path), open_bag(recorded_path)
    angles, published = played.read_angles(ANGLE), recorded.read_torques(PREDICTED)
    stamps, torque_Nm = predict(machine, angles)
    counts = {
        "shaft angles recorded": (len(recorded.read_angles(ANGLE)), len(angles)),
        "measured torques recorded": (len(recorded.read_torques(MEASURED)), len(played.read_torques(MEASURED))),
        "predicted torques recorded": (len(published), len(stamps)),
    }
    error = difference(published, stamps, torque_Nm)
    for name, (there, due) in counts.items():
        print(f"{name:28}{there} of {due}")
    print(f"{'nodes against offline':28}{error:.1e} of the peak torque at most")

    if any(there != due for there, due in counts.values()):
        print("samples were lost on the way; play at a lower rate: launch_scripts/demo.sh 1", file=sys.stderr)
        return 1
    if error > AGREEMENT:
        print(f"the nodes' torque differs from the one computed offline by more than {AGREEMENT}", file=sys.stderr)
        return 1
    return 0


def main() -> int:
    """Check the recordings named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("played", type=Path, help="the recording that was played")
    parser.add_argument("recorded", type=Path, help="what was recorded of it and of the nodes")
    parser.add_argument("--machine", default="tufting")
    options = parser.parse_args()
    try:
        return check(options.played, options.recorded, options.machine)
    except TwinError as error:
        print(f"demo_check.py: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
