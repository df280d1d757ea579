"""Conversion of the numpy numbers in a declaration to Python numbers.

numpy.float32 has no exact fraction, and every result that it enters becomes a float32.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

_T = TypeVar("_T")
_P = ParamSpec("_P")


def python_numbers(value: Any) -> Any:
    """Convert numpy numbers to Python's in tuples, mappings and dataclasses.

    A value without such numbers is returned itself. numpy.float64 stays, since it is a Python float.
    """
    if isinstance(value, (np.floating, np.integer)) and not isinstance(value, float):
        return int(value) if isinstance(value, np.integer) else float(value)
    if type(value) is tuple:
        entries = dict(enumerate(value))
        changed = _changed(entries)
        return tuple({**entries, **changed}.values()) if changed else value
    if isinstance(value, Mapping):
        changed = _changed(value)
        return {**value, **changed} if changed else value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        changed = _changed({f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.init})
        return dataclasses.replace(value, **changed) if changed else value
    return value


def with_python_numbers(factory: Callable[_P, _T]) -> Callable[_P, _T]:
    """Wrap a function so that it receives Python numbers for numpy numbers."""

    @wraps(factory)
    def given(*values: _P.args, **named: _P.kwargs) -> _T:
        return factory(*python_numbers(values), **python_numbers(named))

    return given


def _changed(entries: Mapping[Any, Any]) -> dict[Any, Any]:
    return {key: entry for key, old in entries.items() if (entry := python_numbers(old)) is not old}
