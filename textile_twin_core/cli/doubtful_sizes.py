"""Sizes of a machine that are possible, and more often a wrong unit: told beside the result."""

from __future__ import annotations

import math
from collections.abc import Iterator

from textile_twin_core.machine import Machine

_LONGEST_M = 20.0
"""No link of a textile machine is longer: it was given in millimetres."""
_WIDEST = 5.0
"""Radius of gyration over a link's length: an inertia in kg cm2 or kg mm2 makes it 100 or 1000."""


def doubtful_sizes(machine: Machine) -> Iterator[str]:
    """A line for the longest link that is too long, and for each body too wide for its link."""
    links = machine.linkage.solved.links
    longest = max(links.values(), key=lambda link: abs(link.length))
    if abs(longest.length) > _LONGEST_M:
        yield (
            f"machine '{machine.name}': link '{longest.name}' is {abs(longest.length):g} m long: lengths and points are"
            " in metres"
        )
    for body in machine.bodies:
        length = 0.0 if body.is_flywheel else abs(links[body.on].length)
        if length and body.mass_kg and (radius := math.sqrt(body.inertia_kgm2 / body.mass_kg)) > _WIDEST * length:
            yield (
                f"machine '{machine.name}': {body.mass_kg:g} kg with an inertia of {body.inertia_kgm2:g} kg m2 on link"
                f" '{body.on}' lie {radius:.3g} m from their centroid, and the link is {length:.3g} m long: inertias"
                " are in kg m2 about the centroid"
            )
