"""Designs as files: the machine file that every other command takes, and the file in which a design is shared."""

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
    """The design as a machine file (YAML). Raises MachineError where its values make no machine."""
    document: dict[str, Any] = _document(design.machine())
    text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=110)
    return text


def design_text(design: Design, task: dict[str, Any] | None = None) -> str:
    """The design as a file to share (JSON): machine, values, speed, dwell, and what is searched for."""
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
    """A design, and what is searched for, from either kind of file.

    Raises MachineError or SceneError that say what is wrong in it.
    """
    if len(text) > _LARGEST:
        raise SceneError(f"{name}: more than 2 MB is no machine file")
    braced = text.lstrip().startswith("{")  # as a short machine file may be, too
    if not (braced and (name.endswith(".json") or '"format"' in text)):
        return Design.of(_machine(text, name)), {}
    try:
        shared = json.loads(text)
    except json.JSONDecodeError as error:
        raise SceneError(f"{name}: no JSON: {error}") from None
    if not isinstance(shared, dict) or shared.get("format") != _FORMAT:
        raise SceneError(f"{name}: is no shared design of textile-twin")
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
            raise SceneError(f"{name[:60]!r}: is no name that a file can have, or its text is none") from None
        try:
            return load_machine_file(path)
        except MachineError as error:
            raise MachineError(str(error).replace(str(path), name)) from None
