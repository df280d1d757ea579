"""Forces and moments on the links, accumulated while the Newton-Euler equations are solved from the outside in."""

from __future__ import annotations

from dataclasses import dataclass, field

from textile_twin_core.expression import Expr, const
from textile_twin_core.mechanism.motion import LinkMotion, Motion
from textile_twin_core.mechanism.vector import ZERO, Vector


@dataclass
class Wrenches:
    """Sum of applied and inertia forces per link, and their moment about the link's start point.

    A group takes what acts on its links with `on`, and passes on what its joints carry with `pull_on_point` and
    `add_reaction`.

    Attributes:
        motion: the linkage's motion.
        force: forces by link [N].
        moment: moments about the link's start point, by link [N m].
        torque_on: moments on turning shafts, by shaft [N m].
        reactions: solved joint forces, by pin [N].
        guide_reactions: guide forces on sliders, positive to the left of their direction, by link [N].
        transmitted: moments passed on by a rigid arm or slider, by link [N m].
        contacts: forces by which groups press on each other, by output [N].

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.mechanism.wrenches import Wrenches
        >>> Wrenches(ttc.machines.tufting().linkage.solved).reactions
        {}
    """

    motion: Motion
    force: dict[str, Vector] = field(default_factory=dict)
    moment: dict[str, Expr] = field(default_factory=dict)
    torque_on: dict[str, Expr] = field(default_factory=dict)
    reactions: dict[str, Vector] = field(default_factory=dict)
    guide_reactions: dict[str, Expr] = field(default_factory=dict)
    transmitted: dict[str, Expr] = field(default_factory=dict)
    contacts: dict[str, Expr] = field(default_factory=dict)

    def on(self, link: str) -> tuple[Vector, Expr]:
        """Return the accumulated force and moment on a link."""
        return self.force.get(link, ZERO), self.moment.get(link, const(0.0))

    def add(self, link: str, force: Vector, moment: Expr) -> None:
        """Add a force and its moment about the link's start point."""
        f, m = self.on(link)
        self.force[link], self.moment[link] = f + force, m + moment

    def add_at(self, link: LinkMotion, lever: Vector, force: Vector) -> None:
        """Add a force that acts at `lever` from the link's start point."""
        self.add(link.name, force, lever.cross(force))

    def pull_on_point(self, point: str, force: Vector) -> None:
        """Apply a force to the link that carries a joint; forces on the ground are dropped."""
        carrier = self.motion.carrier(point)
        if carrier is not None:
            link, along = carrier
            self.add_at(link, along * link.direction, force)

    def add_torque(self, shaft: str, torque: Expr) -> None:
        """Add a moment on a turning shaft."""
        self.torque_on[shaft] = self.torque_on.get(shaft, const(0.0)) + torque

    def add_reaction(self, pin: str, force: Vector) -> None:
        """Add the force that the ground, or the first link at a pin, exerts on a link that turns on that pin."""
        self.reactions[pin] = self.reactions.get(pin, ZERO) + force
