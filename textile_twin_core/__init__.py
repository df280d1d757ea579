"""textile-twin: digital twins of textile machines, from the angle of the main shaft to torque, needle and reactions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textile_twin_core.errors import (
    AlignmentError,
    ContactError,
    MachineError,
    MotionError,
    OutputError,
    RecordingError,
    SceneError,
    TwinError,
)
from textile_twin_core.lazy import listing_of, names_of

if TYPE_CHECKING:
    from textile_twin_core import machines
    from textile_twin_core.driveline.free_motion import drive
    from textile_twin_core.dynamics.drive_torque import TorqueOverAngle, TorqueOverTime
    from textile_twin_core.files import load_machine_file as load_machine
    from textile_twin_core.machine import Machine
    from textile_twin_core.twin import Samples, Session, Twin
    from textile_twin_core.twin import compile_machine as compile

__all__ = [
    "AlignmentError",
    "ContactError",
    "Machine",
    "MachineError",
    "MotionError",
    "OutputError",
    "RecordingError",
    "Samples",
    "SceneError",
    "Session",
    "TorqueOverAngle",
    "TorqueOverTime",
    "Twin",
    "TwinError",
    "compile",
    "drive",
    "load_machine",
    "machines",
]

# The engine is imported on first use, so that commands without it start quickly.
__dir__ = listing_of(__all__)
__getattr__ = names_of(
    __name__,
    {
        "Machine": "machine",
        "Samples": "twin",
        "Session": "twin",
        "TorqueOverAngle": "dynamics.drive_torque",
        "TorqueOverTime": "dynamics.drive_torque",
        "Twin": "twin",
        "compile": "twin:compile_machine",
        "drive": "driveline.free_motion",
        "load_machine": "files.machine_file:load_machine_file",
        "machines": "machines",
    },
)
