"""Atomic output: files are written to a hidden sibling and renamed into place when complete."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from textile_twin_core.errors import OutputError


def _why(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def partial_path(path: Path) -> Path:
    """Return the hidden sibling of `path`, with the same suffix, that holds an incomplete output."""
    return path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")


def check_folder(path: Path) -> None:
    """Raise OutputError unless a file could be created beside `path` now; a missing folder is created in its parent.

    The check tries to write, since read-only and virtual file systems ignore permission bits.
    """
    if not path.name:
        raise OutputError(f"output '{path}': not a file name; give the name of the file to write")
    probe = partial_path(path)
    try:
        path.parent.mkdir(exist_ok=True)
    except FileNotFoundError as error:
        raise OutputError(f"output {path}: the folder {path.parent.parent} does not exist; make it first") from error
    except (FileExistsError, NotADirectoryError) as error:
        raise OutputError(f"output {path}: {path.parent} is not a folder; choose another place") from error
    except OSError as error:
        raise OutputError(f"output {path}: the folder {path.parent} cannot be made ({_why(error)})") from error
    try:
        probe.touch(exist_ok=False)
        probe.unlink()
    except FileExistsError:
        remove(probe)
    except OSError as error:
        raise OutputError(
            f"output {path}: cannot write into the folder {path.parent} ({_why(error)}); choose another"
        ) from error


def check_file(path: Path) -> None:
    """Raise OutputError unless a file of this name could be written now, as `check_folder` tests it."""
    if path.is_dir():
        raise OutputError(f"output {path}: a folder of that name exists; give the name of a file")
    check_folder(path)


def remove(path: Path) -> None:
    """Remove a file or a folder tree if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def put_in_place(partial: Path, path: Path) -> None:
    """Rename a complete `partial` to `path`, replacing any earlier output."""
    if path.is_dir() and not path.is_symlink():
        old = path.with_name(f".{path.name}.replaced-{os.getpid()}")
        path.rename(old)
        partial.rename(path)
        remove(old)
    else:
        partial.replace(path)


@contextmanager
def staged(path: str | Path) -> Iterator[Path]:
    """Yield a path to write to; rename it to `path` if the block succeeds, else remove it.

    Args:
        path: file or folder that appears when it is complete.

    Raises:
        OutputError: immediately, if the folder cannot be written.

    Examples:
        >>> import pathlib, tempfile, textile_twin_core as ttc
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with ttc.files.staged(pathlib.Path(folder, "report.txt")) as partial:
        ...         _ = partial.write_text("complete")
        ...     [path.name for path in pathlib.Path(folder).iterdir()]
        ['report.txt']
    """
    path = Path(path)
    check_file(path)
    partial = partial_path(path)
    try:
        yield partial
        put_in_place(partial, path)
    except OSError as error:
        raise OutputError(f"output {path}: {_why(error)}") from error
    finally:
        remove(partial)
