"""Machine files and tables of motion, in and out. Each part is imported when it is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from textile_twin_core.errors import OutputError
from textile_twin_core.files.atomic import check_folder, remove, staged

if TYPE_CHECKING:
    from textile_twin_core.files.machine_file import load_machine_file, machine_document, save_machine_file
    from textile_twin_core.files.motion_table import MotionTable, read_motion_table, write_table

__all__ = [
    "MotionTable",
    "OutputError",
    "check_folder",
    "load_machine_file",
    "machine_document",
    "read_motion_table",
    "remove",
    "save_machine_file",
    "staged",
    "write_table",
]

_PLACES = {
    "machine_file": ("load_machine_file", "machine_document", "save_machine_file"),
    "motion_table": ("MotionTable", "read_motion_table", "write_table"),
}
_MODULES = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'textile_twin_core.files' has no attribute '{name}'")
    return getattr(import_module(f"textile_twin_core.files.{_MODULES[name]}"), name)
