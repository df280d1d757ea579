"""Friction at joints and guides: dry (Coulomb), with a friction torque or force that does not follow the reaction."""

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

    `link` turns against the link `against`, or against the ground where that is None. At rest there is no
    friction torque. Friction in proportion to the pin's force (pin radius, coefficient) is not offered: that
    force depends on the friction itself, so it has no closed form, and no exact second way to the torque.
    """

    link: str
    torque_Nm: float
    against: str | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.torque_Nm) and self.torque_Nm >= 0.0):
            raise MachineError(f"friction of '{self.link}': torque_Nm must be zero or positive, not {self.torque_Nm!r}")
        check_other(f"friction of '{self.link}'", self.link, self.against)

    def intensity(self, context: LoadContext) -> Expr:
        """The friction torque, against the relative speed."""
        return self.torque_Nm * -sign(self.unit_force(context) * context.shaft.omega)

    def unit_force(self, context: LoadContext) -> Expr:
        """The derivative of the relative angle."""
        return relative_rate(context.motion, self.link, self.against)

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Opposite moments on the two links."""
        turn_links(wrenches, self.link, self.against, intensity)


@dataclass(frozen=True)
class SliderFriction(Uneventful):
    """A constant friction force on a slider, against its velocity in the guide, which may move itself."""

    slider: str
    force_N: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.force_N) and self.force_N >= 0.0):
            raise MachineError(f"friction of '{self.slider}': force_N must be zero or positive, not {self.force_N!r}")

    def intensity(self, context: LoadContext) -> Expr:
        """The friction force, against the slider's velocity."""
        return self.force_N * -sign(self.unit_force(context) * context.shaft.omega)

    def unit_force(self, context: LoadContext) -> Expr:
        """The derivative of the slider's way along its guide."""
        return self._guided(context.motion)[1].first

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """A force on the slider along the guide, and its opposite on the link that the guide belongs to."""
        link, sliding = self._guided(context.motion)
        force = intensity * link.direction
        wrenches.add_at(link, link.length * link.direction, force)
        if sliding.on is not None:
            points, carrier = context.motion.points, context.motion.links[sliding.on]
            lever = points[link.start].position - points[carrier.start].position
            wrenches.add_at(carrier, lever, -force)

    def _guided(self, motion: Motion) -> tuple[LinkMotion, Sliding]:
        """The slider and its way. Raises MachineError for a link that does not slide along its own direction."""
        link = link_of_load(motion, self.slider)
        if link.sliding is None:
            raise MachineError(f"friction of '{self.slider}': this link is no slider; name one, or use joint_friction")
        return link, link.sliding
