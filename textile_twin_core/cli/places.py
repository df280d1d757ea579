"""Where outputs go: endings that say what a file holds, and no output over what the command reads."""

from __future__ import annotations

from pathlib import Path

from textile_twin_core.cli.mistakes import UsageError


def check_ending(option: str, path: Path | None, *endings: str) -> None:
    """Raises UsageError unless an output, where one is asked for, ends in one of `endings`."""
    if path is not None and path.suffix not in endings:
        raise UsageError(f"{option} {path}: must end in {' or '.join(endings)}")


def keep_input(path: Path | None, read: Path | None) -> None:
    """Raises UsageError where --out is the very file that is read, by whatever name or link."""
    if path is None or read is None or not path.exists() or not read.exists():
        return
    if path.samefile(read):
        raise UsageError(f"--out {path}: is the file that is read, which would be lost; choose another name")
