"""Links as straight bars of one section: the masses that give a synthesised linkage its dynamics."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.dynamics import Body
from textile_twin_core.errors import SceneError


@dataclass(frozen=True)
class BarSection:
    """Density [kg/m^3] and rectangular section [m] of a bar; the width lies in the plane of motion.

    The default is the cast iron of 30 x 10 mm of Topalbekiroglu and Celik 2010. Raises SceneError for a number that is
    not positive.
    """

    density_kg_m3: float = 7210.0
    width_m: float = 0.030
    thickness_m: float = 0.010

    def __post_init__(self) -> None:
        for value in (self.density_kg_m3, self.width_m, self.thickness_m):
            if not (math.isfinite(value) and value > 0.0):
                raise SceneError(f"section: density, width and thickness must be positive numbers, not {value!r}")

    def bar(self, link: str, length_m: float) -> Body:
        """Return the bar over a whole link."""
        return Body.bar(link, length_m, self.density_kg_m3, self.width_m, self.thickness_m)


CAST_IRON = BarSection()
