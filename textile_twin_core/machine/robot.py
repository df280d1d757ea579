"""Builder of a robot description (URDF): links as bars, joints, and comments on undeclared values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

from textile_twin_core.dynamics.body import Body
from textile_twin_core.mechanism.joint import BASE

BAR_WIDTH_SHARE = 0.08
"""Width of the bars as a share of the longest link."""
_COLOURS = (
    "0.80 0.45 0.20 1",
    "0.25 0.50 0.75 1",
    "0.35 0.60 0.40 1",
    "0.55 0.40 0.65 1",
    "0.85 0.70 0.30 1",
)
_EFFORT = "1e6"
"""Largest force or torque of a joint, which URDF requires and machines do not declare."""


@dataclass(frozen=True)
class Limits:
    """Range of a joint in the machine: smallest and largest position [m or rad], largest speed [m/s or rad/s]."""

    lower: float
    upper: float
    velocity: float


class Robot:
    """Collection of links and joints; `world` -> `base` is a roll of +90 degrees, from z up to y up.

    Args:
        name: name of the robot.
        bar_width_m: width of the bars that represent links [m].
    """

    def __init__(self, name: str, bar_width_m: float) -> None:
        self._robot = Xml.Element("robot", name=name)
        self._width, self._bars = bar_width_m, 0
        self.frame("world")
        self.frame(BASE)
        self.joint("world_to_base", "fixed", "world", BASE, roll_rad=math.pi / 2)

    def text(self) -> str:
        """Return the whole description."""
        Xml.indent(self._robot)
        return '<?xml version="1.0"?>\n' + Xml.tostring(self._robot, encoding="unicode") + "\n"

    def frame(self, name: str) -> None:
        """Add a link without a body, as a frame."""
        Xml.SubElement(self._robot, "link", name=name)

    def bar(self, name: str, length_m: float, bodies: Sequence[Body]) -> None:
        """Add a link along its x axis, visible and with collision geometry, with the mass of its bodies."""
        element = Xml.SubElement(self._robot, "link", name=name)
        if not _inertial(element, bodies, length_m):
            element.append(Xml.Comment(f" no mass is declared for {name} "))
        shape = {"size": f"{length_m:.17g} {self._width:.6g} {self._width / 2:.6g}"}
        for purpose in ("visual", "collision"):
            part = Xml.SubElement(element, purpose)
            Xml.SubElement(part, "origin", xyz=f"{length_m / 2:.17g} 0 0", rpy="0 0 0")
            Xml.SubElement(Xml.SubElement(part, "geometry"), "box", shape)
            if purpose == "visual":
                material = Xml.SubElement(part, "material", name=f"{name}_paint")
                Xml.SubElement(material, "color", rgba=_COLOURS[self._bars % len(_COLOURS)])
        self._bars += 1

    def rod(self, name: str, length_m: float) -> None:
        """Add a round rod along its z axis, visible only."""
        part = Xml.SubElement(Xml.SubElement(self._robot, "link", name=name), "visual")
        Xml.SubElement(part, "origin", xyz=f"0 0 {length_m / 2:.17g}", rpy="0 0 0")
        shape = {"radius": f"{0.5 * self._width:.6g}", "length": f"{length_m:.17g}"}
        Xml.SubElement(Xml.SubElement(part, "geometry"), "cylinder", shape)

    def joint(
        self,
        name: str,
        kind: str,
        parent: str,
        child: str,
        place_m: tuple[float, float] = (0.0, 0.0),
        angle_rad: float = 0.0,
        limits: Limits | None = None,
        roll_rad: float = 0.0,
        z_m: float = 0.0,
    ) -> None:
        """Add a joint at a position and angle in its parent; it slides along its x axis or turns about its z axis."""
        element = Xml.SubElement(self._robot, "joint", name=name, type=kind)
        Xml.SubElement(element, "parent", link=parent)
        Xml.SubElement(element, "child", link=child)
        xyz = " ".join(f"{value:.17g}" for value in (*place_m, z_m))
        Xml.SubElement(element, "origin", xyz=xyz, rpy=f"{roll_rad:.17g} 0 {angle_rad:.17g}")
        if kind != "fixed":
            Xml.SubElement(element, "axis", xyz="1 0 0" if kind == "prismatic" else "0 0 1")
        if limits is not None:
            lower, upper, velocity = (f"{value:.12g}" for value in (limits.lower, limits.upper, limits.velocity))
            Xml.SubElement(element, "limit", lower=lower, upper=upper, effort=_EFFORT, velocity=velocity)


def _inertial(element: Xml.Element, bodies: Sequence[Body], length: float) -> bool:
    """Combine the bodies of a link into one inertial element; return False if they have no mass."""
    mass = sum(body.mass_kg for body in bodies)
    if mass == 0.0:
        return False
    along, across = (length / mass * sum(b.mass_kg * b.centroid[axis] for b in bodies) for axis in (0, 1))
    inertia = sum(
        b.inertia_kgm2 + b.mass_kg * math.hypot(b.centroid[0] * length - along, b.centroid[1] * length - across) ** 2
        for b in bodies
    )
    inertial = Xml.SubElement(element, "inertial")
    Xml.SubElement(inertial, "origin", xyz=f"{along:.17g} {across:.17g} 0", rpy="0 0 0")
    Xml.SubElement(inertial, "mass", value=f"{mass:.17g}")
    zz = f"{inertia:.17g}"
    Xml.SubElement(inertial, "inertia", ixx=zz, iyy=zz, izz=zz, ixy="0", ixz="0", iyz="0")
    return True
