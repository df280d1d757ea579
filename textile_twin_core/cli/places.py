"""Where outputs go: endings that say what a file holds, places that can be written, none over what is read."""

from __future__ import annotations

from pathlib import Path

from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.files import check_file


def check_output(option: str, path: Path | None, *endings: str) -> None:
    """Refuse an output, where one is asked for, before the work: one of another ending or that cannot be written.

    Raises UsageError unless it ends in one of `endings`, OutputError where no file can be written.
    """
    if path is None:
        return
    if path.suffix not in endings:
        raise UsageError(f"{option} {path}: must end in {' or '.join(endings)}")
    check_file(path)


def keep_input(path: Path | None, read: Path | None) -> None:
    """Raises UsageError where --out is the very file or recording that is read, by whatever name or link."""
    if path is None or read is None or not path.exists() or not read.exists():
        return
    if path.samefile(read):
        raise UsageError(f"--out {path}: is what is read, and would be lost; choose another name")
