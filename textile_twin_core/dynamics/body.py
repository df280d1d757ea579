"""Bodies: mass, centroid and inertia carried by a link."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.errors import MachineError
from textile_twin_core.mechanism import MAIN_SHAFT


@dataclass(frozen=True)
class Body:
    """A rigid body on a link.

    A body on the main shaft itself (`on` "main_shaft") is a flywheel: balanced, with its weight carried by its own
    bearings, and counted once for all linkages. A counterweight on a crank is a point mass with a negative fraction.

    Attributes:
        on: name of the link, or "main_shaft".
        mass_kg: mass [kg].
        inertia_kgm2: moment of inertia about the centroid [kg m^2]; 0 for a point mass.
        centroid: position as fractions of the link's length, along the link from its start and across it to the left.

    Raises:
        MachineError: for a negative mass or inertia.

    Examples:
        >>> from textile_twin_core.dynamics import Body
        >>> Body("l3", 2.96, 0.0108, centroid=(0.5, 0.0)).mass_kg
        2.96
    """

    on: str
    mass_kg: float
    inertia_kgm2: float = 0.0
    centroid: tuple[float, float] = (0.5, 0.0)

    def __post_init__(self) -> None:
        for what, value in (("mass_kg", self.mass_kg), ("inertia_kgm2", self.inertia_kgm2)):
            if not (math.isfinite(value) and value >= 0.0):
                raise MachineError(f"body on '{self.on}': {what} must be zero or positive and finite, not {value!r}")
        if not all(math.isfinite(v) for v in self.centroid):
            raise MachineError(f"body on '{self.on}': centroid must be two finite fractions, not {self.centroid!r}")

    @classmethod
    def flywheel(cls, inertia_kgm2: float, mass_kg: float = 0.0) -> Body:
        """Return a balanced rotor on the main shaft."""
        return cls(MAIN_SHAFT, mass_kg, inertia_kgm2)

    @property
    def is_flywheel(self) -> bool:
        """True for a body on the main shaft itself."""
        return self.on == MAIN_SHAFT

    @classmethod
    def bar(cls, on: str, length_m: float, density_kg_m3: float, width_m: float, thickness_m: float) -> Body:
        """Return a straight bar of rectangular section over the whole link; `width_m` lies in the plane of motion."""
        mass = density_kg_m3 * length_m * width_m * thickness_m
        return cls(on, mass, mass * (length_m**2 + width_m**2) / 12.0)
