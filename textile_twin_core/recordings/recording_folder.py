"""Recordings named by paths, including folders of recordings, and their names in reports."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from textile_twin_core.errors import RecordingError

_FILES = (".mcap", ".db3")


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
