"""A machine built with symbolic parameters, checked against machines built with changed numbers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from textile_twin_core import machines
from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import TwinError
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.c_source import parameters_in, with_parameters
from textile_twin_core.expression.loop import Numpy
from textile_twin_core.expression.real import Symbolic
from textile_twin_core.machine import Machine
from textile_twin_core.machine.drive import load_names
from textile_twin_core.machine.slots import slots

Quantities = Callable[[Machine], list[Expr]]
"""The expressions of a machine that must follow its parameters."""
Build = Callable[[Mapping[str, float]], Machine]
"""Construction of a machine from numbers by name."""

_CHANGE, _GOLDEN = 1e-3, 0.6180339887498949
"""Smallest relative change of a parameter for its check; absolute for a parameter that is 0."""
_AGREE = 1e-9
_PARTS = ("points", "groups", "bodies", "loads", "measures", "gravity_m_s2")
_MOST_TOGETHER = 4
"""Longest tuple of parameters; longer ones are tables."""


@dataclasses.dataclass(frozen=True)
class SymbolicMachine:
    """A machine whose expressions hold parameters.

    Attributes:
        machine: built with symbolic numbers.
        parameters: names and nominal values of the parameters in any quantity.
        fixed: names of numbers that cannot be parameters, since the closed form in use depends on their value.
    """

    machine: Machine
    parameters: Mapping[str, float]
    fixed: tuple[str, ...]


def symbolic_machine(machine: Machine, quantities: Quantities) -> SymbolicMachine:
    """Build a machine with symbolic parameters.

    A published machine has its own parameters. Any other machine has the numbers of its points, groups, bodies, loads
    and measures by their paths (see `Slot.path`), and its directions and gravity by component.

    Args:
        machine: the machine.
        quantities: function that returns the expressions which must follow the parameters.
    """
    build, numbers = _builder(machine)
    return with_symbols(build, numbers, numbers, quantities)


def with_symbols(
    build: Build, numbers: Mapping[str, float], names: Iterable[str], quantities: Quantities
) -> SymbolicMachine:
    """Build a machine with some of its numbers as symbolic parameters.

    To check them, all parameters are changed a little and the quantities compared with those of a machine built with
    the changed numbers. If they differ, each parameter is tried alone, and one that the quantities do not follow
    remains a number.

    Args:
        build: constructs the machine.
        numbers: all its numbers by name.
        names: those that become parameters.
        quantities: function that returns the expressions which must follow the parameters.

    Raises:
        MachineError: for numbers of an impossible machine.
    """
    offered, fixed = {name: numbers[name] for name in names}, list[str]()
    while True:
        made = build({**numbers, **{name: Symbolic.parameter(name, value) for name, value in offered.items()}})
        used = set(parameters_in(quantities(made)))
        offered = {name: value for name, value in offered.items() if name in used}
        check = _Check(offered, numbers, build, quantities(made), quantities)
        if not offered or check.holds(offered):
            return SymbolicMachine(made, offered, tuple(fixed))
        wrong = [name for name in offered if not check.holds([name])] or list(offered)
        fixed += wrong
        offered = {name: value for name, value in offered.items() if name not in wrong}


@dataclasses.dataclass(frozen=True)
class _Check:
    """Check that expressions follow parameter changes as a machine built with the changed values does."""

    offered: Mapping[str, float]
    numbers: Mapping[str, float]
    build: Build
    expressions: Sequence[Expr]
    quantities: Quantities

    def holds(self, names: Iterable[str]) -> bool:
        """Return whether the expressions follow simultaneous changes of these parameters."""
        changes = {name: _changed(self.offered[name], k) for k, name in enumerate(names)}
        try:
            changed = self.build({**self.numbers, **changes})
        except TwinError:
            return False
        inputs = _states(changed)
        open_ones = with_parameters(self.expressions, {name: name for name in self.offered})
        with np.errstate(all="ignore"):
            ours = interpret(open_ones, {**inputs, **self.offered, **changes}, Numpy)
            true = interpret(self.quantities(changed), inputs, Numpy)
        return all(_agree(np.asarray(a), np.asarray(b)) for a, b in zip(ours, true, strict=True))


def _changed(value: float, number: int) -> float:
    """Return another value of a parameter; each changes by its own share, so that no two changes cancel."""
    share = _CHANGE * (1.0 + math.modf(number * _GOLDEN)[0])
    return value * (1.0 + share) if value else share


def _agree(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.all(np.abs(a - b) <= _AGREE * max(float(np.max(np.abs(b))), 1e-9)))


def _states(machine: Machine) -> dict[str, FloatArray]:
    theta = machine.shaft_angles(37) + 0.0123
    speed = machine.nominal_speed_rad_s
    return {"theta": theta, "omega": np.full_like(theta, speed), "alpha": np.full_like(theta, 0.5 * speed**2)}


def _builder(machine: Machine) -> tuple[Build, dict[str, float]]:
    """Return a function that builds the machine from numbers by name, and these numbers."""
    name = machine.name
    if (
        name in machines.NAMES
        and machine.parameters
        and _same_parts(machine, machines.create(name, **machine.parameters))
    ):

        def published(values: Mapping[str, float]) -> Machine:
            made = machines.create(name, **values)
            assert isinstance(made, Machine)
            return made

        return published, dict(machine.parameters)
    numbers: dict[str, float] = {}
    _ = _declared(machine, lambda place, value: numbers.setdefault(place, value))
    return (lambda values: _declared(machine, lambda place, _: values[place])), numbers


def _same_parts(machine: Machine, published: object) -> bool:
    """Return whether a machine has the parts of a published one; a user may have replaced a load or a body."""
    return all(getattr(machine, part) == getattr(published, part, None) for part in _PARTS)


def _declared(machine: Machine, number: Callable[[str, float], float]) -> Machine:
    """Replace each number of the machine by the result of `number` for its dotted place."""
    paths = {slot[1:]: slot.path for slot in slots(machine)}

    def named(field: str, entry: int | str, part: str, attribute: str, place: int | None, value: float) -> float:
        """Number at a place of the declaration, by its path; without one by its part, here the one moved last."""
        component = "" if place is None else f"[{place}]"
        other = f"{field}.{part.rpartition('-')[2]}.{attribute}{component}"
        return number(paths.get((field, entry, attribute, place), other), value)

    names = {
        "groups": [group.name for group in machine.groups],
        "bodies": [body.on for body in machine.bodies],
        "loads": load_names(machine.loads),
        "measures": [measure.name for measure in machine.measures],
    }

    def parts(field: str) -> tuple[Any, ...]:
        declared = zip(names[field], getattr(machine, field), strict=True)
        return tuple(_replaced(part, partial(named, field, k, name)) for k, (name, part) in enumerate(declared))

    changes: dict[str, Any] = {field: parts(field) for field in names}
    changes["points"] = {
        name: tuple(named("points", name, name, "", k, float(value)) for k, value in enumerate(at))
        for name, at in machine.points.items()
    }
    changes["gravity_m_s2"] = tuple(
        number(f"gravity_m_s2[{k}]", float(value)) for k, value in enumerate(machine.gravity_m_s2)
    )
    return dataclasses.replace(machine, **changes)


def _replaced(part: Any, number: Callable[[str, int | None, float], float]) -> Any:
    changed: dict[str, Any] = {}
    for field in dataclasses.fields(part):
        if not field.init or "float" not in str(field.type):
            continue
        value = getattr(part, field.name)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            changed[field.name] = number(field.name, None, float(value))
        elif (
            isinstance(value, tuple)
            and len(value) <= _MOST_TOGETHER
            and all(isinstance(each, (int, float)) for each in value)
        ):
            changed[field.name] = tuple(number(field.name, k, float(each)) for k, each in enumerate(value))
    return dataclasses.replace(part, **changed) if changed else part
