"""Numbers of a declaration as Python's: of numpy's float32 there is no fraction, and what it enters becomes one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

_T = TypeVar("_T")
_P = ParamSpec("_P")


def python_numbers(value: Any) -> Any:
    """A value with numpy's numbers in it as Python's, in tuples, mappings and dataclasses too; itself if it has none.

    float64 stays, which is a Python float.
    """
    if isinstance(value, (np.floating, np.integer)) and not isinstance(value, float):
        return int(value) if isinstance(value, np.integer) else float(value)
    if type(value) is tuple:
        held = dict(enumerate(value))
        changed = _changed(held)
        return tuple({**held, **changed}.values()) if changed else value
    if isinstance(value, Mapping):
        changed = _changed(value)
        return {**value, **changed} if changed else value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        changed = _changed({f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.init})
        return dataclasses.replace(value, **changed) if changed else value
    return value


def with_python_numbers(factory: Callable[_P, _T]) -> Callable[_P, _T]:
    """A function that is given Python's numbers for numpy's."""

    @wraps(factory)
    def given(*values: _P.args, **named: _P.kwargs) -> _T:
        return factory(*python_numbers(values), **python_numbers(named))

    return given


def _changed(held: Mapping[Any, Any]) -> dict[Any, Any]:
    return {key: entry for key, old in held.items() if (entry := python_numbers(old)) is not old}
