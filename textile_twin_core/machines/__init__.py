"""Catalogue of published machines, by name.

The building blocks of a declaration (Machine, Sensors, ..) are exported here as well.

Examples:
    >>> import textile_twin_core as ttc
    >>> ttc.machines.tufting(backing_force_N=900.0).name
    'tufting'
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

from textile_twin_core.errors import MachineError
from textile_twin_core.lazy import listing_of
from textile_twin_core.machine import (
    ENCODER_OPTIONS,
    AnyMachine,
    ContactMachine,
    DrivenElement,
    Encoder,
    EvenShaft,
    Event,
    Machine,
    MainShaft,
    Scene,
    Sensors,
    ShaftDrive,
    ShaftPiece,
    ShaftPlace,
    Station,
    TorqueSensor,
    with_encoder,
)
from textile_twin_core.machine.sizes import check_size, computable
from textile_twin_core.machines.elliptic_gear_beatup import elliptic_gear_beatup
from textile_twin_core.machines.handloom_beatup import handloom_beatup
from textile_twin_core.machines.needle_transfer import needle_transfer
from textile_twin_core.machines.sensor_parameters import SENSOR_DEFAULTS
from textile_twin_core.machines.tufting import tufting

_FACTORIES: Mapping[str, Callable[..., AnyMachine]] = {
    "tufting": tufting,
    "handloom_beatup": handloom_beatup,
    "needle_transfer": needle_transfer,
    "elliptic_gear_beatup": elliptic_gear_beatup,
}
NAMES: tuple[str, ...] = tuple(_FACTORIES)


def parameters_of(name: str) -> dict[str, Any]:
    """Return the parameters of a published machine with their defaults.

    Args:
        name: name of the machine in the catalogue.

    Returns:
        Parameters in order, those of the sensors last, in SI units.

    Raises:
        MachineError: for an unknown machine, with the nearest names.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.parameters_of("tufting")["backing_force_N"]
        1000.0
    """
    known = signature(_FACTORIES[name]).parameters.values()
    own = {each.name: each.default for each in known if each.kind is Parameter.KEYWORD_ONLY}
    return {**own, **SENSOR_DEFAULTS} if len(own) < len(known) else own


def create(name: str, **overrides: float | str) -> AnyMachine:
    """Build a published machine by name.

    Args:
        name: name of the machine in the catalogue.
        **parameters: parameters that differ from their defaults (see `parameters_of`).

    Raises:
        MachineError: for an unknown machine or parameter, with the nearest names, and for sizes beyond any machine.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.create("tufting", backing_force_N=900.0).parameters["backing_force_N"]
        900.0
    """
    factory = _FACTORIES.get(name)
    if factory is None:
        near = get_close_matches(name, NAMES, n=2) or NAMES
        hint = "give the path of a machine file" if Path(name).suffix else f"did you mean {' or '.join(near)}?"
        raise MachineError(f"there is no machine '{name}'; {hint}; machines: {', '.join(NAMES)}")
    known = parameters_of(name)
    for parameter, value in overrides.items():
        if parameter not in known:
            near = get_close_matches(parameter, known, n=3) or list(known)[:5]
            raise MachineError(f"machine '{name}' has no parameter '{parameter}'; did you mean {' or '.join(near)}?")
        if isinstance(value, (int, float)):
            check_size(value, f"machine '{name}': {parameter}")
    with computable(f"machine '{name}'"):
        return factory(**overrides)


__all__ = [
    "ENCODER_OPTIONS",
    "NAMES",
    "AnyMachine",
    "ContactMachine",
    "DrivenElement",
    "Encoder",
    "EvenShaft",
    "Event",
    "Machine",
    "MainShaft",
    "Scene",
    "Sensors",
    "ShaftDrive",
    "ShaftPiece",
    "ShaftPlace",
    "Station",
    "TorqueSensor",
    "create",
    "elliptic_gear_beatup",
    "handloom_beatup",
    "needle_transfer",
    "parameters_of",
    "tufting",
    "with_encoder",
]

__dir__ = listing_of(__all__)
