"""Outputs of commands: checks of their paths; numbers as JSON, a machine as a file, rows on the terminal."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.files import check_file, staged
from textile_twin_core.machine import Machine

FORMS = ("json", "png", "rrd", "html", "parquet")
"""Outputs that are named by their option, which is the ending of the file, too."""


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


def check_outputs(arguments: argparse.Namespace) -> None:
    """Check the outputs of `FORMS` that are requested; raises as `check_output`."""
    for form in FORMS:
        check_output(f"--{form}", getattr(arguments, form, None), f".{form}")


def save(path: Path | None, write: Callable[[Path], object]) -> None:
    """Write an output, if requested, by a function of its path; it appears when it is complete."""
    if path is not None:
        with staged(path) as partial:
            write(partial)


def keep_input(path: Path | None, read: Path | None) -> None:
    """Raise UsageError if --out is the input file or recording, under any name or link."""
    if path is None or read is None or not path.exists() or not read.exists():
        return
    if path.samefile(read):
        raise UsageError(f"--out {path}: is what is read, and would be lost; choose another name")


def add_outputs(parser: argparse.ArgumentParser, machine_required: bool) -> None:
    """Add --out, --json and --force."""
    parser.add_argument(
        "--out", type=Path, required=machine_required, metavar="FILE", help="write the machine with it (.yaml)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers; overwritten if it exists")
    parser.add_argument("--force", action="store_true", help="overwrite the machine file if it exists")


def check_out(arguments: argparse.Namespace) -> None:
    """Check before any work that the outputs can be written and replace no other file.

    Raises:
        UsageError: An output exists or has a wrong ending.
    """
    check_outputs(arguments)
    check_output("--out", arguments.out, ".yaml", ".yml")
    if arguments.out is None:
        return
    if arguments.out.exists() and not arguments.force:
        raise UsageError(f"--out {arguments.out}: is there already; choose another name, or replace it with --force")


def write_json(arguments: argparse.Namespace, machine: Machine, numbers: Mapping[str, Any]) -> None:
    """Write the numbers with the names of recording and machine, if --json is given."""
    save_json(arguments.json, {"bag": str(arguments.bag), "machine": machine.name, **numbers})


def save_json(path: Path | None, value: object) -> None:
    """Write a value without NaN, if a path is given.

    Raises:
        OutputError: The file cannot be written there.
    """
    save(path, lambda to: to.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8"))


def print_rows(rows: Iterable[tuple[str, str]]) -> None:
    """Print names and values in two columns."""
    rows = list(rows)
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {value}")
