"""Paths of recordings: folders of them, names in reports, and places to which one can be written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from textile_twin_core.errors import OutputError, RecordingError
from textile_twin_core.files.atomic import check_folder

_FILES = (".mcap", ".db3")
_OF_A_RECORDING = (".yaml", ".mcap", ".db3", ".zstd")


def recordings_in(given: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Find the recordings that paths stand for, each once.

    A folder without metadata stands for the recordings in it. A folder of files alone is one recording that has lost
    its metadata.

    Args:
        given: rosbag2 folders, files, or folders of recordings.

    Returns:
        The recordings, and a notice for each path that is part of another recording.

    Raises:
        RecordingError: a folder holds no recording.
    """
    found: list[Path] = []
    for path in given:
        inside = sorted(path.iterdir()) if path.is_dir() and not (path / "metadata.yaml").exists() else []
        folders = [entry for entry in inside if (entry / "metadata.yaml").exists()]
        files = [entry for entry in inside if set(entry.suffixes) & set(_FILES)]
        if inside and not folders and not files:
            raise RecordingError(f"{path}: no recording in this folder")
        found += sorted(folders + files) if folders else [path]
    each = {path.resolve(): path for path in found}
    parts = [path for place, path in each.items() if set(path.suffixes) & set(_FILES) and place.parent in each]
    notices = [f"{path}: is part of the recording {path.parent}, which is read once" for path in parts]
    return [path for path in each.values() if path not in parts], notices


def recording_names(paths: Sequence[Path]) -> list[str]:
    """Return the name of each recording, or its whole path where another has the same name."""
    names = [path.name for path in paths]
    return [str(path) if names.count(name) > 1 else name for path, name in zip(paths, names, strict=True)]


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
