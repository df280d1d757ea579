"""The Group protocol: the piece from which every linkage is put together, and checks they share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr
from textile_twin_core.mechanism.joint import Joint
from textile_twin_core.mechanism.motion import Motion
from textile_twin_core.mechanism.transmission import Transmission
from textile_twin_core.mechanism.wrenches import Wrenches

MAIN_SHAFT = "main_shaft"


@dataclass(frozen=True)
class Closure:
    """What must not become negative for a group to close; 0 is a change point or toggle.

    `how` says how the chain opens, `scale` is the size of the value's terms; `fails`, `begins` and `remedy` are words
    of the message where it opens. At a `limit`, as the end of a slot, the chain ends, but nothing is ill-conditioned.
    """

    how: str
    value: Expr
    scale: float
    fails: str = "cannot close"
    begins: str = "it opens"
    remedy: str = "change its lengths or where it is fixed"
    limit: bool = False


@dataclass(frozen=True)
class ContactForce:
    """A force by which one body of a group presses on another [N]: the output's name, and the event of its loss.

    It can only press: where it would turn negative the bodies part.
    """

    output: str
    lift_off: str


@runtime_checkable
class Group(Protocol):
    """A structural group: from what stands before it, closed-form motion of what it adds, and the forces in it.

    Implementations are frozen dataclasses whose fields are the declaration; `PlainGroup` fills in what most have not.
    """

    @property
    def name(self) -> str:
        """The group's name in messages."""
        ...

    @property
    def pins(self) -> tuple[str, ...]:
        """The points at which this group's links turn on each other, on the ground or on earlier groups."""
        ...

    @property
    def contact_forces(self) -> tuple[ContactForce, ...]:
        """The forces that `balance` books in `wrenches.contacts`."""
        ...

    def solve(self, motion: Motion) -> None:
        """Add this group's points, links, turning shafts and further quantities to the motion."""
        ...

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """What must stay positive for the group to close, in a motion that was solved; empty if it always does."""
        ...

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """How well a group with closures passes its force on, from the smallest value of each of them."""
        ...

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """A joint of the robot description for each link of the group, in a motion that was solved."""
        ...

    def balance(self, wrenches: Wrenches) -> None:
        """Balance this group's links under what acts on them, when all later groups are balanced.

        Books the forces in its pins, guides and contacts, and puts their opposites on the links and shafts that
        carry it.
        """
        ...


class PlainGroup:
    """Base of groups, for what most of them need not tell: no contact that could part, no angle at which it opens."""

    @property
    def contact_forces(self) -> tuple[ContactForce, ...]:
        """None."""
        return ()

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """None: it always closes."""
        return ()

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Not asked of a group without closures."""
        raise NotImplementedError(f"{type(self).__name__} has closures: it must tell its transmission too")


def check_length(value: float, what: str) -> None:
    """Raise MachineError unless the length is positive and finite."""
    if not (math.isfinite(value) and value > 0.0):
        raise MachineError(f"{what} must be a positive length in metres, not {value!r}")


def check_finite(value: float, what: str) -> None:
    """Raise MachineError unless the value is finite."""
    if not math.isfinite(value):
        raise MachineError(f"{what} must be a finite number, not {value!r}")
