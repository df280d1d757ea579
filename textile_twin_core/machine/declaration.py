"""Declaration of a linkage machine, with the checks that need no motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.body import Body
from textile_twin_core.dynamics.loads.load import Load
from textile_twin_core.errors import MachineError
from textile_twin_core.machine.declared import Declared
from textile_twin_core.machine.main_shaft import MainShaft, ShaftPlace
from textile_twin_core.machine.sensors import Scene, Sensors
from textile_twin_core.machine.sizes import computable
from textile_twin_core.mechanism import MAIN_SHAFT, Closeness, Group, Linkage, Measure, check_assembly
from textile_twin_core.mechanism.group import check_finite
from textile_twin_core.mechanism.joint import Joint
from textile_twin_core.mechanism.motion import FULL_TURN
from textile_twin_core.mechanism.python_numbers import python_numbers


class Link(NamedTuple):
    """A link of the skeleton, from one point to another."""

    name: str
    start: str
    end: str


@dataclass(frozen=True)
class Declaration(Declared):
    """Declaration of a machine with one degree of freedom; see `Machine` for its fields."""

    name: str
    points: Mapping[str, tuple[float, float]]
    groups: tuple[Group, ...]
    bodies: tuple[Body, ...] = ()
    loads: tuple[Load, ...] = ()
    measures: tuple[Measure, ...] = ()
    gravity_m_s2: tuple[float, float] = (0.0, -9.81)
    sensors: Sensors = field(default_factory=Sensors)
    linkages: tuple[ShaftPlace, ...] = (ShaftPlace(),)
    shaft: MainShaft | None = None
    tolerances: Mapping[str, float] = field(default_factory=dict)
    scene: Scene = field(default_factory=Scene)
    joint_names: Mapping[str, str] = field(default_factory=dict)
    angle_near_rad: Mapping[str, float] = field(default_factory=dict)
    transmitted: Mapping[str, str] = field(default_factory=dict)
    missing_for_torque: tuple[str, ...] = ()
    range_rad: tuple[float, float] = FULL_TURN
    nominal_speed_rad_s: float = 10.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    description: str = ""

    def __post_init__(self) -> None:
        if not self.linkages:
            raise MachineError(f"machine '{self.name}': it needs at least one linkage on its shaft")
        for part in ("points", "groups", "bodies", "loads", "measures", "gravity_m_s2", "linkages"):
            object.__setattr__(self, part, python_numbers(getattr(self, part)))
        self._check_shaft()
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))
        object.__setattr__(self, "tolerances", MappingProxyType(dict(self.tolerances)))
        for path, value in self.tolerances.items():
            if not (math.isfinite(value) and value > 0.0):
                raise MachineError(f"tolerances.{path}: give a positive relative standard deviation, not {value!r}")
        with computable(f"machine '{self.name}'"):
            names = _default_joint_names(self.linkage) | dict(self.joint_names)
            object.__setattr__(self, "joint_names", MappingProxyType(names))
            self._check_names_and_numbers()
            _ = self.closeness

    def _check_shaft(self) -> None:
        """Raise MachineError for a linkage without a station of the shaft, or with one on a rigid shaft."""
        shaft = self.shaft
        if shaft is None:
            for k, place in enumerate(self.linkages):
                if place.at is not None:
                    raise MachineError(
                        f"linkages[{k}].at: '{place.at}' is a station, but there is no shaft with stations"
                    )
            return
        for k, place in enumerate(self.linkages):
            if place.at is None:
                raise MachineError(
                    f"linkages[{k}]: key 'at' is missing; name the station of the shaft that carries it: "
                    f"{', '.join(shaft.names[:6])}{', ..' if len(shaft.names) > 6 else ''}"
                )
            station = shaft.station(place.at, f"linkages[{k}].at")
            first = shaft.station(self.linkages[0].at, "linkages[0].at")
            if not math.isclose(shaft.speed_ratios[station], shaft.speed_ratios[first], rel_tol=1e-12):
                raise MachineError(
                    f"linkages[{k}].at: a gear between '{place.at}' and '{self.linkages[0].at}' gives their linkages"
                    " two speeds; all linkages of a machine turn with the main shaft"
                )

    def _check_names_and_numbers(self) -> None:
        links = tuple(self.linkage.solved.links)
        arms = tuple(joint.child_link for joint in self.linkage.joints if joint.kind != "continuous")
        self._check_known("joint_names", self.joint_names, "link", links)
        self._check_known("angle_near_rad", self.angle_near_rad, "link", links)
        self._check_known("transmitted", self.transmitted.values(), "rigid arm or slider", arms)
        for value in self.gravity_m_s2:
            check_finite(value, f"machine '{self.name}': gravity_m_s2")
        for link, value in self.angle_near_rad.items():
            check_finite(value, f"machine '{self.name}': angle_near_rad of '{link}'")
        if not (math.isfinite(self.nominal_speed_rad_s) and self.nominal_speed_rad_s > 0.0):
            raise MachineError(
                f"machine '{self.name}': nominal_speed_rad_s must be a positive speed, not {self.nominal_speed_rad_s!r}"
            )

    def _check_known(self, what: str, names: Iterable[str], kind: str, known: Sequence[str]) -> None:
        for name in names:
            if name not in known:
                raise MachineError(
                    f"machine '{self.name}': {what} names '{name}', which is no {kind}; "
                    f"available: {', '.join(known) or 'none'}"
                )

    @cached_property
    def linkage(self) -> Linkage:
        """Points and groups alone."""
        return Linkage(self.points, self.groups, self.range_rad)

    @cached_property
    def closeness(self) -> tuple[Closeness, ...]:
        """Distance of each group from a change point, and its transmission angle."""
        try:
            return self._closeness_by_place()[0]
        except MachineError as error:
            raise MachineError(f"machine '{self.name}': {error}") from None

    def _closeness_by_place(self) -> list[tuple[Closeness, ...]]:
        """Measure the closeness of each linkage over its own crank angles; over a full turn all are equal."""
        low, high = self.range_rad
        if self.linkage.solved.turns_fully:
            return [check_assembly(self.linkage)]
        turned = [(low + place.phase_rad, high + place.phase_rad) for place in self.linkages]
        return [check_assembly(replace(self.linkage, range_rad=angles)) for angles in turned]

    def shaft_angles(self, count: int) -> FloatArray:
        """Return (count,) evenly spaced shaft angles [rad]: a full turn from 0, or a part of a turn without its ends.

        At the ends of a part of a turn a linkage may lie in one line, where its motion is undetermined.
        """
        steps = np.arange(count, dtype=np.float64)
        if self.linkage.solved.turns_fully:
            return steps * (2.0 * math.pi / count)
        low, high = self.range_rad
        return low + (high - low) * ((steps + 0.5) / count)

    @property
    def links(self) -> tuple[Link, ...]:
        """Skeleton for drawing."""
        return tuple(Link(k.name, k.start, k.end) for k in self.linkage.solved.links.values())

    @property
    def point_names(self) -> tuple[str, ...]:
        """All points, fixed and moving."""
        return tuple(self.linkage.solved.points)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of the robot description, passive ones included."""
        return _named_joints(self.linkage, self.joint_names)

    @property
    def choices(self) -> Mapping[str, str]:
        """Empty: parameters of linkages are numbers."""
        return {}

    @property
    def tools(self) -> Mapping[str, str]:
        """Point whose displacement each measure gives, by the measure's name."""
        return {measure.name: measure.tool(self.linkage.solved) for measure in self.measures}


def _default_joint_names(linkage: Linkage) -> dict[str, str]:
    """Name the joint of each link that moves on its own: after the shaft for its first link, else after the link."""
    names = {joint.child_link: joint.name for joint in linkage.joints if joint.kind != "fixed"}
    return names if linkage.shaft_link is None else names | {linkage.shaft_link: MAIN_SHAFT}


def _named_joints(linkage: Linkage, names: Mapping[str, str]) -> tuple[Joint, ...]:
    """Return the joints of a linkage, renamed by link."""
    return tuple(
        joint if joint.kind == "fixed" else replace(joint, name=names[joint.child_link]) for joint in linkage.joints
    )
