"""Joints of the robot description: the connections of a group's links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from textile_twin_core.mechanism.motion import Motion

BASE = "base"
Kind = Literal["continuous", "prismatic", "fixed"]


@dataclass(frozen=True)
class Joint:
    """A joint between two links, whose frames begin at the links' start points with x along the link.

    Attributes:
        name: name of the joint.
        kind: continuous, revolute or prismatic, as in a URDF.
        parent_link: link that carries the joint.
        child_link: link that moves. The value of a continuous joint is the angle between the frames [rad]; that of a
            prismatic joint is the slider's distance from the guide's point along the guide [m].
        origin_m: position of the joint in the parent's frame [m].
        origin_angle_rad: angle of the joint in the parent's frame [rad].
        axis: unit vector of the parent's frame, along which a slider moves.

    Examples:
        >>> from textile_twin_core.mechanism.joint import guide
        >>> guide("bar", (0.0, 0.0), (1.0, 0.0)).kind
        'prismatic'
    """

    name: str
    kind: Kind
    parent_link: str
    child_link: str
    origin_m: tuple[float, float]
    origin_angle_rad: float = 0.0
    axis: tuple[float, float] = (1.0, 0.0)


def pivot(motion: Motion, link: str, point: str) -> Joint:
    """Return the joint by which a link turns about a point of the ground, or about the end of an earlier link."""
    carrier = motion.carrier(point)
    if carrier is None:
        return Joint(link, "continuous", BASE, link, motion.points[point].fixed_position())
    return Joint(link, "continuous", carrier[0].name, link, (carrier[1], 0.0))


def guide(link: str, point_m: tuple[float, float], axis: tuple[float, float], on: str | None = None) -> Joint:
    """Return the joint by which a link slides along a line.

    Args:
        link: the link that slides.
        point_m: a point of the line [m], in the frame of the guide's link.
        axis: direction of the line in that frame.
        on: link of the guide; None for the ground.

    Returns:
        The prismatic joint.

    Examples:
        >>> from textile_twin_core.mechanism.joint import guide
        >>> guide("bar", (0.0, 0.1), (1.0, 0.0)).child_link
        'bar'
    """
    return Joint(link, "prismatic", on or BASE, link, point_m, axis=axis)
