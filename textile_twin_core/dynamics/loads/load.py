"""The Load protocol: an external action by virtual work and, independently, as forces on links.

A load is an intensity times a unit action. The intensity may be discontinuous, where a needle enters the backing or the
speed changes its sign. The unit action is a smooth function of the shaft angle. The smooth part can therefore be
tabulated while discontinuities stay exact.
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
    """Inputs of a load.

    Attributes:
        motion: the linkage's motion.
        shaft: angle [rad], speed [rad/s] and acceleration [rad/s^2] of the main shaft.
        measures: the machine's measures, by name.
        displacements: their displacements, by name.
        carries_shaft_loads: true for one linkage of a shaft: loads on the shaft itself act there, once.

    Examples:
        >>> import textile_twin_core as ttc
        >>> sorted(ttc.machines.tufting().model.linkages[0].load_context.measures)
        ['needle']
    """

    motion: Motion
    shaft: ShaftState
    measures: Mapping[str, Measure]
    displacements: Mapping[str, Displacement]
    carries_shaft_loads: bool = True


@dataclass(frozen=True)
class Crossing:
    """Start or end of a load as the shaft turns forward: `level` crosses zero there, rising or falling."""

    name: str
    level: Expr
    rising: bool


@runtime_checkable
class Load(Protocol):
    """An external load."""

    def intensity(self, context: LoadContext) -> Expr:
        """Express the strength of the load, which may step where the load sets in or reverses."""
        ...

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the generalised force on the shaft, positive along positive theta, per unit of intensity [N m]."""
        ...

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply the load's forces to the links."""
        ...

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """Return the load's events over the shaft angle."""
        ...


class Uneventful:
    """Base class of loads without named events.

    A subclass is a frozen dataclass that defines `intensity`, `unit_force` and `apply`.

    Examples:
        The air drag of [extending](../extending.md#a-load) derives from it:

        >>> from textile_twin_core.dynamics.loads import ShaftFriction
        >>> from textile_twin_core.dynamics.loads.load import Uneventful
        >>> issubclass(ShaftFriction, Uneventful)
        True
    """

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """Return no events."""
        return ()
