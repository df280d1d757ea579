"""Slider-cranks for a stroke and a crank rotation, offset if forward and return stroke differ in time."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from textile_twin_core.dynamics import Body
from textile_twin_core.errors import SceneError
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import Crank, RRPDyad, Travel
from textile_twin_core.synthesis.bars import CAST_IRON, BarSection
from textile_twin_core.synthesis.crank_rocker import LARGEST_DEVIATION_RAD, WANTED_RATIO

_IN_LINE = 4e-15


@dataclass(frozen=True)
class SliderCrankDesign:
    """One slider-crank: lengths [m], the guide's offset above the crank's axis [m], worst transmission angle."""

    stroke_m: float
    rotation_rad: float
    crank_m: float
    rod_m: float
    offset_m: float
    mu_min_rad: float

    @property
    def crank_over_rod(self) -> float:
        """Crank over rod, r/l."""
        return self.crank_m / self.rod_m

    def to_json(self) -> dict[str, Any]:
        """Return lengths, ratio and transmission angle."""
        return asdict(self) | {"r_over_l": self.crank_over_rod, "mu_min_deg": math.degrees(self.mu_min_rad)}

    def machine(self, section: BarSection = CAST_IRON, slider_kg: float = 1.0, name: str = "slider_crank") -> Machine:
        """Build the machine: crank about O, rod, slider along +x; links are bars of the section."""
        return Machine(
            name=name,
            description=f"slider-crank of {1e3 * self.stroke_m:g} mm stroke",
            points={"O": (0.0, 0.0)},
            groups=(
                Crank("l1", at="O", end="A", length_m=self.crank_m),
                RRPDyad(
                    "l2",
                    "l3",
                    from_point="A",
                    end="B",
                    tip="F",
                    lengths_m=(self.rod_m, 0.2 * self.rod_m),
                    guide_point_m=(0.0, self.offset_m),
                    guide_direction=(1.0, 0.0),
                ),
            ),
            bodies=(section.bar("l1", self.crank_m), section.bar("l2", self.rod_m), Body("l3", slider_kg)),
            measures=(Travel("slider", point="B", origin="O", direction=(1.0, 0.0)),),
            joint_names={"l1": "main_shaft", "l2": "rod", "l3": "slider"},
        )


@dataclass(frozen=True)
class SliderCrankFamily:
    """All slider-cranks of a stroke s and a rotation pi + alpha from the outer to the inner dead centre.

    The crank's axis sees the two ends of the stroke under alpha, at the distances rod + crank and rod - crank (cosine
    law). With r = crank/rod and h^2 = r^2 cos^2(alpha/2) + sin^2(alpha/2)

        rod = s/(2 h),  crank = r rod,  offset = rod^2 (1 - r^2) sin(alpha)/s,

    the limit of the crank-rocker family for an infinite rocker. The ratio r runs from tan^2(alpha/2) to 1, both change
    points.

    Raises:
        SceneError: for a stroke that is not positive or a rotation without an admissible r.
    """

    stroke_m: float
    imbalance_rad: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.stroke_m) and self.stroke_m > 0.0):
            raise SceneError(f"stroke {self.stroke_m!r} m: give a positive length")
        if not abs(self.imbalance_rad) < math.pi / 2:
            raise SceneError(
                f"rotation {math.degrees(math.pi + self.imbalance_rad):g} deg: a slider-crank needs one between 90 and"
                " 270 deg from the outer to the inner dead centre"
            )
        if abs(self.imbalance_rad) <= _IN_LINE:
            object.__setattr__(self, "imbalance_rad", 0.0)

    @property
    def smallest_ratio(self) -> float:
        """Crank over rod at the change point."""
        return math.tan(self.imbalance_rad / 2.0) ** 2

    def at_ratio(self, ratio: float) -> SliderCrankDesign:
        """Return the member with this crank over rod. Raises SceneError outside the family."""
        if not self.smallest_ratio < ratio < 1.0:
            raise SceneError(
                f"crank over rod {ratio:g}: must lie between {self.smallest_ratio:.4g} and 1 for this task"
            )
        half = self.imbalance_rad / 2.0
        h = math.hypot(ratio * math.cos(half), math.sin(half))
        rod = self.stroke_m / (2.0 * h)
        offset = rod * rod * (1.0 - ratio * ratio) * math.sin(self.imbalance_rad) / self.stroke_m
        cosine = ratio + abs(offset) / rod
        return SliderCrankDesign(
            self.stroke_m,
            math.pi + self.imbalance_rad,
            ratio * rod,
            rod,
            offset,
            math.acos(min(1.0, cosine)),
        )

    def best_transmission(self) -> SliderCrankDesign | None:
        """Find the member of the largest mu_min; None without offset, where mu_min grows with the rod."""
        if self.imbalance_rad == 0.0:
            return None
        span = (self.smallest_ratio + 1e-12, 1.0 - 1e-12)
        grid = np.linspace(*span, 257)[1:-1]
        top = int(np.argmax([self.at_ratio(r).mu_min_rad for r in grid.tolist()]))
        bounds = (grid[max(top - 1, 0)], grid[min(top + 1, grid.size - 1)])
        found = minimize_scalar(
            lambda r: -self.at_ratio(r).mu_min_rad, bounds=bounds, method="bounded", options={"xatol": 1e-13}
        )
        return self.at_ratio(float(found.x))

    def best(self) -> SliderCrankDesign | None:
        """Find crank over rod nearest 0.3 with a transmission angle within 40 deg of 90, or None."""
        smallest = math.pi / 2 - LARGEST_DEVIATION_RAD
        if self.imbalance_rad == 0.0:
            return self.at_ratio(WANTED_RATIO)
        peak = self.best_transmission()
        assert peak is not None
        if peak.mu_min_rad < smallest:
            return None
        wanted = max(WANTED_RATIO, self.smallest_ratio * (1.0 + 1e-12))
        if self.at_ratio(wanted).mu_min_rad >= smallest:
            return self.at_ratio(wanted)
        ratio = brentq(lambda r: self.at_ratio(r).mu_min_rad - smallest, wanted, peak.crank_over_rod, xtol=1e-15)
        return self.at_ratio(float(ratio))


def offset_slider(
    stroke_m: float, rotation_rad: float = math.pi, crank_over_rod: float | None = None
) -> SliderCrankDesign:
    """Synthesise the slider-crank of a stroke whose crank turns by an angle from outer to inner dead centre.

    The crank turns counter-clockwise. The slider moves along +x on a guide above the axis if the rotation exceeds 180
    deg.

    Args:
        stroke_m: stroke of the slider [m].
        rotation_rad: rotation of the crank for it [rad].
        crank_over_rod: ratio of the lengths. Without it the design has the ratio nearest 0.3 with a transmission angle
            of at smallest 50 deg, or else the best transmission angle.

    Returns:
        The design.

    Raises:
        SceneError: for a stroke or rotation that no slider-crank has.

    Examples:
        >>> from textile_twin_core.synthesis.offset_slider import offset_slider
        >>> round(offset_slider(0.1, crank_over_rod=0.3).crank_m, 3)  # [m]
        0.05
    """
    family = SliderCrankFamily(float(stroke_m), float(rotation_rad) - math.pi)
    if crank_over_rod is not None:
        return family.at_ratio(crank_over_rod)
    found = family.best() or family.best_transmission()
    assert found is not None
    return found
