"""Assembly: does the chain close over its whole range, and how near does it come to a change point."""

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
    """How near one group comes to opening, over the range of the shaft angle.

    margin: the smallest closure value over its scale (0: change point or toggle), at the shaft angle theta_rad.
    distance_m: how far the group is then from where it opens, as where a dyad's links lie in one line, or its rod
    across the guide; there the motion's own error grows as rounding over distance. transmission_range_rad: smallest
    and largest angle between coupler and rocker, or between rod and guide normal; transmission_angle_rad: the one
    farthest from a right angle, folded to 0..90 deg. grashof: class of a four-bar linkage, by which links turn fully;
    None for other groups. passes: whether its branch goes on smoothly where all links come into one line; passing: the
    branches that would.
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
        """Whether motion and forces are not determined at theta_rad, to rounding."""
        return self.margin <= _ROUNDING and not self.passes


def check_assembly(linkage: Linkage) -> tuple[Closeness, ...]:
    """Closeness of every group that can open, over the linkage's range of the shaft angle.

    Raises MachineError with the shaft angle where the chain opens.
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
    """Where a chain opens as the shaft turns forward, in words; it is open at `lowest_rad`, if nowhere else."""
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
