"""Design families: a machine whose parameters a designer may change by name, singly or for many designs at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from textile_twin_core import machines
from textile_twin_core.errors import SceneError
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.machine.slots import read, write
from textile_twin_core.synthesis.shaft_design import (
    DIAMETER,
    MOST_STATIONS,
    SHAFT_PARAMETERS,
    STATIONS,
    shaft_values,
    with_shaft,
)

_UNITS = {
    "N_mm3": "N/mm³",
    "N_mm2": "N/mm²",
    "N_mm": "N/mm",
    "Nm_rad": "N m/rad",
    "Ns_m": "N s/m",
    "N_m": "N/m",
    "m_s2": "m/s²",
    "kgm2": "kg m²",
    "Nms": "N m s",
    "rad": "rad",
    "kg": "kg",
    "Nm": "N m",
    "N": "N",
    "m": "m",
    "s": "s",
}
"""Units by the suffix of a name, longer suffixes first."""
_SPAN = 0.5
_ANGLE_SPAN = math.radians(45.0)
_LEFT_OUT = ("encoder_", "torque_sensor_")
_NOT_SEARCHED = ("gravity_m_s2",)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a design: value (None if the paper gives none), unit, and the range of its slider.

    `text` is its name in words, without the unit. `whole` marks an integer, such as 0 or 1 for no or yes.
    """

    name: str
    value: float | None
    unit: str
    low: float
    high: float
    text: str = ""
    whole: bool = False


def _parameter(name: str, value: float | None, whole: bool = False) -> Parameter:
    ending, unit = next(((end, u) for end, u in _UNITS.items() if name.endswith(f"_{end}")), ("", ""))
    text = name.removesuffix(f"_{ending}").replace("_", " ")
    if whole:
        return Parameter(name, value, "", 0.0, 1.0, text, True)
    v = 1.0 if value is None and unit == "kg" else (value or 0.0)
    if unit == "rad":
        low, high = v - _ANGLE_SPAN, v + _ANGLE_SPAN
    elif "restitution" in name:
        low, high = 0.0, 1.0
    elif v == 0.0:
        low, high = (-0.05, 0.05) if unit == "m" else (-1.0, 1.0) if unit == "" else (0.0, 1.0)
    else:
        low, high = sorted((v * (1.0 - _SPAN), v * (1.0 + _SPAN)))
    if name.endswith("axis_ratio"):
        high = min(high, 1.0)
    return Parameter(name, value, unit, low, high, text)


def _shaft_parameters(machine: AnyMachine) -> tuple[Parameter, ...]:
    """Return diameter and stations of an elastic main shaft, which a search leaves unchanged."""
    values = shaft_values(machine)
    found = [_parameter(DIAMETER, values[DIAMETER])] if DIAMETER in values else []
    if STATIONS in values:
        text = STATIONS.replace("_", " ")
        found.append(Parameter(STATIONS, values[STATIONS], "", 1.0, float(MOST_STATIONS), text, True))
    return tuple(found)


class DeclaredFamily:
    """A user's own machine, whose parameters are the numbers of its declaration."""

    def __init__(self, machine: AnyMachine) -> None:
        self.base = machine
        self.name = machine.name
        own = tuple(_parameter(name, value) for name, value in read(machine).items())
        self.parameters = own + _shaft_parameters(machine)

    def machine(self, values: Mapping[str, float]) -> AnyMachine:
        """Build the machine with these values. Raises MachineError if impossible, SceneError for an unknown name."""
        own = {name: value for name, value in values.items() if name not in SHAFT_PARAMETERS}
        return with_shaft(write(self.base, own), values)

    @property
    def searchable(self) -> tuple[str, ...]:
        """Parameters that may differ between designs of a search."""
        return tuple(p.name for p in self.parameters if p.name not in SHAFT_PARAMETERS)


class PublishedFamily:
    """A published machine with its paper's parameters; a user's sensors, scene and shaft places are preserved."""

    def __init__(self, machine: AnyMachine, kind: str) -> None:
        self.base, self.kind, self.name = machine, kind, machine.name
        known = machines.parameters_of(kind)
        values = {n: machine.parameters.get(n, default) for n, default in known.items() if not n.startswith(_LEFT_OUT)}
        self.parameters = tuple(
            _parameter(n, v, isinstance(known[n], bool))
            for n, v in values.items()
            if v is None or isinstance(v, (int, float))
        )
        self.parameters += _shaft_parameters(machine)
        self._known = set(values) | set(shaft_values(machine))

    def machine(self, values: Mapping[str, float]) -> AnyMachine:
        """Build the machine with these values. Raises MachineError if impossible, SceneError for an unknown name."""
        for name in values:
            if name not in self._known:
                raise SceneError(f"machine '{self.kind}' has no parameter '{name}'")
        own = {name: value for name, value in values.items() if name not in SHAFT_PARAMETERS}
        made = machines.create(self.kind, **self.base.choices, **{**self.base.parameters, **own})
        kept: dict[str, Any] = {"name": self.base.name, "sensors": self.base.sensors, "scene": self.base.scene}
        if isinstance(made, Machine) and isinstance(self.base, Machine):
            if self.base.missing_for_torque and not made.missing_for_torque:
                kept.pop("scene")
            kept |= {"linkages": self.base.linkages, "shaft": self.base.shaft}
        changed = {name: value for name, value in kept.items() if getattr(made, name) != value}
        return with_shaft(replace(made, **changed) if changed else made, values)

    @property
    def searchable(self) -> tuple[str, ...]:
        """Parameters that may differ between designs of a search."""
        valued = [p.name for p in self.parameters if p.value is not None and not p.whole]
        return tuple(name for name in valued if name not in (*_NOT_SEARCHED, *SHAFT_PARAMETERS))


Family = DeclaredFamily | PublishedFamily


def family_of(machine: AnyMachine) -> Family:
    """Return a machine's family: that of its paper if published, else that of its declaration."""
    for kind in machines.NAMES:
        known, given = set(machines.parameters_of(kind)), set(machine.parameters)
        if not given or not given <= known or type(machines.create(kind)) is not type(machine):
            continue
        family = PublishedFamily(machine, kind)
        if machine.has_history or family.machine({}) == machine:
            return family
    return DeclaredFamily(machine)
