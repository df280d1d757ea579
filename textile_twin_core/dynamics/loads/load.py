"""The Load protocol: an external action by virtual work and, independently, as forces on links.

A load is an intensity times a unit action. The intensity may leap (a needle enters the backing, the speed
changes its sign) and is linear in named parameters; the unit action is a smooth function of
the shaft angle. So the smooth part can be tabulated while the leaps stay exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.expression import Expr, const
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

    def parameters(self) -> Mapping[str, float]:
        """Values of the named parameters, SI."""
        ...

    def indicators(self, context: LoadContext) -> Mapping[str, Expr]:
        """Intensity per unit of each named parameter."""
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


def intensity(load: Load, context: LoadContext) -> Expr:
    """The load's intensity: the sum of parameter times indicator."""
    indicators, total = load.indicators(context), const(0.0)
    for name, value in load.parameters().items():
        total += value * indicators[name]
    return total
