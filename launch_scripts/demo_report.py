"""The demonstration's result in a short table, and the proof that its nodes lost nothing and computed rightly."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.files import AngleSamples, TorqueSamples, open_bag

ANGLE, MEASURED, PREDICTED = "main_shaft/angle", "balancing_torque/measured", "balancing_torque/predicted"
AGREEMENT = 1e-9
"""How far the nodes' torque may be from the one computed offline, over its peak."""


def predict(machine: ttc.Machine, angles: AngleSamples) -> tuple[FloatArray | IntArray, FloatArray]:
    """Stamps [ns] and balancing torque [N m] of a recording's angles, by the estimator that the node has."""
    session = ttc.compile(machine, outputs=["balancing_torque_Nm"]).session(shaft="causal")
    samples = session.step(angles.stamps, angles.angles_rad, angles.velocities)
    return samples.stamps, samples["balancing_torque_Nm"]


def difference(predicted: TorqueSamples, stamps: FloatArray | IntArray, torque_Nm: FloatArray) -> float:
    """Largest difference between the nodes' torque and the offline one, over the peak; inf where stamps differ."""
    if not np.array_equal(predicted.stamps, stamps):
        return np.inf
    return float(np.max(np.abs(predicted.torque_Nm - torque_Nm)) / np.max(np.abs(torque_Nm)))


def main() -> int:
    """Print the table; returns 1 when something was lost or differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("played", type=Path, help="the recording that was played")
    parser.add_argument("recorded", type=Path, help="what was recorded of it")
    parser.add_argument("comparison", type=Path, help="what `textile-twin compare --json` wrote")
    parser.add_argument("--machine", default="tufting")
    options = parser.parse_args()

    played, recorded = open_bag(options.played), open_bag(options.recorded)
    angles, predicted = played.read_angles(ANGLE), recorded.read_torques(PREDICTED)
    stamps, torque_Nm = predict(ttc.machines.create(options.machine), angles)
    error = difference(predicted, stamps, torque_Nm)
    lost = {
        "shaft angles": (len(angles), len(recorded.read_angles(ANGLE))),
        "measured torques": (len(played.read_torques(MEASURED)), len(recorded.read_torques(MEASURED))),
        "predicted torques": (len(stamps), len(predicted)),
    }
    result = json.loads(options.comparison.read_text())
    torque, samples = result["torque"], result["samples"]
    rows = [(name, f"{there} of {due}") for name, (due, there) in lost.items()]
    rows += [
        ("nodes against offline", f"{error:.1e} of the peak at most"),
        ("revolutions compared", f"{result['revolutions']:g}"),
        ("samples compared", f"{samples['used']}"),
        ("RMS error of the torque", f"{torque['rms_error_Nm']:.3f} N m"),
        ("... over the peak", f"{100 * torque['rms_over_peak']:.2f} %"),
        ("correlation", f"{torque['correlation']:.5f}"),
        ("torque sensor's delay", f"{1e3 * torque['delay_s']:.2f} ms"),
    ]
    width = max(len(name) for name, _ in rows)
    print("\n".join(f"  {name:<{width}}  {value}" for name, value in rows))

    complete = all(there == due for due, there in lost.values())
    if not complete:
        print("samples were lost on the way: the computer is too busy for this rate; try a lower one", file=sys.stderr)
    elif error > AGREEMENT:
        print("the nodes' torque differs from the one computed offline", file=sys.stderr)
    return 0 if complete and error <= AGREEMENT else 1


if __name__ == "__main__":
    sys.exit(main())
