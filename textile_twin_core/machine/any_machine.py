"""Either kind of machine: a linkage, or bodies between springs and stops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias, TypeVar

from textile_twin_core.machine.contact_machine import ContactMachine
from textile_twin_core.machine.machine import Machine

AnyMachine: TypeAlias = Machine | ContactMachine
SomeMachine = TypeVar("SomeMachine", bound=AnyMachine)


def with_encoder(machine: SomeMachine, settings: Mapping[str, float]) -> SomeMachine:
    """Return the machine with other encoder settings.

    Args:
        machine: the machine.
        settings: values by name (see `ENCODER_OPTIONS`).

    Raises:
        MachineError: for impossible settings.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.with_encoder(ttc.machines.tufting(), {"teeth": 60}).sensors.encoder.teeth
        60
    """
    if not settings:
        return machine
    encoder = replace(machine.sensors.encoder, **settings)  # type: ignore[arg-type]
    return replace(machine, sensors=replace(machine.sensors, encoder=encoder))
