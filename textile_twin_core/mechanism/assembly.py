"""Assembly: does the chain close over its whole range, and how near does it come to a change point."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.mechanism.extremes import smallest_value, values_over
from textile_twin_core.mechanism.group import Group
from textile_twin_core.mechanism.linkage import Linkage
from textile_twin_core.mechanism.rrp_dyad import RRPDyad
from textile_twin_core.mechanism.rrr_dyad import RRRDyad

_SAMPLES = 1441
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Closeness:
    """How near one dyad comes to opening, over the range of the shaft angle.

    margin: the smallest closure value over its scale (0: change point or toggle), at the shaft angle theta_rad.
    distance_m: how far the dyad's ends are then from where its links lie in one line, or its rod across the guide;
    there the motion's own error grows as rounding over distance. transmission_range_rad: smallest and largest angle
    between coupler and rocker, or between rod and guide normal; transmission_angle_rad: the one farthest from a right
    angle, folded to 0..90 deg. grashof: class of a four-bar linkage, by which links turn fully; None for other dyads.
    """

    group: str
    margin: float
    theta_rad: float
    distance_m: float
    transmission_range_rad: tuple[float, float]
    transmission_angle_rad: float
    grashof: str | None = None


def check_assembly(linkage: Linkage) -> tuple[Closeness, ...]:
    """Closeness of every dyad, over the linkage's range of the shaft angle.

    Raises MachineError with the shaft angle where the chain opens.
    """
    motion, range_rad = linkage.solved, linkage.range_rad
    reports = []
    for group in linkage.groups:
        found = group.closures(motion)
        if not found:
            continue
        minima = [smallest_value(closure.value, range_rad) for closure in found]
        for closure, (_, value) in zip(found, minima, strict=True):
            if not value >= -_ROUNDING * closure.scale:
                raise MachineError(
                    f"group '{group.name}' cannot close{_opens_at(closure.value, range_rad)} {closure.how}; "
                    "change its lengths or where it is fixed"
                )
        margin, theta = min((v / c.scale, t) for c, (t, v) in zip(found, minima, strict=True))
        # over their constant sum the two values are cos^2 and sin^2 of half the transmission angle
        stretched, folded = (max(value, 0.0) for _, value in minima)
        whole, distance = _measures(group, stretched, folded)
        smallest, rest = (2.0 * math.asin(min(1.0, math.sqrt(v / whole))) for v in (folded, stretched))
        grashof = group.grashof(motion) if isinstance(group, RRRDyad) else None
        reports.append(
            Closeness(
                group.name, max(margin, 0.0), theta, distance, (smallest, math.pi - rest), min(smallest, rest), grashof
            )
        )
    return tuple(reports)


def _measures(group: Group, stretched: float, folded: float) -> tuple[float, float]:
    """What a dyad's two closure values add up to, and its smallest distance from opening [m], from their minima."""
    if isinstance(group, RRPDyad):
        return 2.0 * group.lengths_m[0], min(stretched, folded)
    assert isinstance(group, RRRDyad)
    (l2, l3), whole = group.lengths_m, 4.0 * group.lengths_m[0] * group.lengths_m[1]
    longest, shortest = l2 + l3, abs(l2 - l3)
    from_longest = stretched / (longest + math.sqrt(longest**2 - stretched))
    nearest = math.sqrt(shortest**2 + folded)
    from_shortest = folded / (shortest + nearest) if nearest else 0.0
    return whole, min(from_longest, from_shortest)


def _opens_at(value: Expr, range_rad: tuple[float, float]) -> str:
    """Where a chain opens as the shaft turns forward, in words."""
    thetas = np.linspace(*range_rad, _SAMPLES)
    closed = values_over(value, thetas) >= 0.0
    opening = np.flatnonzero(closed[:-1] & ~closed[1:])
    if opening.size == 0:
        return " at any shaft angle:" if not closed.any() else f": at {math.degrees(thetas[~closed][0]):.4f} deg"
    low, high = float(thetas[opening[0]]), float(thetas[opening[0] + 1])
    from scipy.optimize import brentq

    function = compile_scalar([value], ["theta"])
    angle = brentq(lambda t: function(t)[0], low, high)
    return f": it opens at a shaft angle of {math.degrees(angle):.4f} deg where"
