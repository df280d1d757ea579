"""Machine named on a command line: from the catalogue with --set applied, or from a file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from textile_twin_core import machines
from textile_twin_core.cli.mistakes import UsageError, tell
from textile_twin_core.files.machine_file import load_machine_file, published_machine
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.mechanism import Closeness

MACHINE_SUFFIXES = (".yaml", ".yml")
_LONGEST_M = 20.0
"""Longest plausible link; a longer one was probably given in millimetres."""
_WIDEST = 5.0
"""Largest plausible radius of gyration over link length; an inertia in kg cm2 or kg mm2 gives 100 or 1000."""


def is_machine(name: str) -> bool:
    """Return true if a word names a machine or a machine file."""
    return name in machines.NAMES or name.endswith(MACHINE_SUFFIXES)


def load_machine(name: str, settings: list[str]) -> AnyMachine:
    """Load the machine of that name or file, with --set applied; print notices on dead points and implausible sizes.

    Raises:
        MachineError: The machine is not valid.
        UsageError: The name or a value is not valid.
    """
    machine = _load(name, settings)
    if isinstance(machine, Machine):
        tell(*_implausible_sizes(machine))
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
        + (f"branch {mend} passes it smoothly" if mend else "choose other lengths")
    )


def load_linkage(name: str, settings: list[str]) -> Machine:
    """Load a machine that must be a linkage.

    Raises:
        UsageError: The machine is not a linkage.
    """
    machine = load_machine(name, settings)
    if not isinstance(machine, Machine):
        raise UsageError(f"machine '{machine.name}' is no linkage, and has no torque to compare; choose another")
    return machine


def _implausible_sizes(machine: Machine) -> Iterator[str]:
    """Describe the longest link if it is too long, and each body that is too wide for its link."""
    links = machine.linkage.solved.links
    longest = max(links.values(), key=lambda link: abs(link.length))
    if abs(longest.length) > _LONGEST_M:
        yield (
            f"machine '{machine.name}': link '{longest.name}' is {abs(longest.length):g} m long: lengths and points are"
            " in metres"
        )
    for body in machine.bodies:
        length = 0.0 if body.is_flywheel else abs(links[body.on].length)
        if length and body.mass_kg and (radius := math.sqrt(body.inertia_kgm2 / body.mass_kg)) > _WIDEST * length:
            yield (
                f"machine '{machine.name}': {body.mass_kg:g} kg with an inertia of {body.inertia_kgm2:g} kg m2 on link"
                f" '{body.on}' lie {radius:.3g} m from their centroid, and the link is {length:.3g} m long: inertias"
                " are in kg m2 about the centroid"
            )
