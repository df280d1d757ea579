"""The machines: published ones by name, each a short declaration, and a user's own from a file."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from textile_twin_core.errors import MachineError
from textile_twin_core.machines.elliptic_gear_beatup import elliptic_gear_beatup
from textile_twin_core.machines.events import Event
from textile_twin_core.machines.handloom_beatup import handloom_beatup
from textile_twin_core.machines.machine import Machine, ShaftPlace
from textile_twin_core.machines.sensors import Encoder, Scene, Sensors, TorqueSensor
from textile_twin_core.machines.tufting import tufting

if TYPE_CHECKING:
    from textile_twin_core.machines.needle_transfer import NeedleTransferMachine, needle_transfer

AnyMachine: TypeAlias = "Machine | NeedleTransferMachine"

NAMES: tuple[str, ...] = ("tufting", "handloom_beatup", "needle_transfer", "elliptic_gear_beatup")


def __getattr__(name: str) -> Any:
    """The contact machine and what it stands on are imported when they are asked for."""
    if name in ("needle_transfer", "NeedleTransferMachine"):
        return getattr(import_module("textile_twin_core.machines.needle_transfer"), name)
    raise AttributeError(f"module 'textile_twin_core.machines' has no attribute '{name}'")


def _factory(name: str) -> Callable[..., AnyMachine]:
    module = import_module(f"textile_twin_core.machines.{name}")
    factory: Callable[..., AnyMachine] = getattr(module, name)
    return factory


def create(name: str, **overrides: float | str) -> AnyMachine:
    """A published machine by name, with parameters overridden.

    Raises MachineError for an unknown machine or parameter, with the nearest names.
    """
    if name not in NAMES:
        near = get_close_matches(name, NAMES, n=2) or NAMES
        hint = "give the path of a machine file" if Path(name).suffix else f"did you mean {' or '.join(near)}?"
        raise MachineError(f"there is no machine '{name}'; {hint}; machines: {', '.join(NAMES)}")
    factory = _factory(name)
    known = signature(factory).parameters
    for parameter in overrides:
        if parameter not in known:
            near = get_close_matches(parameter, known, n=3) or list(known)[:5]
            raise MachineError(f"machine '{name}' has no parameter '{parameter}'; did you mean {' or '.join(near)}?")
    return factory(**overrides)


__all__ = [
    "NAMES",
    "AnyMachine",
    "Encoder",
    "Event",
    "Machine",
    "NeedleTransferMachine",
    "Scene",
    "Sensors",
    "ShaftPlace",
    "TorqueSensor",
    "create",
    "elliptic_gear_beatup",
    "handloom_beatup",
    "needle_transfer",
    "tufting",
]
