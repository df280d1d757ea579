"""What was logged, from a recording that the arguments name."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from textile_twin_core.comparison import Readings
    from textile_twin_core.files.bag import AngleSamples, Bag, TorqueSamples


def read_samples(arguments: argparse.Namespace) -> tuple[Bag, AngleSamples, TorqueSamples]:
    """The recording that the arguments of add_recording name, its shaft angles and torque. Raises RecordingError."""
    from textile_twin_core.files import open_bag
    from textile_twin_core.files.prediction import beside, usable_angles

    bag = open_bag(arguments.bag)
    for notice in bag.notices:
        print(f"textile-twin: {notice}", file=sys.stderr)
    angles = usable_angles(bag, arguments.angle_topic, arguments.joint, arguments.skip_bad_samples)
    measured = bag.read_torques(beside(bag, angles.topic, arguments.torque_topic), arguments.joint)
    return bag, angles, measured


def readings_of(angles: AngleSamples, measured: TorqueSamples) -> Readings:
    """Samples as the comparison takes them."""
    from textile_twin_core.comparison import Readings

    return Readings(angles.stamps, angles.angles_rad, measured.stamps, measured.torque_Nm, angles.velocities)
