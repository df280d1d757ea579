"""textile-twin: digital twins of textile machines, from the angle of the main shaft to torque, needle and reactions."""

from __future__ import annotations

from pathlib import Path

from textile_twin_core import machines
from textile_twin_core.errors import MachineError, MotionError, RecordingError, SceneError, TwinError
from textile_twin_core.machines import Machine
from textile_twin_core.twin import Samples, Session, Twin
from textile_twin_core.twin import compile_machine as compile

__all__ = [
    "Machine",
    "MachineError",
    "MotionError",
    "RecordingError",
    "Samples",
    "SceneError",
    "Session",
    "Twin",
    "TwinError",
    "compile",
    "load_machine",
    "machines",
]


def load_machine(path: str | Path) -> Machine:
    """A machine from a machine file (YAML). Raises MachineError with the key at fault."""
    from textile_twin_core.files import load_machine_file

    return load_machine_file(path)
