"""Files in and out: recordings, tables of motion, machine files. Each part is imported when it is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from textile_twin_core.files.atomic import OutputError, check_folder, remove, staged

if TYPE_CHECKING:
    from textile_twin_core.files.bag import AngleSamples, Bag, PointSamples, TorqueSamples, open_bag
    from textile_twin_core.files.bag_write import BagWriter
    from textile_twin_core.files.machine_file import load_machine_file, machine_document, save_machine_file
    from textile_twin_core.files.motion_table import MotionTable, read_motion_table, write_table
    from textile_twin_core.files.rosbag2_metadata import LATCHED, OfferedQos, TopicInfo

__all__ = [
    "LATCHED",
    "AngleSamples",
    "Bag",
    "BagWriter",
    "MotionTable",
    "OfferedQos",
    "OutputError",
    "PointSamples",
    "TopicInfo",
    "TorqueSamples",
    "check_folder",
    "load_machine_file",
    "machine_document",
    "open_bag",
    "read_motion_table",
    "remove",
    "save_machine_file",
    "staged",
    "write_table",
]

_PLACES = {
    "bag": ("AngleSamples", "Bag", "PointSamples", "TorqueSamples", "open_bag"),
    "bag_write": ("BagWriter",),
    "machine_file": ("load_machine_file", "machine_document", "save_machine_file"),
    "motion_table": ("MotionTable", "read_motion_table", "write_table"),
    "rosbag2_metadata": ("LATCHED", "OfferedQos", "TopicInfo"),
}
_MODULES = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'textile_twin_core.files' has no attribute '{name}'")
    return getattr(import_module(f"textile_twin_core.files.{_MODULES[name]}"), name)
