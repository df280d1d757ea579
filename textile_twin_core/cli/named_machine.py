"""The machine that a command line names: one of the catalogue with --set applied, or that of a file."""

from __future__ import annotations

import math
from pathlib import Path

from textile_twin_core import machines
from textile_twin_core.cli.doubtful_sizes import doubtful_sizes
from textile_twin_core.cli.mistakes import UsageError, tell
from textile_twin_core.files.machine_file import load_machine_file, published_machine
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.mechanism import Closeness

MACHINE_SUFFIXES = (".yaml", ".yml")


def is_machine(name: str) -> bool:
    """Whether a word names a machine or a machine file."""
    return name in machines.NAMES or name.endswith(MACHINE_SUFFIXES)


def load_machine(name: str, settings: list[str]) -> AnyMachine:
    """The machine of that name or file, with --set applied; dead points and doubtful sizes are told.

    Raises MachineError or UsageError.
    """
    machine = _load(name, settings)
    if isinstance(machine, Machine):
        tell(*doubtful_sizes(machine))
        tell(*(_dead_point(machine.name, found) for found in machine.closeness if found.is_dead_point))
    return machine


def _load(name: str, settings: list[str]) -> AnyMachine:
    is_file = name.endswith(MACHINE_SUFFIXES) or (name not in machines.NAMES and Path(name).exists())
    if is_file and settings:
        raise UsageError("--set goes with a named machine; write the value into the machine file instead")
    if is_file:
        return load_machine_file(name)
    values: dict[str, float | str] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            raise UsageError(f"--set {setting}: write NAME=VALUE")
        try:
            values[key] = float(text)
        except ValueError:
            values[key] = text
    return published_machine(name, values, "--set ")


def _dead_point(machine: str, found: Closeness) -> str:
    change = found.grashof == "change point"
    mend = " or ".join(f"'{branch}'" for branch in found.passing)
    return (
        f"machine '{machine}': group '{found.group}' comes to a {'change' if change else 'dead'} point at a shaft angle"
        f" of {math.degrees(found.theta_rad):.4f} deg, where its motion and the torque are not determined; "
        + (f"branch {mend} goes on smoothly there" if mend else "choose other lengths")
    )


def load_linkage(name: str, settings: list[str]) -> Machine:
    """The same for what works with linkages alone. Raises UsageError for another machine."""
    machine = load_machine(name, settings)
    if not isinstance(machine, Machine):
        raise UsageError(f"machine '{machine.name}' is no linkage, and has no torque to compare; choose another")
    return machine
