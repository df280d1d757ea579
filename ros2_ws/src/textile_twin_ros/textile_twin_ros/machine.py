"""The machine that a node is told to speak of."""

from __future__ import annotations

from pathlib import Path

import textile_twin_core as ttc
from textile_twin_core.errors import SceneError
from textile_twin_core.machines import AnyMachine


def load_machine(name: str) -> AnyMachine:
    """A machine by its name, or from a machine file.

    Raises:
        MachineError: no such machine, or a file that declares none.
    """
    return ttc.load_machine(name) if Path(name).suffix in (".yaml", ".yml") else ttc.machines.create(name)


def load_linkage(name: str) -> ttc.Machine:
    """A machine that is a linkage, by its name or from a machine file.

    Raises:
        MachineError: no such machine, or a file that declares none.
        SceneError: it is no linkage.
    """
    machine = load_machine(name)
    if not isinstance(machine, ttc.Machine):
        raise SceneError(f"machine '{name}' is no linkage: this node has nothing to show of it; choose another")
    return machine
