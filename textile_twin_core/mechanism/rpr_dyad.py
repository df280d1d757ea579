"""RPR dyad: a slider on a moving lever, both pinned (Assur group of class II, third kind).

With d from the lever's pivot to the slider's pin, D its length and e the pin's offset to the left of the slot's line
through the pivot, the pin is at s = +-sqrt(D^2 - e^2) along the slot, whose unit vector is u = (s - i e) d / D^2. In
the frame of the slot d' = (s' - e p) + i s p gives the rates. On a crank of length r whose axis is g from the fixed
pivot, with phi from the ground line, k = sin(phi/2) and S0 = (|g - r| - e)(|g - r| + e),

    D^2 = (g - r)^2 + 4 g r k^2,  s^2 = S0 + 4 g r k^2,  s s' = g r sin(phi),
    p = r (r - g + 2 g k^2) / D^2 + e s' / D^2,  s s'' = g r (S0 cos^2(phi/2) - k^2 s^2) / s^2,
    p' = 2 g r k cos(phi/2) (g - r)(g + r) / D^4 + e (s'' - 2 s'^2 s / D^2) / D^2.

No term cancels where the pin passes close by the pivot (g near r), as in the quick return of a Whitworth linkage.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, sqrt, square
from textile_twin_core.expression.real import exact, rounded
from textile_twin_core.mechanism.crank_pivot import CrankPivot
from textile_twin_core.mechanism.extremes import smallest_value, values_over
from textile_twin_core.mechanism.group import Closure, PlainGroup, check_finite, check_length
from textile_twin_core.mechanism.guide_line import check_slot, slot_ends
from textile_twin_core.mechanism.joint import Joint, guide, pivot
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion, Sliding
from textile_twin_core.mechanism.transmission import Transmission
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches

_SAMPLES = 181


@dataclass(frozen=True)
class PinInSlot:
    """Position of the pin in the slot: D^2 and s, s', s'' [m], and u, p, q of the slot's direction."""

    distance_squared: Expr
    slide: tuple[Expr, Expr, Expr]
    direction: Vector
    first: Expr
    second: Expr


@dataclass(frozen=True)
class RPRDyad(PlainGroup):
    """A slider pinned at `from_point`, on a lever from `pivot` to the new point `end`.

    `lengths_m` are those of slider and lever. The lever's direction is that of its slot. The slider's link has the same
    direction, from its pin to the new point `tip`. The pin lies `offset_m` to the left of the slot's line through the
    pivot. `branch` says whether the pin is ahead of the pivot along the lever ("forward") or behind it. `slot_m` are
    the two distances along the lever, from the pivot, between which the pin must stay.

    Either pin may be fixed. A crank that drives a slotted lever has its end as `from_point`. An oscillating cylinder is
    a slider with a fixed pin, on a piston rod whose `pivot` is the crank's end.

    Raises:
        MachineError: for impossible lengths, slot or branch.

    Examples:
        >>> import numpy as np
        >>> from textile_twin_core.mechanism import Crank, Linkage
        >>> from textile_twin_core.mechanism.extremes import values_over
        >>> whitworth = (Crank("crank", "O", "A", 0.11), RPRDyad("block", "lever", "A", "C", "B", "T", (0.03, 0.2)))
        >>> lever = Linkage({"O": (0.0, 0.0), "C": (0.0, -0.04)}, whitworth).solved.links["lever"]
        >>> values_over(lever.first, np.array([1.5 * np.pi, 0.5 * np.pi])).round(4).tolist()  # quick return, forward
        [1.5714, 0.7333]

    References:
        Norton, Design of Machinery, 2012, chapters 4, 6 and 7: the inverted slider-crank, in the textbook's form.
    """

    slider: str
    lever: str
    from_point: str
    pivot: str
    end: str
    tip: str
    lengths_m: tuple[float, float]
    offset_m: float = 0.0
    slot_m: tuple[float, float] | None = None
    branch: Literal["forward", "backward"] = "forward"

    def __post_init__(self) -> None:
        for link, length in zip((self.slider, self.lever), self.lengths_m, strict=True):
            check_length(length, f"dyad '{self.name}': length of '{link}'")
        check_finite(self.offset_m, f"dyad '{self.name}': offset_m")
        check_slot(f"dyad '{self.name}'", self.slot_m)
        if self.branch not in ("forward", "backward"):
            raise MachineError(f"dyad '{self.name}': branch must be 'forward' or 'backward', not {self.branch!r}")

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return f"{self.slider}-{self.lever}"

    @property
    def pins(self) -> tuple[str, ...]:
        """Pin of the slider and pivot of the lever."""
        return self.from_point, self.pivot

    def solve(self, motion: Motion) -> None:
        """Add slider and lever, the lever's end and the slider's tip."""
        if self.from_point == self.pivot:
            raise MachineError(f"dyad '{self.name}': from and pivot are one point, '{self.pivot}'; name two")
        pin, centre = motion.point(self.from_point, self.name), motion.point(self.pivot, self.name)
        slot = self.slot(motion)
        u, p, q = slot.direction, slot.first, slot.second
        slides = Sliding(slot.slide[1], self.lever)
        slider = LinkMotion(self.slider, self.from_point, self.tip, self.lengths_m[0], u, p, q, sliding=slides)
        lever = LinkMotion(self.lever, self.pivot, self.end, self.lengths_m[1], u, p, q)
        motion.add_link(slider, self.name)
        motion.add_link(lever, self.name)
        motion.add_point(self.end, lever.end_motion(centre), self.name)
        motion.add_point(self.tip, slider.end_motion(pin), self.name)

    def slot(self, motion: Motion) -> PinInSlot:
        """Express the pin's position in the slot over the motion."""
        pin, centre = motion.points[self.from_point], motion.points[self.pivot]
        for end, other, towards in ((pin, centre, -1.0), (centre, pin, 1.0)):
            if end.circle is not None and other.is_fixed:
                crank = CrankPivot(end.circle, other.fixed_position())
                if crank.ground_length > 0.0:
                    return self._on_crank(crank, towards)
        return self._between(pin, centre)

    def _on_crank(self, crank: CrankPivot, towards: float) -> PinInSlot:
        """Solve the slot for one fixed pin and one on a crank's end; d is `towards` times the vector between them."""
        e, shaft = self.offset_m, crank.circle.shaft
        g, r = crank.ground_length, crank.circle.radius
        exact_g, exact_r = crank.exact_lengths
        apart, exact_e = abs(exact_g - exact_r), exact(abs(e))
        clear = rounded((apart - exact_e) * (apart + exact_e))  # S0
        (c, k), squared = crank.half_angle, crank.distance_squared
        s_squared = squared if e == 0.0 else crank.swing * (square(k) + clear / crank.swing)
        s = self._sense * sqrt(s_squared)
        inverse, inverse_squared = 1.0 / s, 1.0 / squared
        rate = (0.5 * crank.swing) * (k * c * inverse)  # s' with respect to the crank angle
        bend = (g * r) * ((clear * (c * c) - (k * k) * s_squared) * inverse * (inverse * inverse))
        p = (r * ((2.0 * g) * (k * k) - crank.rise)) * inverse_squared
        q = (0.5 * crank.swing * crank.rise * rounded(exact_g + exact_r)) * (
            k * c * (inverse_squared * inverse_squared)
        )
        if e != 0.0:
            p = p + e * (rate * inverse_squared)
            q = q + e * ((bend - 2.0 * (rate * rate) * (s * inverse_squared)) * inverse_squared)
        w, v = shaft.first, shaft.second
        slide = s, rate * w, bend * (w * w) + rate * v
        d = towards * crank.apart
        return PinInSlot(squared, slide, self._along(d, s, squared), p * w, q * (w * w) + p * v)

    def _between(self, pin: PointMotion, centre: PointMotion) -> PinInSlot:
        """Solve the slot for any motion of the two pins, from the loop closure."""
        d, v, w = (getattr(pin, k) - getattr(centre, k) for k in ("position", "first", "second"))
        squared, e = d.dot(d), self.offset_m
        distance = sqrt(squared)
        s = self._sense * (distance if e == 0.0 else sqrt((distance - e) * (distance + e)))
        u = self._along(d, s, squared)
        n, inverse = u.turned_left(), 1.0 / s
        p = v.dot(n) * inverse
        rate = v.dot(u) + e * p
        q = (w.dot(n) - 2.0 * (p * rate) + e * (p * p)) * inverse
        return PinInSlot(squared, (s, rate, w.dot(u) + e * q + s * (p * p)), u, p, q)

    def _along(self, d: Vector, s: Expr, squared: Expr) -> Vector:
        """Compute the slot's unit vector u."""
        if self.offset_m == 0.0:
            return (1.0 / s) * d
        return (1.0 / squared) * (s * d - self.offset_m * d.turned_left())

    @property
    def _sense(self) -> float:
        return 1.0 if self.branch == "forward" else -1.0

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Require a pin farther from the pivot than its offset, and within the slot."""
        slot, e = self.slot(motion), self.offset_m
        how = f"the pin of '{self.slider}' comes to '{self.pivot}'" + (" within offset_m" if e else "")
        scale = float(values_over(slot.distance_squared, np.linspace(*motion.range_rad, _SAMPLES)).max())
        s_squared = slot.distance_squared - e * e if e else slot.distance_squared
        return Closure(how, s_squared, scale), *slot_ends(self.slider, slot.slide[0], self.slot_m)

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Take the angle between the slot's normal and the direction in which the lever moves the pin."""
        slot, e = self.slot(motion), abs(self.offset_m)
        smallest_s = math.sqrt(max(smallest[0], 0.0))
        most = math.sqrt(-smallest_value(-(slot.distance_squared - e * e), motion.range_rad)[1])
        distance = smallest_s * smallest_s / (e + math.hypot(smallest_s, e)) if e else smallest_s
        angles = (math.atan2(smallest_s, e), math.atan2(most, e)) if e else (math.pi / 2.0, math.pi / 2.0)
        return Transmission(distance, angles)

    def transmission_cosine(self, motion: Motion) -> Expr:
        """Express the cosine of the angle between the slot's normal and the direction in which the pin moves."""
        return self.offset_m / sqrt(self.slot(motion).distance_squared)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the turning joint of the lever and the sliding joint of the slider."""
        return pivot(motion, self.lever, self.pivot), guide(self.slider, (0.0, self.offset_m), (1.0, 0.0), self.lever)

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the force across the slot from the moments about the pivot; the pin bears the load along it."""
        motion = wrenches.motion
        slot = self.slot(motion)
        normal = slot.direction.turned_left()
        slider_force, slider_moment = wrenches.on(self.slider)
        lever_force, lever_moment = wrenches.on(self.lever)
        pressed = (-((slider_moment + lever_moment) / slot.slide[0])) * normal  # total force of the slider on the lever
        pin, centre = pressed - slider_force, -pressed - lever_force
        wrenches.guide_reactions[self.slider] = (slider_moment + lever_moment) / slot.slide[0]
        wrenches.transmitted[self.slider] = -slider_moment
        wrenches.add_reaction(self.from_point, pin)
        wrenches.add_reaction(self.pivot, centre)
        wrenches.pull_on_point(self.from_point, -pin)
        wrenches.pull_on_point(self.pivot, -centre)
