"""The Group protocol: the piece from which every linkage is put together, and checks they share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr
from textile_twin_core.mechanism.motion import Motion

MAIN_SHAFT = "main_shaft"


@dataclass(frozen=True)
class Closure:
    """What must not become negative for a group to close; 0 is a change point or toggle.

    `how` says how the chain opens, `scale` is the size of the value's terms.
    """

    how: str
    value: Expr
    scale: float


@runtime_checkable
class Group(Protocol):
    """A structural group: from what stands before it, closed-form motion of what it adds.

    Implementations are frozen dataclasses whose fields are the declaration.
    """

    @property
    def name(self) -> str:
        """The group's name in messages."""
        ...

    def solve(self, motion: Motion) -> None:
        """Add this group's points and links to the motion."""
        ...

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """What must stay positive for the group to close, in a motion that was solved; empty if it always does."""
        ...


def check_length(value: float, what: str) -> None:
    """Raise MachineError unless the length is positive and finite."""
    if not (math.isfinite(value) and value > 0.0):
        raise MachineError(f"{what} must be a positive length in metres, not {value!r}")


def check_finite(value: float, what: str) -> None:
    """Raise MachineError unless the value is finite."""
    if not math.isfinite(value):
        raise MachineError(f"{what} must be a finite number, not {value!r}")
