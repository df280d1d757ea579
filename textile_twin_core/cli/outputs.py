"""What commands that learn from a recording write: the numbers as JSON, the machine as a file, rows for a person."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.places import check_output
from textile_twin_core.files import staged
from textile_twin_core.machine import Machine


def add_outputs(parser: argparse.ArgumentParser, machine_required: bool) -> None:
    """--out, --json and --force."""
    parser.add_argument(
        "--out", type=Path, required=machine_required, metavar="FILE", help="write the machine with it (.yaml)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers; is replaced when it is there")
    parser.add_argument("--force", action="store_true", help="replace the machine file when it is there")


def check_out(arguments: argparse.Namespace) -> None:
    """Refuse a machine file that cannot be written, and numbers in place of another file, before any work.

    Raises UsageError.
    """
    check_output("--json", arguments.json, ".json")
    check_output("--out", arguments.out, ".yaml", ".yml")
    if arguments.out is None:
        return
    if arguments.out.exists() and not arguments.force:
        raise UsageError(f"--out {arguments.out}: is there already; choose another name, or replace it with --force")


def write_json(arguments: argparse.Namespace, machine: Machine, numbers: Mapping[str, Any]) -> None:
    """One object with what it is of, where --json asks for it."""
    if arguments.json is not None:
        save_json(arguments.json, {"bag": str(arguments.bag), "machine": machine.name, **numbers})


def save_json(path: Path, value: object) -> None:
    """Write a value that holds no NaN. Raises OutputError when the file cannot be written there."""
    with staged(path) as partial:
        partial.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def print_rows(rows: Iterable[tuple[str, str]]) -> None:
    """Names and values in two columns."""
    rows = list(rows)
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {value}")
