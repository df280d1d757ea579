"""The machine that a node is told to speak of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import textile_twin_core as ttc
from textile_twin_core.errors import SceneError
from textile_twin_core.machine import AnyMachine, with_encoder


def load_machine(name: str, encoder: Mapping[str, float] | None = None) -> AnyMachine:
    """A machine by its name, or from a machine file; `encoder`: other settings of its encoder.

    Raises:
        MachineError: no such machine, or a file that declares none, or an encoder that cannot be.
    """
    is_file = Path(name).suffix in (".yaml", ".yml")
    machine: AnyMachine = ttc.load_machine(name) if is_file else ttc.machines.create(name)
    return with_encoder(machine, encoder or {})


def load_linkage(name: str, encoder: Mapping[str, float] | None = None) -> ttc.Machine:
    """The same of a machine that is a linkage.

    Raises:
        MachineError: no such machine, or a file that declares none.
        SceneError: it is no linkage.
    """
    machine = load_machine(name, encoder)
    if not isinstance(machine, ttc.Machine):
        raise SceneError(f"machine '{name}' is no linkage: this node has nothing to show of it; choose another")
    return machine
