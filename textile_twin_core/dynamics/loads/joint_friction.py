"""Dry (Coulomb) friction at joints and guides, with a constant friction torque or force."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.dynamics.loads.load import LoadContext, Uneventful
from textile_twin_core.dynamics.loads.relative import check_other, link_of_load, relative_rate, turn_links
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, sign
from textile_twin_core.mechanism.motion import LinkMotion, Motion, Sliding
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class JointFriction(Uneventful):
    """A constant friction torque between two links, or a link and the ground, against their relative rotation.

    `link` turns relative to the link `against`, or to the ground if `against` is None. Friction at standstill is zero.

    Friction in proportion to the pin's force (pin radius, coefficient) is not available. That force depends on the
    friction itself, so there is no closed form and no exact second route to the torque.
    """

    link: str
    torque_Nm: float
    against: str | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.torque_Nm) and self.torque_Nm >= 0.0):
            raise MachineError(f"friction of '{self.link}': torque_Nm must be zero or positive, not {self.torque_Nm!r}")
        check_other(f"friction of '{self.link}'", self.link, self.against)

    def intensity(self, context: LoadContext) -> Expr:
        """Express the friction torque, opposed to the relative speed."""
        return self.torque_Nm * -sign(self.unit_force(context) * context.shaft.omega)

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the derivative of the relative angle."""
        return relative_rate(context.motion, self.link, self.against)

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply opposite moments to the two links."""
        turn_links(wrenches, self.link, self.against, intensity)


@dataclass(frozen=True)
class SliderFriction(Uneventful):
    """A constant friction force on a slider, against its velocity in the guide; the guide may move."""

    slider: str
    force_N: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.force_N) and self.force_N >= 0.0):
            raise MachineError(f"friction of '{self.slider}': force_N must be zero or positive, not {self.force_N!r}")

    def intensity(self, context: LoadContext) -> Expr:
        """Express the friction force, opposed to the slider's velocity."""
        return self.force_N * -sign(self.unit_force(context) * context.shaft.omega)

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the derivative of the slider's position along its guide."""
        return self._guided(context.motion)[1].first

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply a force along the guide to the slider, and its opposite to the guide's link."""
        link, sliding = self._guided(context.motion)
        force = intensity * link.direction
        wrenches.add_at(link, link.length * link.direction, force)
        if sliding.on is not None:
            points, carrier = context.motion.points, context.motion.links[sliding.on]
            lever = points[link.start].position - points[carrier.start].position
            wrenches.add_at(carrier, lever, -force)

    def _guided(self, motion: Motion) -> tuple[LinkMotion, Sliding]:
        """Return the slider and its motion. Raises MachineError for a link that does not slide along itself."""
        link = link_of_load(motion, self.slider)
        if link.sliding is None:
            raise MachineError(f"friction of '{self.slider}': this link is no slider; name one, or use joint_friction")
        return link, link.sliding
