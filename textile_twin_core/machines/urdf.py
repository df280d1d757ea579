"""URDF of a machine, from the same declaration as its mechanics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING
from xml.etree import ElementTree as Xml

from textile_twin_core.dynamics.body import Body
from textile_twin_core.machines.joints import BASE

if TYPE_CHECKING:
    from textile_twin_core.machines.machine import Machine

_BAR_WIDTH_SHARE = 0.08
_COLOURS = (
    "0.80 0.45 0.20 1",
    "0.25 0.50 0.75 1",
    "0.35 0.60 0.40 1",
    "0.55 0.40 0.65 1",
    "0.85 0.70 0.30 1",
)


def machine_urdf(machine: Machine) -> str:
    """A URDF text: `world` -> `base` is a roll of +90 degrees, since the machine's y is up and the world's z.

    Loops are cut; the twin publishes every joint, passive ones too, so that the loops stay closed.
    """
    robot = Xml.Element("robot", name=machine.name)
    Xml.SubElement(robot, "link", name="world")
    Xml.SubElement(robot, "link", name=BASE)
    _joint(robot, "world_to_base", "fixed", "world", BASE, "0 0 0", f"{math.pi / 2:.17g} 0 0")
    longest = max(link.length for link in machine.linkage.solved.links.values())
    for i, link in enumerate(machine.linkage.solved.links.values()):
        _link(robot, machine, link.name, link.length, longest * _BAR_WIDTH_SHARE, _COLOURS[i % len(_COLOURS)])
    for joint in machine.joints:
        slides = joint.kind == "prismatic"
        along = math.atan2(joint.axis[1], joint.axis[0]) if slides else joint.origin_angle_rad
        element = _joint(
            robot,
            joint.name,
            joint.kind,
            joint.parent_link,
            joint.child_link,
            f"{joint.origin_m[0]:.17g} {joint.origin_m[1]:.17g} 0",
            f"0 0 {along:.17g}",
        )
        if slides:
            reach = 10.0 * longest
            Xml.SubElement(element, "axis", xyz="1 0 0")
            Xml.SubElement(element, "limit", lower=f"{-reach:g}", upper=f"{reach:g}", effort="1e6", velocity="1e3")
        elif joint.kind == "continuous":
            Xml.SubElement(element, "axis", xyz="0 0 1")
    Xml.indent(robot)
    return '<?xml version="1.0"?>\n' + Xml.tostring(robot, encoding="unicode") + "\n"


def _joint(robot: Xml.Element, name: str, kind: str, parent: str, child: str, xyz: str, rpy: str) -> Xml.Element:
    element = Xml.SubElement(robot, "joint", name=name, type=kind)
    Xml.SubElement(element, "parent", link=parent)
    Xml.SubElement(element, "child", link=child)
    Xml.SubElement(element, "origin", xyz=xyz, rpy=rpy)
    return element


def _link(robot: Xml.Element, machine: Machine, name: str, length: float, width: float, colour: str) -> None:
    element = Xml.SubElement(robot, "link", name=name)
    _inertial(element, [body for body in machine.bodies if body.on == name], length)
    visual = Xml.SubElement(element, "visual")
    Xml.SubElement(visual, "origin", xyz=f"{length / 2:.17g} 0 0", rpy="0 0 0")
    geometry = Xml.SubElement(visual, "geometry")
    Xml.SubElement(geometry, "box", size=f"{length:.17g} {width:.6g} {width / 2:.6g}")
    material = Xml.SubElement(visual, "material", name=f"{name}_paint")
    Xml.SubElement(material, "color", rgba=colour)


def _inertial(element: Xml.Element, bodies: Sequence[Body], length: float) -> None:
    """All bodies of a link as one: URDF knows no more."""
    mass = sum(body.mass_kg for body in bodies)
    if mass == 0.0:
        return
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
