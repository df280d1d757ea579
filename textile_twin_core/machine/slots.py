"""Slots: unique names for every number in a machine's declaration, for reading and replacing it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, get_type_hints

from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.expression.real import Symbolic
from textile_twin_core.machine import AnyMachine, ContactMachine
from textile_twin_core.machine.contact_machine import DrivenElement
from textile_twin_core.machine.drive import load_names
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import (
    Arc,
    Crank,
    EllipticGearPair,
    GearPair,
    Group,
    PRPDyad,
    RigidArm,
    RPPDyad,
    RPRDyad,
    RRPDyad,
    RRRDyad,
)


class Slot(NamedTuple):
    """Place of a number: a field of the machine, an entry in it, an attribute and, in a tuple, an index.

    An index inside a part of a tuple is a path, such as (0, "point_m", 1).
    """

    name: str
    field: str
    entry: int | str
    attribute: str
    place: int | tuple[int | str, ...] | None = None

    @property
    def path(self) -> str:
        """Dotted path of the number into the machine file, as `bodies.l3.mass_kg`."""
        return f"{self.field}.{self.name}"


def slots(machine: AnyMachine) -> tuple[Slot, ...]:
    """List every number of the parts of a machine, in the order of its declaration.

    Raises SceneError for a machine of neither kind.
    """
    if isinstance(machine, Machine):
        return tuple(_of_linkage(machine))
    if isinstance(machine, ContactMachine):
        return tuple(_of_contact(machine))
    raise SceneError(f"machine '{machine.name}' is neither a linkage nor a contact machine: it has no numbers to turn")


def _of_linkage(machine: Machine) -> Iterator[Slot]:
    """Yield the slots of points, groups, bodies, measures and loads."""
    yield from (Slot(f"{name}.{'xy'[k]}_m", "points", name, "", k) for name in machine.points for k in (0, 1))
    for i, group in enumerate(machine.groups):
        yield from (Slot(name, "groups", i, attribute, place) for name, attribute, place in _of_group(group))
    seen: dict[str, int] = {}
    for i, body in enumerate(machine.bodies):
        seen[body.on] = seen.get(body.on, 0) + 1
        name = body.on if seen[body.on] == 1 else f"{body.on}#{seen[body.on]}"
        yield from (Slot(f"{name}.{what}", "bodies", i, what) for what in ("mass_kg", "inertia_kgm2"))
        yield from (
            Slot(f"{name}.centroid_{axis}", "bodies", i, "centroid", k) for k, axis in enumerate(("along", "across"))
        )
    for i, measure in enumerate(machine.measures):
        if isinstance(measure, Arc):
            yield Slot(f"{measure.name}.radius_m", "measures", i, "radius_m")
    for i, (name, load) in enumerate(zip(load_names(machine.loads), machine.loads, strict=True)):
        yield from (Slot(f"{name}.{number}", "loads", i, number) for number in _floats(load))


def _of_contact(machine: ContactMachine) -> Iterator[Slot]:
    """Yield the slots of strokes, bodies, springs, stops and pads; the last stroke always returns to 0."""
    strokes = machine.driven.strokes
    for i in range(len(strokes)):
        name = f"{machine.driven.name}.stroke_{i + 1}"
        yield Slot(f"{name}_start_rad", "driven", i, "start_rad")
        yield Slot(f"{name}_turn_rad", "driven", i, "turn_rad")
        if i < len(strokes) - 1:
            yield Slot(f"{name}_to_m", "driven", i, "to")
    for field in ("bodies", "springs", "stops", "pads"):
        for i, part in enumerate(getattr(machine, field)):
            yield from (Slot(f"{part.name}.{number}", field, i, number) for number in _floats(part))
            for k, coefficient in enumerate(getattr(part, "stiffness", ())):
                if coefficient:
                    yield Slot(f"{part.name}.stiffness_{k + 1}", field, i, "stiffness", k)


def _floats(part: Any) -> list[str]:
    """List the fields that are one number."""
    hints = get_type_hints(type(part))
    return [field.name for field in dataclasses.fields(part) if hints[field.name] is float]


def _of_group(group: Group) -> Iterator[tuple[str, str, int | tuple[int | str, ...] | None]]:
    match group:
        case Crank():
            yield f"{group.name}.length_m", "length_m", None
            yield f"{group.name}.phase_rad", "phase_rad", None
        case RigidArm():
            yield f"{group.name}.length_m", "length_m", None
            yield f"{group.name}.angle_rad", "angle_rad", None
        case RRRDyad():
            yield f"{group.coupler}.length_m", "lengths_m", 0
            yield f"{group.rocker}.length_m", "lengths_m", 1
        case RRPDyad():
            yield f"{group.rod}.length_m", "lengths_m", 0
            yield f"{group.slider}.length_m", "lengths_m", 1
            yield f"{group.slider}.guide_x_m", "guide_point_m", 0
            yield f"{group.slider}.guide_y_m", "guide_point_m", 1
        case RPRDyad():
            yield f"{group.slider}.length_m", "lengths_m", 0
            yield f"{group.lever}.length_m", "lengths_m", 1
            yield f"{group.lever}.offset_m", "offset_m", None
        case RPPDyad():
            yield f"{group.block}.length_m", "lengths_m", 0
            yield f"{group.slider}.length_m", "lengths_m", 1
            yield f"{group.slider}.guide_x_m", "guide_point_m", 0
            yield f"{group.slider}.guide_y_m", "guide_point_m", 1
            yield f"{group.slider}.slot_angle_rad", "slot_angle_rad", None
        case PRPDyad():
            for k, slider in enumerate(group.sliders):
                yield f"{slider}.length_m", "lengths_m", k
                yield f"{slider}.guide_x_m", "guides", (k, "point_m", 0)
                yield f"{slider}.guide_y_m", "guides", (k, "point_m", 1)
        case GearPair():
            yield f"{group.driven}.length_m", "length_m", None
            yield f"{group.driven}.phase_rad", "phase_rad", None
            yield f"{group.driven}.pressure_angle_rad", "pressure_angle_rad", None
        case EllipticGearPair():
            yield f"{group.driver}.axis_ratio", "axis_ratio", None
            yield f"{group.driver}.phase_rad", "phase_rad", None
            yield f"{group.driver}.pressure_angle_rad", "pressure_angle_rad", None
        case _ if dataclasses.is_dataclass(group):
            name = next(str(value) for value in vars(group).values() if isinstance(value, str))
            yield from ((f"{name}.{number}", number, None) for number in _floats(group))


def read(machine: AnyMachine) -> dict[str, float]:
    """Read the machine's numbers by slot."""
    return {name: float(value) for name, value in values_of(machine).items()}


def values_of(machine: AnyMachine) -> dict[str, float]:
    """Return the machine's numbers by slot as they are, symbolic ones too."""
    return {slot.name: _get(machine, slot) for slot in slots(machine)}


def _get(machine: AnyMachine, slot: Slot) -> Any:
    entry = _entries(machine, slot.field)[slot.entry]
    value = getattr(entry, slot.attribute) if slot.attribute else entry
    for step in _path(slot):
        value = value[step] if isinstance(step, int) else getattr(value, step)
    return value


def _path(slot: Slot) -> tuple[int | str, ...]:
    return () if slot.place is None else slot.place if isinstance(slot.place, tuple) else (slot.place,)


def not_negative(machine: AnyMachine) -> dict[str, bool]:
    """Return the slots whose parts reject a negative number, such as a mass, and whether they accept zero."""
    taken = {slot.name: (_takes(machine, slot, -1.0), _takes(machine, slot, 0.0)) for slot in slots(machine)}
    return {name: zero for name, (negative, zero) in taken.items() if not negative}


def _takes(machine: AnyMachine, slot: Slot, value: float) -> bool:
    try:
        _replaced(_entries(machine, slot.field)[slot.entry], slot, value)
    except MachineError:
        return False
    return True


def write(machine: AnyMachine, values: Mapping[str, float]) -> AnyMachine:
    """Return the machine with other numbers in some of its slots.

    Raises:
        SceneError: for an unknown slot.
        MachineError: for an impossible machine.
    """
    changes = changed(machine, values)
    return dataclasses.replace(machine, **changes) if changes else machine


def changed(machine: AnyMachine, values: Mapping[str, float]) -> dict[str, Any]:
    """The fields of the machine's declaration that hold other numbers in some slots, by name, not yet assembled.

    Raises SceneError for a slot that is not there, MachineError where a part cannot be so.
    """
    known = {slot.name: slot for slot in slots(machine)}
    entries: dict[str, dict[int | str, Any]] = {}
    for name, value in values.items():
        slot = known.get(name)
        if slot is None:
            raise SceneError(f"machine '{machine.name}' has no number '{name}'")
        declared = entries.setdefault(slot.field, _entries(machine, slot.field))
        number = value if isinstance(value, Symbolic) else float(value)
        declared[slot.entry] = _replaced(declared[slot.entry], slot, number)
    return {field: _field(machine, field, declared) for field, declared in entries.items()}


def _replaced(entry: Any, slot: Slot, value: float) -> Any:
    """Replace the number in this slot of a part or point. Raises MachineError if that is impossible."""
    return _with(entry, ((slot.attribute,) if slot.attribute else ()) + _path(slot), value)


def _with(entry: Any, path: tuple[int | str, ...], value: float) -> Any:
    """Replace the number at the end of a path in a tuple or part."""
    if not path:
        return value
    step, *rest = path
    if isinstance(step, int):
        return (*entry[:step], _with(entry[step], tuple(rest), value), *entry[step + 1 :])
    return dataclasses.replace(entry, **{step: _with(getattr(entry, step), tuple(rest), value)})


def _entries(machine: AnyMachine, field: str) -> dict[int | str, Any]:
    declared = getattr(machine, field)
    if isinstance(declared, DrivenElement):
        declared = declared.strokes
    return dict(declared) if isinstance(declared, Mapping) else dict(enumerate(declared))


def _field(machine: AnyMachine, field: str, entries: dict[int | str, Any]) -> Any:
    declared = getattr(machine, field)
    if isinstance(declared, DrivenElement):
        return dataclasses.replace(declared, strokes=tuple(entries.values()))
    return entries if isinstance(declared, Mapping) else tuple(entries.values())
