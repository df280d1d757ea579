"""Relative rotation of a link and another link or the ground, and a moment between the two."""

from __future__ import annotations

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const
from textile_twin_core.mechanism import LinkMotion, Motion
from textile_twin_core.mechanism.vector import ZERO, Vector
from textile_twin_core.mechanism.wrenches import Wrenches


def check_other(what: str, link: str, against: str | None) -> None:
    """Raise MachineError for a load between a link and itself, which has no effect."""
    if against == link:
        raise MachineError(f"{what}: against must be another link than '{link}' itself; leave it out for the ground")


def link_of_load(motion: Motion, name: str) -> LinkMotion:
    """Return the link that a load names. Raises MachineError with the known links."""
    link = motion.links.get(name)
    if link is None:
        raise MachineError(f"a load names link '{name}', which is not there; links: {', '.join(motion.links)}")
    return link


def relative_rate(motion: Motion, link: str, against: str | None) -> Expr:
    """Express the derivative, with respect to the shaft angle, of the link's angle minus that of the other."""
    other = const(0.0) if against is None else link_of_load(motion, against).first
    return link_of_load(motion, link).first - other


def relative_motion(motion: Motion, link: str, against: str | None) -> LinkMotion:
    """Express the motion of the link relative to the other."""
    one = link_of_load(motion, link)
    if against is None:
        return one
    two = link_of_load(motion, against)
    u, v = two.direction, one.direction
    direction = Vector(u.dot(v), u.cross(v))
    return LinkMotion(
        one.name, one.start, one.end, one.length, direction, one.first - two.first, one.second - two.second
    )


def turn_links(wrenches: Wrenches, link: str, against: str | None, torque: Expr) -> None:
    """Apply a moment to the link, counter-clockwise, and its opposite to the other."""
    wrenches.add(link, ZERO, torque)
    if against is not None:
        wrenches.add(against, ZERO, -torque)
