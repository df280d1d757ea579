"""The Load protocol: an external action by virtual work and, independently, as forces on links.

A load is an intensity times a unit action. The intensity may leap (a needle enters the backing, the speed changes its
sign); the unit action is a smooth function of the shaft angle. So the smooth part can be tabulated while the leaps stay
exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.expression import Expr
from textile_twin_core.mechanism import Displacement, Measure, Motion
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class LoadContext:
    """What a load acts on: the motion, the shaft's state, the machine's measures and their displacements.

    `carries_shaft_loads` is set for one linkage of a shaft: loads on the shaft itself act there, once.
    """

    motion: Motion
    shaft: ShaftState
    measures: Mapping[str, Measure]
    displacements: Mapping[str, Displacement]
    carries_shaft_loads: bool = True


@dataclass(frozen=True)
class Crossing:
    """Where a load sets in or ceases as the shaft turns forward: `level` crosses zero there, rising or falling."""

    name: str
    level: Expr
    rising: bool


@runtime_checkable
class Load(Protocol):
    """An external load."""

    def intensity(self, context: LoadContext) -> Expr:
        """How strongly it acts, which may leap where it sets in or turns round."""
        ...

    def unit_force(self, context: LoadContext) -> Expr:
        """Generalised force on the shaft, positive along positive theta, per unit of intensity [N m]."""
        ...

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Put the load's forces on the links."""
        ...

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """Events of the load over the shaft angle."""
        ...


class Uneventful:
    """Base of loads without events that a person would name."""

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """None."""
        return ()
