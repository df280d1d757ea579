"""The place of a recording that is to be written: what may be replaced."""

from __future__ import annotations

from pathlib import Path

from textile_twin_core.errors import OutputError
from textile_twin_core.files.atomic import check_folder

_OF_A_RECORDING = (".yaml", ".mcap", ".db3", ".zstd")


def check_place(path: Path, overwrite: bool) -> None:
    """Raises OutputError unless a recording could be written there now."""
    if path.exists():
        check_replaceable(path, overwrite)
    check_folder(path)


def check_replaceable(path: Path, overwrite: bool) -> None:
    """Only a recording or an empty folder is replaced, the first only when that is asked for.

    Raises OutputError when something else is there.
    """
    if not overwrite and not is_empty_folder(path):
        raise OutputError(
            f"output {path}: is there already; choose another name, or have it replaced"
            " (--force on the command line, overwrite:=true for a node)"
        )
    entries = path.iterdir() if path.is_dir() else [path]
    others = sorted(entry.name for entry in entries if entry.suffix not in _OF_A_RECORDING or entry.is_dir())
    if others:
        raise OutputError(f"output {path}: holds {others[0]}, which is no part of a recording; choose another name")


def is_empty_folder(path: Path) -> bool:
    """Whether there is a folder with nothing in it."""
    return path.is_dir() and not any(path.iterdir())
