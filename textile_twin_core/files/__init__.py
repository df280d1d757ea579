"""Machine files and motion tables: reading and writing. Each part is imported when first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textile_twin_core.errors import OutputError
from textile_twin_core.files.atomic import check_file, check_folder, remove, staged
from textile_twin_core.lazy import listing_of, names_of

if TYPE_CHECKING:
    from textile_twin_core.files.machine_file import load_machine_file, machine_document, save_machine_file
    from textile_twin_core.files.motion_table import MotionTable, read_motion_table, write_table

__all__ = [
    "MotionTable",
    "OutputError",
    "check_file",
    "check_folder",
    "load_machine_file",
    "machine_document",
    "read_motion_table",
    "remove",
    "save_machine_file",
    "staged",
    "write_table",
]

__dir__ = listing_of(__all__)
__getattr__ = names_of(
    __name__,
    {
        "MotionTable": "motion_table",
        "load_machine_file": "machine_file",
        "machine_document": "machine_file",
        "read_motion_table": "motion_table",
        "save_machine_file": "machine_file",
        "write_table": "motion_table",
    },
)
