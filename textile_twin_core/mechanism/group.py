"""The Group protocol, from whose implementations every linkage is assembled, and shared checks."""

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
    """A quantity that must stay positive for a group to close; 0 is a change point or a toggle.

    Attributes:
        how: how the chain opens, in words.
        value: the quantity over theta.
        scale: size of the quantity's terms.
        fails, begins, remedy: words of the error message.
        limit: whether the chain ends there without becoming ill-conditioned, as at the end of a slot.
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
    """A force by which one body of a group presses on another [N]: name of the output, and of the event of its loss.

    The force can only press: the bodies part where it would become negative.
    """

    output: str
    lift_off: str


@runtime_checkable
class Group(Protocol):
    """A structural group: closed-form motion of the parts it adds to the earlier groups, and the forces in it.

    Implementations are frozen dataclasses whose fields are the declaration. `PlainGroup` has the usual defaults.
    """

    @property
    def name(self) -> str:
        """The group's name in messages."""
        ...

    @property
    def pins(self) -> tuple[str, ...]:
        """Points at which the group's links turn on each other, on the ground or on earlier groups."""
        ...

    @property
    def contact_forces(self) -> tuple[ContactForce, ...]:
        """Forces that `balance` writes to `wrenches.contacts`."""
        ...

    def solve(self, motion: Motion) -> None:
        """Add the group's points, links, turning shafts and further quantities to the motion."""
        ...

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Return the quantities that must stay positive in a solved motion; empty for a group that always closes."""
        ...

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Compute the transmission of a group with closures, given the smallest value of each closure."""
        ...

    def transmission_cosine(self, motion: Motion) -> Expr:
        """Express the cosine of the transmission angle of a group with closures."""
        ...

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return a joint of the robot description for each link of the group, in a solved motion."""
        ...

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the joint forces of the group's links, after all later groups have been solved.

        Writes the forces in pins, guides and contacts, and applies their opposites to the links and shafts that carry
        the group.
        """
        ...


class PlainGroup:
    """Base class of groups with the usual defaults: no contact that can part, no position in which the group opens.

    A subclass is a frozen dataclass whose fields are the declaration. It defines `pins`, `solve`, `joints` and
    `balance`.

    Examples:
        The Scotch yoke of [extending](../extending.md#a-group) derives from it:

        >>> from textile_twin_core.mechanism.group import PlainGroup
        >>> sorted(name for name in vars(PlainGroup) if not name.startswith("_"))[:2]
        ['closures', 'contact_forces']
    """

    @property
    def contact_forces(self) -> tuple[ContactForce, ...]:
        """Empty: no contact of the group can part."""
        return ()

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Return no closures: the group always closes."""
        return ()

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Raise NotImplementedError: a group without closures has no transmission angle."""
        raise NotImplementedError(f"{type(self).__name__} has closures and must define transmission()")

    def transmission_cosine(self, motion: Motion) -> Expr:
        """Raise NotImplementedError: a search then has no number of the transmission angle."""
        raise NotImplementedError(f"{type(self).__name__} does not define transmission_cosine()")


def check_length(value: float, what: str) -> None:
    """Raise MachineError unless the length is positive and finite."""
    if not (math.isfinite(value) and value > 0.0):
        raise MachineError(f"{what} must be a positive length in metres, not {value!r}")


def check_finite(value: float, what: str) -> None:
    """Raise MachineError unless the value is finite."""
    if not math.isfinite(value):
        raise MachineError(f"{what} must be a finite number, not {value!r}")
