"""Linkage: ground points and a chain of groups on one shaft."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import const, cos, sin, variable
from textile_twin_core.mechanism.group import MAIN_SHAFT, Group, check_finite
from textile_twin_core.mechanism.joint import BASE, Joint
from textile_twin_core.mechanism.motion import FULL_TURN, Motion, PointMotion, Rotation, UnknownPartError
from textile_twin_core.mechanism.python_numbers import python_numbers
from textile_twin_core.mechanism.vector import Vector, unit_direction

THETA = variable("theta")
"""The angle of the main shaft [rad]."""


BEYOND_DYADS = (
    "together they are a triad or more (an Assur group of class III), beyond the class-II dyads whose motion has a "
    "closed form; drive the chain from another of its links, so that it falls into dyads, or give that part's measured "
    "motion as the table of a cam_follower"
)
_NEW_POINTS = ("end", "tip", "ends", "tips", "mesh", "mark")


@dataclass(frozen=True)
class Linkage:
    """Ground points [m] by name, and groups, each built on earlier points and links.

    `range_rad` is the range of the shaft angle over which the chain is used.

    Raises:
        MachineError: for a point that is not finite, an empty chain or a bad range; when solved, for a group that
            refers to an unknown part.
    """

    points: Mapping[str, tuple[float, float]]
    groups: tuple[Group, ...]
    range_rad: tuple[float, float] = FULL_TURN

    def __post_init__(self) -> None:
        for part in ("points", "groups"):
            object.__setattr__(self, part, python_numbers(getattr(self, part)))
        for name, (x, y) in self.points.items():
            check_finite(x, f"point '{name}': x")
            check_finite(y, f"point '{name}': y")
        if not self.groups:
            raise MachineError("a linkage needs at least one group, for example a crank")
        low, high = self.range_rad
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise MachineError(f"range_rad must be two rising, finite angles, not {self.range_rad!r}")

    def motion(self, phase_rad: float = 0.0) -> Motion:
        """Solve the motion of all points and links over theta, for a linkage mounted at a phase of the shaft."""
        try:
            return self.motion_in_order(phase_rad)
        except UnknownPartError as error:
            raise _in_order(self, error) from None

    def motion_in_order(self, phase_rad: float = 0.0) -> Motion:
        """Solve the motion as `motion` does. Raises UnknownPartError for a group that refers to a later group."""
        half = Vector(cos(0.5 * THETA), sin(0.5 * THETA)).rotated(*unit_direction(phase_rad / 2.0))
        motion = Motion(range_rad=self.range_rad)
        motion.rotations[MAIN_SHAFT] = Rotation(half, THETA + phase_rad, const(1.0), const(0.0))
        for name, (x, y) in self.points.items():
            motion.add_point(name, PointMotion.fixed(x, y), "ground")
        for group in self.groups:
            group.solve(motion)
        if MAIN_SHAFT in motion.links:
            raise MachineError(f"link '{MAIN_SHAFT}': this is the name of the shaft itself; call the link otherwise")
        return motion

    @cached_property
    def solved(self) -> Motion:
        """The motion at phase 0."""
        return self.motion()

    @property
    def pins(self) -> tuple[str, ...]:
        """Turning joints by point, in the order of the groups; free ends are not pins."""
        return tuple(dict.fromkeys(pin for group in self.groups for pin in group.pins))

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of the robot description, named by their links, parents before children."""
        return tuple(joint for group in self.groups for joint in group.joints(self.solved))

    @cached_property
    def shaft_link(self) -> str | None:
        """First link that turns about a fixed point with the main shaft, or None."""
        for joint in self.joints:
            turns = self.solved.links[joint.child_link].first
            if joint.parent_link == BASE and turns.is_constant and turns.value == 1.0:
                return joint.child_link
        return None


def _in_order(linkage: Linkage, error: MachineError) -> MachineError:
    """Word the error for a group that refers to a later part, or for groups that need each other."""
    waiting, order = list(linkage.groups), list[Group]()
    while waiting:
        ready = next((group for group in waiting if _solves([*order, group], linkage)), None)
        if ready is None:
            return _beyond_dyads(waiting, error)
        waiting.remove(ready)
        order.append(ready)
    names = ", ".join(group.name for group in order)
    return MachineError(f"{error}; a group must follow those that it builds on: put them in the order {names}")


def _solves(groups: list[Group], linkage: Linkage) -> bool:
    try:
        _ = Linkage(linkage.points, tuple(groups), linkage.range_rad).motion_in_order()
    except MachineError:
        return False
    return True


def _beyond_dyads(waiting: list[Group], error: MachineError) -> MachineError:
    """Word the error for a triad or more, where each group waits for a point of another one."""
    made = {name: group for group in waiting for name in _new_points(group)}
    if len(waiting) < 2 or not all(_words(group) & made.keys() - set(_new_points(group)) for group in waiting):
        return error
    names = " and ".join(f"'{group.name}'" for group in waiting)
    return MachineError(f"groups {names} need points of each other: {BEYOND_DYADS}")


def _new_points(group: Group) -> list[str]:
    return [word for key in _NEW_POINTS for word in _flat(getattr(group, key, ()))]


def _words(group: Group) -> set[str]:
    return {word for value in vars(group).values() for word in _flat(value)}


def _flat(value: object) -> list[str]:
    if isinstance(value, tuple):
        return [word for entry in value for word in _flat(entry)]
    return [value] if isinstance(value, str) else []
