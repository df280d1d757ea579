"""Assembly check: whether the chain closes over its whole range, and its distance from a change point."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from textile_twin_core.errors import MachineError
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.mechanism.extremes import smallest_value, values_over
from textile_twin_core.mechanism.group import Closure
from textile_twin_core.mechanism.linkage import Linkage

_SAMPLES = 1441
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Closeness:
    """Distance of one group from the position in which it opens, over the range of the shaft angle.

    Near that position the error of the computed motion grows as rounding over `distance_m`.

    Attributes:
        margin: smallest closure value over its scale; 0 is a change point or a toggle.
        theta_rad: shaft angle of the smallest closure value.
        distance_m: distance there from the position that opens the group, for example a dyad's links in one line.
        transmission_range_rad: smallest and largest angle between coupler and rocker, or between rod and guide normal.
        transmission_angle_rad: the transmission angle farthest from a right angle, folded to 0 .. 90 deg.
        grashof: Grashof class of a four-bar linkage; None for other groups.
        passes: whether the branch continues smoothly through the position with all links in one line.
        passing: the branches that would continue smoothly there.
    """

    group: str
    margin: float
    theta_rad: float
    distance_m: float
    transmission_range_rad: tuple[float, float]
    transmission_angle_rad: float
    grashof: str | None = None
    passes: bool = False
    passing: tuple[str, ...] = ()

    @property
    def is_dead_point(self) -> bool:
        """True if motion and forces are undetermined at `theta_rad`, to rounding."""
        return self.margin <= _ROUNDING and not self.passes


def check_assembly(linkage: Linkage) -> tuple[Closeness, ...]:
    """Measure how close each group comes to opening, over the linkage's range of the shaft angle.

    Raises:
        MachineError: with the shaft angle, where the chain opens.
    """
    motion, range_rad = linkage.solved, linkage.range_rad
    reports = []
    for group in linkage.groups:
        found = group.closures(motion)
        if not found:
            continue
        minima = [smallest_value(closure.value, range_rad) for closure in found]
        for closure, (lowest_rad, value) in zip(found, minima, strict=True):
            if not value >= -_ROUNDING * closure.scale:
                where = _opens_at(closure, range_rad, lowest_rad)
                raise MachineError(f"group '{group.name}' {closure.fails}{where} {closure.how}; {closure.remedy}")
        opening = [(c.scale, t, v) for c, (t, v) in zip(found, minima, strict=True) if not c.limit]
        if not opening:
            continue
        margin, theta = min((v / scale, t) for scale, t, v in opening)
        passed = group.transmission(motion, [value for _, _, value in opening])
        near = max(margin, 0.0), theta, passed.distance_m, passed.range_rad, passed.worst_rad
        reports.append(Closeness(group.name, *near, passed.grashof, passed.passes, passed.passing))
    return tuple(reports)


def _opens_at(closure: Closure, range_rad: tuple[float, float], lowest_rad: float) -> str:
    """Describe where the chain opens as the shaft turns forward; `lowest_rad` is an angle at which it is open."""
    value = closure.value
    thetas = np.sort(np.append(np.linspace(*range_rad, _SAMPLES), lowest_rad))
    closed = values_over(value, thetas) >= 0.0
    opening = np.flatnonzero(closed[:-1] & ~closed[1:])
    if opening.size == 0:
        return " at any shaft angle:" if not closed.any() else f": at {math.degrees(thetas[~closed][0]):.4f} deg"
    low, high = float(thetas[opening[0]]), float(thetas[opening[0] + 1])

    function = compile_scalar([value], ["theta"])
    angle = scipy.optimize.brentq(lambda t: function(t)[0], low, high)
    return f": {closure.begins} at a shaft angle of {math.degrees(angle):.4f} deg where"
