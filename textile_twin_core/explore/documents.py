"""Designs as files: the machine file of the other commands, and the file that shares a design."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path
from typing import Any

import yaml

from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.explore.design import Design, check_number
from textile_twin_core.files.machine_file import load_machine_file, machine_document
from textile_twin_core.machine import AnyMachine

_FORMAT = "textile-twin design 1"
_LARGEST = 2_000_000


def machine_text(design: Design) -> str:
    """Format the design as a machine file (YAML).

    Raises:
        MachineError: The values give no valid machine.
    """
    document: dict[str, Any] = _document(design.machine())
    text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=110)
    return text


def design_text(design: Design, task: dict[str, Any] | None = None) -> str:
    """Format the design as a file to share (JSON): machine, values, speed, dwell, and task of the search."""
    shared = {
        "format": _FORMAT,
        "machine": _document(design.family.base),
        "values": dict(design.values),
        "rpm": design.speed_rad_s * 30.0 / math.pi,
        "dwell_within_m": design.dwell_within_m,
        "task": task or {},
    }
    return json.dumps(shared, indent=1) + "\n"


def read_design(text: str, name: str = "the file") -> tuple[Design, dict[str, Any]]:
    """Read a design and the task of its search from either kind of file.

    Raises:
        MachineError: The machine in the file is not valid.
        SceneError: The file is not valid.
    """
    if len(text) > _LARGEST:
        raise SceneError(f"{name}: a machine file has at most 2 MB")
    braced = text.lstrip().startswith("{")  # a short machine file may start like this, too
    if not (braced and (name.endswith(".json") or '"format"' in text)):
        return Design.of(_machine(text, name)), {}
    try:
        shared = json.loads(text)
    except json.JSONDecodeError as error:
        raise SceneError(f"{name}: is not valid JSON: {error}") from None
    if not isinstance(shared, dict) or shared.get("format") != _FORMAT:
        raise SceneError(f"{name}: is not a shared design of textile-twin")
    design = Design.of(_machine(yaml.safe_dump(shared.get("machine")), name))
    values, task = shared.get("values") or {}, shared.get("task") or {}
    if not isinstance(values, dict) or not isinstance(task, dict):
        raise SceneError(f"{name}: values and task must be objects")
    rpm, within = shared.get("rpm"), shared.get("dwell_within_m")
    check_number(rpm, f"{name}: rpm")
    return design.changed(values).at_speed(float(rpm) * math.pi / 30.0).dwelling_within(within), task  # type: ignore[arg-type]


def _document(machine: AnyMachine) -> dict[str, Any]:
    return machine_document(machine)


def _machine(text: str, name: str) -> AnyMachine:
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        path = Path(folder) / (Path(name).stem + ".yaml")
        try:
            path.write_text(text, encoding="utf-8")
        except (OSError, ValueError):
            raise SceneError(f"{name[:60]!r}: cannot be stored as a file; use another name, and plain text") from None
        try:
            return load_machine_file(path)
        except MachineError as error:
            raise MachineError(str(error).replace(str(path), name)) from None
