"""The Load protocol: an external action by virtual work and, independently, as forces on links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.dynamics.wrenches import Wrenches
from textile_twin_core.expression import Expr
from textile_twin_core.mechanism import Displacement, Measure, Motion


@dataclass(frozen=True)
class LoadContext:
    """What a load acts on: the motion, the shaft's state and the machine's measures with their displacements."""

    motion: Motion
    shaft: ShaftState
    measures: Mapping[str, Measure]
    displacements: Mapping[str, Displacement]


@dataclass(frozen=True)
class Crossing:
    """Where a load sets in or ceases: `level` crosses zero there, rising or falling with the shaft turning forward."""

    name: str
    level: Expr
    rising: bool


@runtime_checkable
class Load(Protocol):
    """An external load.

    The generalised force is linear in the named parameters where physics allows:
    Q = sum of parameter times coefficient.
    """

    def coefficients(self, context: LoadContext) -> Mapping[str, Expr]:
        """Generalised force on the shaft [N m] per unit of each named parameter."""
        ...

    def parameters(self) -> Mapping[str, float]:
        """Values of the named parameters, SI."""
        ...

    def apply(self, context: LoadContext, wrenches: Wrenches) -> None:
        """Put the load's forces on the links."""
        ...

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """Events of the load over the shaft angle."""
        ...


def generalised_force(load: Load, context: LoadContext) -> Expr:
    """The load's generalised force on the shaft, positive along positive theta [N m]."""
    coefficients, total = load.coefficients(context), None
    for name, value in load.parameters().items():
        term = value * coefficients[name]
        total = term if total is None else total + term
    assert total is not None, "a load has at least one parameter"
    return total
