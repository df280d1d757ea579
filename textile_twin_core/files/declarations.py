"""Strict conversion between dataclasses and the plain values of a file; errors name the place in the file."""

from __future__ import annotations

import dataclasses
import re
import types
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from textile_twin_core.errors import MachineError
from textile_twin_core.machine.sizes import check_size

_DIGITS = re.compile(r"[0-9]+([.][0-9]*)?([eE][+-]?[0-9]+)?$")
_SHOWN = 60
_KEY_OF_FIELD = {"from_point": "from", "to_point": "to", "from_station": "from", "to_station": "to"}


def unknown(what: str, given: str, known: list[str]) -> str:
    """Word the message on an unknown key, with the nearest names, or a note on digits read as text."""
    if _DIGITS.match(given):
        return f"unknown {what} '{given}'; digits behind a decimal comma? write numbers with a point, as 0.6"
    near = get_close_matches(given, known, n=2, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"available: {', '.join(known)}"
    return f"unknown {what} '{given}'; {hint}"


def shown(value: Any) -> str:
    """Shorten a value for a message; a whole file may be given by mistake."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} .."


def mapping_at(value: Any, place: str) -> dict[str, Any]:
    """Return the value as a mapping with text keys."""
    if not isinstance(value, dict):
        raise MachineError(f"{place}: must be a mapping (key: value), not {shown(value)}")
    return {str(key): entry for key, entry in value.items()}


def list_at(value: Any, place: str) -> list[Any]:
    """Return the value as a list."""
    if not isinstance(value, list):
        raise MachineError(f"{place}: must be a list, not {shown(value)}")
    return value


def build(cls: type, value: Any, place: str, **given: Any) -> Any:
    """Build a dataclass from a mapping; `given` fields do not come from the file.

    Raises:
        MachineError: for unknown and missing keys, values of the wrong kind, and values that the class rejects.
    """
    entries = mapping_at(value, place)
    hints = get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init and f.name not in given}
    names = {_KEY_OF_FIELD.get(name, name): name for name in fields}
    for key in entries:
        if key not in names:
            raise MachineError(f"{place}.{key}: {unknown('key', key, list(names))}")
    arguments = {names[key]: convert(entry, hints[names[key]], f"{place}.{key}") for key, entry in entries.items()}
    for name, field in fields.items():
        optional = field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
        if name not in arguments and not optional:
            raise MachineError(f"{place}: key '{_KEY_OF_FIELD.get(name, name)}' is missing")
    try:
        return cls(**given, **arguments)
    except MachineError as error:
        raise MachineError(f"{place}: {error}") from error


def convert(value: Any, hint: Any, place: str) -> Any:
    """Convert a value of the file to the type that a field declares."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint is float:
        return _number(value, place)
    if hint is int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise MachineError(f"{place}: must be a whole number, not {value!r}")
        return value
    if hint is bool:
        if not isinstance(value, bool):
            raise MachineError(f"{place}: must be true or false, not {value!r}")
        return value
    if hint is str:
        if isinstance(value, (dict, list)) or value is None:
            raise MachineError(f"{place}: must be a word, not {shown(value)}")
        return str(value)
    if origin is Literal:
        if value not in parts:
            raise MachineError(f"{place}: {unknown('value', str(value), [str(part) for part in parts])}")
        return value
    if origin in (Union, types.UnionType):
        return _one_of(value, parts, place)
    if origin is tuple:
        return _tuple(value, parts, place)
    if origin is np.ndarray:
        return np.array([_number(entry, f"{place}[{k}]") for k, entry in enumerate(list_at(value, place))])
    if isinstance(origin, type) and issubclass(origin, Mapping):
        entries = mapping_at(value, place)
        return {key: convert(entry, parts[1], f"{place}.{key}") for key, entry in entries.items()}
    if dataclasses.is_dataclass(hint):
        return build(hint, value, place)  # type: ignore[arg-type]
    raise MachineError(f"{place}: cannot be given in a file")


def _number(value: Any, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise MachineError(f"{place}: must be a number, not {shown(value)}")
    check_size(value, place)
    return float(value)


def _one_of(value: Any, kinds: tuple[Any, ...], place: str) -> Any:
    if value is None and type(None) in kinds:
        return None
    kinds = tuple(kind for kind in kinds if kind is not type(None))
    for kind in kinds[:-1]:
        try:
            return convert(value, kind, place)
        except MachineError:
            continue
    return convert(value, kinds[-1], place)


def _tuple(value: Any, parts: tuple[Any, ...], place: str) -> tuple[Any, ...]:
    entries = list_at(value, place)
    if len(parts) == 2 and parts[1] is Ellipsis:
        return tuple(convert(entry, parts[0], f"{place}[{k}]") for k, entry in enumerate(entries))
    if len(entries) != len(parts):
        raise MachineError(f"{place}: must be a list of {len(parts)}, not of {len(entries)}")
    return tuple(
        convert(entry, part, f"{place}[{k}]") for k, (entry, part) in enumerate(zip(entries, parts, strict=True))
    )


def plain(value: Any, leave_out: tuple[str, ...] = ()) -> Any:
    """Convert a dataclass, mapping or array to plain values for a file, without fields at their default."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        out = {}
        for field in dataclasses.fields(value):
            entry = getattr(value, field.name)
            factory = field.default_factory
            default = field.default if factory is dataclasses.MISSING else factory()
            if field.init and field.name not in leave_out and not _same(entry, default):
                out[_KEY_OF_FIELD.get(field.name, field.name)] = plain(entry)
        return out
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    return value


def _same(value: Any, default: Any) -> bool:
    if isinstance(value, np.ndarray) or isinstance(default, np.ndarray):
        return isinstance(default, np.ndarray) and np.array_equal(value, default)
    return type(value) is type(default) and bool(value == default)
