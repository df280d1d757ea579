"""Joints of the robot description: the connections of a group's links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from textile_twin_core.mechanism.motion import Motion

BASE = "base"
Kind = Literal["continuous", "prismatic", "fixed"]


@dataclass(frozen=True)
class Joint:
    """A joint from `parent_link` to `child_link`, whose frames begin at the links' start points with x along the link.

    `origin_m` and `origin_angle_rad` place the joint in the parent's frame, and `axis` is a unit vector of that frame.
    The value of a continuous joint is the angle between the frames; the value of a prismatic joint is the slider's
    distance from the guide's point along the guide.
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
    """Return the joint by which a link slides along the line through a point in the direction of `axis`.

    Both are given in the frame of the guide's link `on`, or of the ground if `on` is None.
    """
    return Joint(link, "prismatic", on or BASE, link, point_m, axis=axis)
