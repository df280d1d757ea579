"""The machine that a node is told to speak of."""

from __future__ import annotations

from pathlib import Path

import textile_twin_core as ttc


def load_machine(name: str) -> ttc.Machine:
    """A machine by its name, or from a machine file.

    Raises:
        MachineError: no such machine, or a file that declares none.
    """
    return ttc.load_machine(name) if Path(name).suffix in (".yaml", ".yml") else ttc.machines.create(name)
