"""Machine files: YAML declarations with the same groups, bodies and loads as the published machines."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_type_hints

import yaml

from textile_twin_core import machines, mechanism
from textile_twin_core.dynamics import Body, loads
from textile_twin_core.errors import MachineError
from textile_twin_core.files.atomic import staged
from textile_twin_core.files.declarations import build, convert, list_at, mapping_at, plain, unknown
from textile_twin_core.files.strict_yaml import read_yaml
from textile_twin_core.machine import (
    AnyMachine,
    ContactMachine,
    EvenShaft,
    Machine,
    MainShaft,
    Scene,
    Sensors,
    ShaftPlace,
)
from textile_twin_core.machine.declared import type_tag
from textile_twin_core.machine.sizes import check_size, computable
from textile_twin_core.mechanism import MAIN_SHAFT, Linkage
from textile_twin_core.mechanism.linkage import BEYOND_DYADS


def _tagged(module: Any, method: str) -> dict[str, type]:
    """Collect the declarations of a module by a file's word for them."""
    return {
        type_tag(cls): cls
        for cls in vars(module).values()
        if isinstance(cls, type) and dataclasses.is_dataclass(cls) and hasattr(cls, method)
    }


GROUPS = _tagged(mechanism, "solve")
MEASURES = _tagged(mechanism, "displacement")
LOADS = _tagged(loads, "crossings")

_MASS_BY_DENSITY = {"density_kg_m3", "width_m", "thickness_m"}
_DEFAULT: dict[str, Any] = {
    "sensors": Sensors(),
    "linkages": (ShaftPlace(),),
    "shaft": None,
    "tolerances": {},
    "scene": Scene(),
}
_APART = tuple(_DEFAULT)
"""Fields that a user may set on any machine, independent of its geometry."""
_NOT_DECLARED = ("parameters", "choices", "missing_for_torque")
"""Fields that follow from the name of a machine of the catalogue and are not written."""
_ON_A_PUBLISHED_MACHINE = ("machine", "name", "parameters", "sensors", "linkages", "shaft", "tolerances", "scene")


def load_machine_file(path: str | Path) -> AnyMachine:
    r"""Load the machine that a YAML file declares; a machine without a name is named after the file.

    The file is a declaration from groups:

        points: {O: [0, 0], C: [0.3, 0]}
        groups:
          - {type: crank, name: crank, at: O, end: A, length_m: 0.06}
          - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [0.2, 0.23], branch: left}
        bodies: {l2: {mass_kg: 0.4, inertia_kgm2: 0.0015, centroid: [0.5, 0]}}
        measures: [{type: arc, name: sley, link: l3, radius_m: 0.23}]

    or bodies between springs, stops and pads (see ContactMachine):

        driven: {name: stick, strokes: [{start_rad: 0, turn_rad: 1, to: 0.2}, {start_rad: 3, turn_rad: 1, to: 0}]}
        bodies: [{name: picker, mass_kg: 0.3}]
        springs: [{name: strap, lower: stick, upper: picker, stiffness_N_m: 20000}]

    or a published machine with the user's own numbers:

        machine: tufting
        parameters: {backing_force_N: 900}
        sensors: {encoder: {zero_rad: 0.1}, torque: {delay_s: 0.002}}

    Args:
        path: the YAML file.

    Returns:
        The machine: a Machine, or a ContactMachine.

    Raises:
        MachineError: with the file and the key, for a file that cannot be read or a declaration that is wrong.

    Examples:
        >>> import pathlib, tempfile, textile_twin_core as ttc
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = pathlib.Path(folder, "mill.yaml")
        ...     _ = file.write_text("machine: tufting\nparameters: {backing_force_N: 900}")
        ...     ttc.load_machine(file).parameters["backing_force_N"]
        900.0
    """
    path = Path(path)
    document = read_yaml(path, MachineError)
    try:
        entries = mapping_at(document, "the file")
        with computable("the machine"):
            machine = _published(entries) if "machine" in entries else _declared(entries, path)
        _check_scene(machine)
        return machine
    except MachineError as error:
        raise MachineError(f"{path}: {error}") from error


def _check_scene(machine: AnyMachine) -> None:
    """Raise MachineError for a scene without outputs, or with one that the machine does not have."""
    if not machine.scene.outputs:
        raise MachineError("scene.outputs: names none; leave it out for the torque, or name some")
    for name in machine.scene.outputs:
        if name not in machine.outputs:
            near = get_close_matches(name, machine.outputs, n=3) or machine.outputs[:6]
            raise MachineError(f"scene.outputs: there is no output '{name}'; did you mean {' or '.join(near)}?")


def published_machine(name: str, values: Mapping[str, Any], place: str) -> AnyMachine:
    """Build a published machine with the user's values for its parameters, each converted to the parameter's type.

    `place` is the place of the values in messages. Raises MachineError for a value of the wrong kind, and as
    `machines.create` does.
    """
    known = machines.parameters_of(name) if name in machines.NAMES else {}
    for key, value in values.items():
        if key in known:
            word = isinstance(known[key], str)
            convert(value, str if word else float, f"{place}{key}")
            if word and not isinstance(value, str):
                raise MachineError(f"{place}{key}: must be a word, not {value!r}")
    return machines.create(name, **values)


def _published(entries: dict[str, Any]) -> AnyMachine:
    for key in entries:
        if key not in _ON_A_PUBLISHED_MACHINE:
            raise MachineError(f"{key}: {unknown('key', key, list(_ON_A_PUBLISHED_MACHINE))}")
    values = _mapping(entries, "parameters")
    machine = published_machine(str(entries["machine"]), values, "parameters.")
    changes: dict[str, Any] = {
        key: reader(entries[key], key)
        for key, reader in _TOP_LEVEL.items()
        if key in entries and key in _ON_A_PUBLISHED_MACHINE
    }
    for key in ("linkages", "shaft", "tolerances"):
        if key in changes and not isinstance(machine, Machine):
            raise MachineError(f"{key}: machine '{machine.name}' is no linkage; leave this out")
    changes |= _shaft_and_places(changes)
    return dataclasses.replace(machine, **changes) if changes else machine


def _declared(entries: dict[str, Any], path: Path) -> AnyMachine:
    if "parameters" in entries:
        raise MachineError("parameters: are those of a published machine; name it with 'machine: ..'")
    return _contact(entries, path) if "driven" in entries else _linkage(entries, path)


def _contact(entries: dict[str, Any], path: Path) -> ContactMachine:
    """Build bodies between springs, stops and pads; the file's keys are the fields."""
    hints = {name: hint for name, hint in get_type_hints(ContactMachine).items() if name not in _NOT_DECLARED}
    for key in entries:
        if key not in hints:
            raise MachineError(f"{key}: {unknown('key', key, list(hints))}")
    declared: dict[str, Any] = {"name": path.stem, "bodies": ()}
    return ContactMachine(**declared | {key: convert(entry, hints[key], key) for key, entry in entries.items()})


def _linkage(entries: dict[str, Any], path: Path) -> Machine:
    plain_fields = {name: hint for name, hint in get_type_hints(Machine).items() if name not in _NOT_PLAIN}
    keys = [*_TOP_LEVEL, *plain_fields, "bodies", "machine"]
    for key in entries:
        if key not in keys:
            raise MachineError(f"{key}: {unknown('key', key, keys)}")
    for key in ("points", "groups"):
        if key not in entries:
            raise MachineError(f"key '{key}' is missing; a machine needs ground points and groups")
    declared: dict[str, Any] = {"name": path.stem}
    declared |= {key: read(entries[key], key) for key, read in _TOP_LEVEL.items() if key in entries}
    declared |= _shaft_and_places(declared)
    declared |= {key: convert(entries[key], hint, key) for key, hint in plain_fields.items() if key in entries}
    declared["bodies"] = _bodies(_mapping(entries, "bodies"), Linkage(declared["points"], declared["groups"]))
    return Machine(**declared)


def _mapping(entries: dict[str, Any], key: str) -> dict[str, Any]:
    """Return the mapping under an optional key, which may be empty."""
    return {} if entries.get(key) is None else mapping_at(entries[key], key)


def _several(kinds: Mapping[str, type]) -> Callable[[Any, str], tuple[Any, ...]]:
    """Return a reader of a list of declarations, each with its type."""

    def read(value: Any, place: str) -> tuple[Any, ...]:
        out = []
        for k, entry in enumerate(list_at(value, place)):
            at = f"{place}[{k}]"
            entries = mapping_at(entry, at)
            tag = str(entries.pop("type", ""))
            if not tag:
                raise MachineError(f"{at}: key 'type' is missing; available: {', '.join(kinds)}")
            if "triad" in tag.lower():
                raise MachineError(f"{at}.type: no type '{tag}'; its links are no dyad: {BEYOND_DYADS}")
            if tag not in kinds:
                raise MachineError(f"{at}.type: {unknown('type', tag, list(kinds))}")
            out.append(build(kinds[tag], entries, at))
        return tuple(out)

    return read


def _places(value: Any, place: str) -> tuple[ShaftPlace, ...]:
    return tuple(build(ShaftPlace, entry, f"{place}[{k}]") for k, entry in enumerate(list_at(value, place)))


def _shaft(value: Any, place: str) -> MainShaft | EvenShaft:
    """Read an elastic shaft, either by stations and pieces or as a uniform bar with a number of stations."""
    entries = mapping_at(value, place)
    even = "diameter_m" in entries or isinstance(entries.get("stations"), int)
    shaft: MainShaft | EvenShaft = build(EvenShaft if even else MainShaft, entries, place)
    return shaft


def _shaft_and_places(declared: Mapping[str, Any]) -> dict[str, Any]:
    """Expand the short form of a shaft, and distribute the linkages over it."""
    shaft = declared.get("shaft")
    if not isinstance(shaft, EvenShaft):
        return {}
    try:
        return {"shaft": shaft.main_shaft(), "linkages": shaft.places(declared.get("linkages", ()))}
    except MachineError as error:
        raise MachineError(f"shaft: {error}") from error


_TOP_LEVEL: dict[str, Callable[[Any, str], Any]] = {
    "name": lambda value, place: convert(value, str, place),
    "groups": _several(GROUPS),
    "measures": _several(MEASURES),
    "loads": _several(LOADS),
    "sensors": lambda value, place: build(Sensors, value, place),
    "linkages": _places,
    "shaft": _shaft,
    "tolerances": lambda value, place: {
        path: convert(entry, float, f"{place}.{path}") for path, entry in mapping_at(value, place).items()
    },
    "scene": lambda value, place: build(Scene, value, place),
}

_NOT_PLAIN = (*_TOP_LEVEL, "bodies", *_NOT_DECLARED)
"""Fields of a machine that a file writes in a special form, or not at all."""


def _bodies(by_link: dict[str, Any], linkage: Linkage) -> tuple[Body, ...]:
    """Read bodies by link, one or a list: mass and inertia, or density and section of a straight bar."""
    links = linkage.solved.links
    out: list[Body] = []
    for link, entry in by_link.items():
        if link not in links and link != MAIN_SHAFT:
            raise MachineError(f"bodies.{link}: {unknown('link', link, [*links, MAIN_SHAFT])}")
        for k, body in enumerate(entry if isinstance(entry, list) else [entry]):
            place = f"bodies.{link}[{k}]" if isinstance(entry, list) else f"bodies.{link}"
            if isinstance(body, dict) and link in links and _MASS_BY_DENSITY & body.keys():
                out.append(_bar(mapping_at(body, place), place, link, links[link].length))
            else:
                out.append(build(Body, body, place, on=link))
    return tuple(out)


def _bar(entries: dict[str, Any], place: str, link: str, length_m: float) -> Body:
    for key in entries:
        if key not in _MASS_BY_DENSITY:
            raise MachineError(
                f"{place}.{key}: not together with a density; a bar has {', '.join(sorted(_MASS_BY_DENSITY))}"
            )
    for key in sorted(_MASS_BY_DENSITY - entries.keys()):
        raise MachineError(f"{place}: key '{key}' is missing; a bar has {', '.join(sorted(_MASS_BY_DENSITY))}")
    sizes = {key: convert(entry, float, f"{place}.{key}") for key, entry in entries.items()}
    return Body.bar(link, length_m, **sizes)


def machine_document(machine: AnyMachine) -> dict[str, Any]:
    """Return a file's content for this machine: catalogue name and parameters if possible, else its parts."""
    base = _catalogue_base(machine)
    apart = [key for key in _APART if hasattr(machine, key)]
    usual = _DEFAULT if base is None else {key: getattr(base, key) for key in apart}
    changed = {key: plain(getattr(machine, key)) for key in apart if getattr(machine, key) != usual[key]}
    if base is not None:
        name = {} if machine.name == base.name else {"name": machine.name}
        given = {**machine.choices, **machine.parameters}
        usually = {**base.choices, **base.parameters}
        parameters = plain({key: value for key, value in given.items() if value != usually[key]})
        return {"machine": base.name, **name, **({"parameters": parameters} if parameters else {}), **changed}
    document: dict[str, Any] = plain(machine, leave_out=(*_APART, *_NOT_DECLARED))
    if isinstance(machine, Machine):
        document |= _linkage_parts(machine)
    return document | changed


def _linkage_parts(machine: Machine) -> dict[str, Any]:
    """Return groups, measures and loads with their types, and bodies by link."""
    document: dict[str, Any] = {}
    for key in ("groups", "measures", "loads"):
        if getattr(machine, key):
            document[key] = [{"type": type_tag(type(entry)), **plain(entry)} for entry in getattr(machine, key)]
    bodies: dict[str, list[Any]] = {}
    for body in machine.bodies:
        bodies.setdefault(body.on, []).append(plain(body, leave_out=("on",)))
    if bodies:
        document["bodies"] = {link: entries[0] if len(entries) == 1 else entries for link, entries in bodies.items()}
    return document


def _catalogue_base(machine: AnyMachine) -> AnyMachine | None:
    """Return the catalogue machine equal to this one apart from name, parameters, sensors, scene and places."""
    for name in machines.NAMES:
        base = machines.create(name)
        if type(base) is type(machine) and base.parameters.keys() == machine.parameters.keys():
            again = machines.create(name, **machine.choices, **machine.parameters)
            kept = {key: getattr(machine, key) for key in ("name", *_APART) if hasattr(machine, key)}
            if dataclasses.replace(again, **kept) == machine:
                return base
    return None


def _check_sizes(entry: Any, place: str) -> None:
    """Raise MachineError for a number in a document that the reader would reject."""
    if isinstance(entry, dict):
        for key, value in entry.items():
            _check_sizes(value, f"{place}{'' if place.endswith(' ') else '.'}{key}")
    elif isinstance(entry, list):
        for k, value in enumerate(entry):
            _check_sizes(value, f"{place}[{k}]")
    elif isinstance(entry, float):
        check_size(entry, place)


def save_machine_file(machine: AnyMachine, path: str | Path) -> None:
    """Write a machine as a YAML file that `load_machine_file` reads.

    Args:
        machine: the machine.
        path: the YAML file.

    Raises:
        OutputError: for a place that cannot be written.
        MachineError: for a number that no machine file may have.

    Examples:
        >>> import pathlib, tempfile, textile_twin_core as ttc
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = pathlib.Path(folder, "mill.yaml")
        ...     ttc.files.save_machine_file(ttc.machines.tufting(backing_force_N=900.0), file)
        ...     ttc.load_machine(file).parameters["backing_force_N"]
        900.0
    """
    document = machine_document(machine)
    _check_sizes(document, f"{path}: not written: ")
    text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=110)
    with staged(path) as partial:
        partial.write_text(text, encoding="utf-8")
