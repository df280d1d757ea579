"""Check of the output path of a recording."""

from __future__ import annotations

from pathlib import Path

from textile_twin_core.errors import OutputError
from textile_twin_core.files.atomic import check_folder

_OF_A_RECORDING = (".yaml", ".mcap", ".db3", ".zstd")


def check_place(path: Path, overwrite: bool) -> None:
    """Raise OutputError unless a recording can be written to this path."""
    if path.exists():
        check_replaceable(path, overwrite)
    check_folder(path)


def check_replaceable(path: Path, overwrite: bool) -> None:
    """Check that the path is an empty folder or, with `overwrite`, a recording.

    Raises:
        OutputError: Something else is there.
    """
    if not overwrite and not is_empty_folder(path):
        raise OutputError(
            f"output {path}: is there already; choose another name, or have it replaced"
            " (--force on the command line, overwrite:=true for a node)"
        )
    entries = path.iterdir() if path.is_dir() else [path]
    others = sorted(entry.name for entry in entries if entry.suffix not in _OF_A_RECORDING or entry.is_dir())
    if others:
        raise OutputError(f"output {path}: holds {others[0]}, which is not part of a recording; choose another name")


def is_empty_folder(path: Path) -> bool:
    """Return true for an existing empty folder."""
    return path.is_dir() and not any(path.iterdir())
