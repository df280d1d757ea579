"""What a copy of a machine is made of: its declaration alone; all else is derived anew from that."""

from __future__ import annotations

from dataclasses import fields
from types import MappingProxyType
from typing import Any


class Declared:
    """Lets a dataclass be pickled and copied by the values of its fields.

    Expressions and compiled functions belong to their process and are left behind.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        declared = {field.name: _open(getattr(self, field.name)) for field in fields(self)}  # type: ignore[arg-type]
        return _declare, (type(self), declared)


def _declare(kind: type[Any], declared: dict[str, Any]) -> Any:
    return kind(**declared)


def _open(value: Any) -> Any:
    return dict(value) if isinstance(value, MappingProxyType) else value
