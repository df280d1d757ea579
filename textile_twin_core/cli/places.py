"""Checks of output paths: valid ending, writable place, and no overlap with the input."""

from __future__ import annotations

from pathlib import Path

from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.files import check_file


def check_output(option: str, path: Path | None, *endings: str) -> None:
    """Check an output, if requested, before the work.

    Raises:
        UsageError: The path does not end in one of `endings`.
        OutputError: The file cannot be written.
    """
    if path is None:
        return
    if path.suffix not in endings:
        raise UsageError(f"{option} {path}: must end in {' or '.join(endings)}")
    check_file(path)


def keep_input(path: Path | None, read: Path | None) -> None:
    """Raise UsageError if --out is the input file or recording, under any name or link."""
    if path is None or read is None or not path.exists() or not read.exists():
        return
    if path.samefile(read):
        raise UsageError(f"--out {path}: is what is read, and would be lost; choose another name")
