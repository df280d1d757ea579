"""Slots: every number in a machine's declaration by a name of its own, to read and to replace it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, get_type_hints

from textile_twin_core.errors import SceneError
from textile_twin_core.machine.drive import load_names
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import Arc, Crank, EllipticGearPair, Group, RigidArm, RRPDyad, RRRDyad


class Slot(NamedTuple):
    """Where a number stands: a field of the machine, an entry in it, an attribute and, in a tuple, a place."""

    name: str
    field: str
    entry: int | str
    attribute: str
    place: int | None = None


def slots(machine: Machine) -> tuple[Slot, ...]:
    """Every number of points, groups, bodies, measures and loads, in the order of the declaration."""
    found = [Slot(f"{name}.{'xy'[k]}_m", "points", name, "", k) for name in machine.points for k in (0, 1)]
    for i, group in enumerate(machine.groups):
        found += [Slot(name, "groups", i, attribute, place) for name, attribute, place in _of_group(group)]
    seen: dict[str, int] = {}
    for i, body in enumerate(machine.bodies):
        seen[body.on] = seen.get(body.on, 0) + 1
        name = body.on if seen[body.on] == 1 else f"{body.on}#{seen[body.on]}"
        found += [Slot(f"{name}.{what}", "bodies", i, what) for what in ("mass_kg", "inertia_kgm2")]
        found += [
            Slot(f"{name}.centroid_{way}", "bodies", i, "centroid", k) for k, way in enumerate(("along", "across"))
        ]
    for i, measure in enumerate(machine.measures):
        if isinstance(measure, Arc):
            found.append(Slot(f"{measure.name}.radius_m", "measures", i, "radius_m"))
    for i, (name, load) in enumerate(zip(load_names(machine.loads), machine.loads, strict=True)):
        hints = get_type_hints(type(load))
        fields = [f.name for f in dataclasses.fields(load) if hints[f.name] is float]  # type: ignore[arg-type]
        found += [Slot(f"{name.replace(' ', '_')}.{field}", "loads", i, field) for field in fields]
    return tuple(found)


def _of_group(group: Group) -> Iterator[tuple[str, str, int | None]]:
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
        case EllipticGearPair():
            yield f"{group.driver}.axis_ratio", "axis_ratio", None
            yield f"{group.driver}.phase_rad", "phase_rad", None
            yield f"{group.driver}.pressure_angle_rad", "pressure_angle_rad", None


def read(machine: Machine) -> dict[str, float]:
    """The machine's numbers by slot."""
    return {slot.name: float(_get(machine, slot)) for slot in slots(machine)}


def _get(machine: Machine, slot: Slot) -> Any:
    entry: Any = getattr(machine, slot.field)[slot.entry]
    value = getattr(entry, slot.attribute) if slot.attribute else entry
    return value if slot.place is None else value[slot.place]


def write(machine: Machine, values: Mapping[str, float]) -> Machine:
    """The machine with other numbers in some of its slots.

    Raises SceneError for a slot that is not there, MachineError where the machine cannot be so.
    """
    known = {slot.name: slot for slot in slots(machine)}
    entries: dict[str, dict[int | str, Any]] = {}
    for name, value in values.items():
        slot = known.get(name)
        if slot is None:
            raise SceneError(f"machine '{machine.name}' has no number '{name}'")
        held = entries.setdefault(slot.field, _entries(machine, slot.field))
        entry = held[slot.entry]
        new: Any = float(value)
        if slot.place is not None:
            row = list(getattr(entry, slot.attribute) if slot.attribute else entry)
            row[slot.place] = new
            new = tuple(row)
        held[slot.entry] = dataclasses.replace(entry, **{slot.attribute: new}) if slot.attribute else new
    changes = {field: dict(held) if field == "points" else tuple(held.values()) for field, held in entries.items()}
    return dataclasses.replace(machine, **changes) if changes else machine  # type: ignore[arg-type]


def _entries(machine: Machine, field: str) -> dict[int | str, Any]:
    held = getattr(machine, field)
    return dict(held) if field == "points" else dict(enumerate(held))
