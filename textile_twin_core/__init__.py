"""textile-twin: digital twins of textile machines, from the angle of the main shaft to torque, needle and reactions."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from textile_twin_core import machines
    from textile_twin_core.dynamics.drive_torque import TorqueOverAngle, TorqueOverTime
    from textile_twin_core.machine import AnyMachine, Machine
    from textile_twin_core.machine.drive import drive
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

# The engine is imported when it is first used, so that commands which do not need it start at once.
_ENGINE = {
    "Machine": ("machine", "Machine"),
    "Samples": ("twin", "Samples"),
    "Session": ("twin", "Session"),
    "Twin": ("twin", "Twin"),
    "compile": ("twin", "compile_machine"),
    "TorqueOverAngle": ("dynamics.drive_torque", "TorqueOverAngle"),
    "TorqueOverTime": ("dynamics.drive_torque", "TorqueOverTime"),
    "drive": ("machine.drive", "drive"),
}


def __getattr__(name: str) -> Any:
    if name == "machines":
        return import_module("textile_twin_core.machines")
    if name in _ENGINE:
        module, attribute = _ENGINE[name]
        return getattr(import_module(f"textile_twin_core.{module}"), attribute)
    raise AttributeError(f"module 'textile_twin_core' has no attribute '{name}'")


def load_machine(path: str | Path) -> AnyMachine:
    """A machine from a machine file (YAML). Raises MachineError with the key at fault."""
    from textile_twin_core.files import load_machine_file

    return load_machine_file(path)
