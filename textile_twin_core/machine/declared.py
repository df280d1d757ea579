"""Copies of machines from their declarations; everything else is derived from the declaration."""

from __future__ import annotations

import re
from dataclasses import fields
from types import MappingProxyType
from typing import Any


def type_tag(cls: type) -> str:
    """Return a machine file's word for a class: RRRDyad is rrr_dyad."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", cls.__name__).lower()


class Declared:
    """Base class of dataclasses that are pickled and copied by the values of their fields.

    Expressions and compiled functions belong to their process and are not copied.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        declared = {field.name: _open(getattr(self, field.name)) for field in fields(self)}  # type: ignore[arg-type]
        return _declare, (type(self), declared)


def _declare(kind: type[Any], declared: dict[str, Any]) -> Any:
    return kind(**declared)


def _open(value: Any) -> Any:
    return dict(value) if isinstance(value, MappingProxyType) else value
