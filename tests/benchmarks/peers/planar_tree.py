"""A linkage as rigid-body engines want it: a tree of turning and sliding joints, its loops cut open at pins."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import Backing, Body
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import MAIN_SHAFT, Crank, RigidArm, RRPDyad, RRRDyad, Travel
from textile_twin_core.twin import compile_machine

Point = tuple[float, float]
ComplexArray = npt.NDArray[np.complex128]
GROUND = -1
_NODES = 1024


@dataclass(frozen=True)
class TreeJoint:
    """A joint at `at` on its parent (GROUND or an index) and the rigid body behind it.

    It turns about z, or slides along `axis` without turning. Mass [kg], centroid [m] in the joint's frame, inertia
    about the centroid [kg m^2].
    """

    name: str
    parent: int
    at: Point
    axis: Point | None = None
    mass_kg: float = 0.0
    centroid_m: Point = (0.0, 0.0)
    inertia_kgm2: float = 0.0

    def carrying(self, mass_kg: float, centroid: Point, inertia_kgm2: float) -> TreeJoint:
        """The same joint with one more body fixed to its link (Steiner's theorem)."""
        mass = self.mass_kg + mass_kg
        if mass == 0.0:
            return replace(self, inertia_kgm2=self.inertia_kgm2 + inertia_kgm2)
        (x, y), (u, v) = self.centroid_m, centroid
        centre = ((self.mass_kg * x + mass_kg * u) / mass, (self.mass_kg * y + mass_kg * v) / mass)
        apart = self.mass_kg * mass_kg / mass * ((x - u) ** 2 + (y - v) ** 2)
        inertia = self.inertia_kgm2 + inertia_kgm2 + apart
        return replace(self, mass_kg=mass, centroid_m=centre, inertia_kgm2=inertia)


@dataclass(frozen=True)
class Cut:
    """A pin cut open: a point of the later body stays on a point of the earlier one; points body-fixed [m]."""

    name: str
    later: int
    at_later: Point
    earlier: int
    at_earlier: Point


@dataclass(frozen=True)
class Needle:
    """The travel of a point of a sliding body, and the friction of the backing on it."""

    output: str
    body: int
    at: Point
    origin: Point
    direction: Point
    sense: float
    backing: Backing

    def friction(self, travel: float, slope: float, omega: float) -> float:
        """Torque on the shaft against the friction [N m], by a test on the travel [m]; slope is d travel/d theta."""
        speed = slope * omega
        if speed == 0.0:
            return 0.0
        b = self.backing
        inside = travel >= (b.entry_plane_m if speed > 0.0 else b.exit_plane_m)
        return math.copysign(b.force_N if inside else b.free_force_N, speed) * slope


@dataclass
class PlanarTree:
    """The tree; joint 0 is the driven one.

    `links` tells the body of every link; `start` holds joint positions over a turn: where a search begins.
    """

    gravity: Point
    joints: list[TreeJoint] = field(default_factory=list)
    cuts: list[Cut] = field(default_factory=list)
    links: dict[str, int] = field(default_factory=dict)
    needle: Needle | None = None
    start: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def near(self, theta: float) -> FloatArray:
        """Return joint positions [rad, m] within 1e-5 of the assembly at theta, from the table."""
        place = theta % (2.0 * math.pi) * (_NODES / (2.0 * math.pi))
        k = min(int(place), _NODES - 1)
        q: FloatArray = self.start[k] + (place - k) * (self.start[k + 1] - self.start[k])
        q[0] = theta
        return q

    def frames(self) -> tuple[list[ComplexArray], list[FloatArray]]:
        """Return origins [m], as complex numbers, and angles [rad] of the joints' frames over the turn of `start`."""
        origins: list[ComplexArray] = []
        angles: list[FloatArray] = []
        for j, q in zip(self.joints, self.start.T, strict=True):
            fixed = j.parent == GROUND
            angle = np.zeros(q.size) if fixed else angles[j.parent]
            at = complex(*j.at) * np.exp(1j * angle) + (0.0 if fixed else origins[j.parent])
            origins.append(at if j.axis is None else at + q * complex(*j.axis))
            angles.append(angle + q if j.axis is None else angle)
        return origins, angles


def planar_tree(machine: Machine) -> PlanarTree | None:
    """Convert the machine to a tree; None if it has parts other than rigid bodies, pins and sliders."""
    loads = machine.loads
    simple = len(machine.linkages) == 1 and machine.linkages[0].phase_rad == 0.0
    if not simple or len(loads) > 1 or not all(isinstance(load, Backing) for load in loads):
        return None
    tree = PlanarTree(machine.gravity_m_s2)
    places: dict[str, tuple[int, Point]] = {name: (GROUND, at) for name, at in machine.points.items()}
    links: dict[str, tuple[int, Point]] = {}  # joint, and the vector of the link on it
    for group in machine.groups:
        if not _add(tree, group, places, links):
            return None
    tree.links = {name: on for name, (on, _) in links.items()}
    for body in machine.bodies:
        _carry(tree, body, links)
    if loads:
        tree.needle = _needle(tree, machine, places)
        if tree.needle is None:
            return None
    tree.start = _start(tree, machine, links)
    return tree


def _add(
    tree: PlanarTree, group: object, places: dict[str, tuple[int, Point]], links: dict[str, tuple[int, Point]]
) -> bool:
    def joint(name: str, parent: int, at: Point, axis: Point | None = None) -> int:
        tree.joints.append(TreeJoint(name, parent, at, axis))
        return len(tree.joints) - 1

    def link(name: str, on: int, vector: Point) -> None:
        links[name] = (on, vector)

    match group:
        case Crank() if group.driven_by == MAIN_SHAFT and group.phase_rad == 0.0 and not tree.joints:
            crank = joint(group.at, *places[group.at])
            link(group.name, crank, (group.length_m, 0.0))
            places[group.end] = (crank, (group.length_m, 0.0))
        case RRRDyad():
            first, second = group.lengths_m
            coupler = joint(group.from_point, *places[group.from_point])
            rocker = joint(group.ground, *places[group.ground])
            link(group.coupler, coupler, (first, 0.0))
            link(group.rocker, rocker, (second, 0.0))
            places[group.end] = (rocker, (second, 0.0))
            tree.cuts.append(Cut(group.end, rocker, (second, 0.0), coupler, (first, 0.0)))
        case RigidArm() if group.on in links:
            on, (x, y) = links[group.on]
            angle = math.atan2(y, x) + group.angle_rad
            vector = (group.length_m * math.cos(angle), group.length_m * math.sin(angle))
            link(group.name, on, vector)
            places[group.end] = (on, vector)
        case RRPDyad() if group.guide_on is None:
            length, reach = group.lengths_m
            norm = math.hypot(*group.guide_direction)
            axis = (group.guide_direction[0] / norm, group.guide_direction[1] / norm)
            rod = joint(group.from_point, *places[group.from_point])
            slider = joint("guide", GROUND, group.guide_point_m, axis)
            link(group.rod, rod, (length, 0.0))
            link(group.slider, slider, (reach * axis[0], reach * axis[1]))
            places[group.end] = (rod, (length, 0.0))
            places[group.tip] = (slider, (reach * axis[0], reach * axis[1]))
            tree.cuts.append(Cut(group.end, slider, (0.0, 0.0), rod, (length, 0.0)))
        case _:
            return False
    return True


def _carry(tree: PlanarTree, body: Body, links: dict[str, tuple[int, Point]]) -> None:
    if body.is_flywheel:
        tree.joints[0] = tree.joints[0].carrying(0.0, (0.0, 0.0), body.inertia_kgm2)
        return
    on, (x, y) = links[body.on]
    s, t = body.centroid
    tree.joints[on] = tree.joints[on].carrying(body.mass_kg, (s * x - t * y, s * y + t * x), body.inertia_kgm2)


def _needle(tree: PlanarTree, machine: Machine, places: dict[str, tuple[int, Point]]) -> Needle | None:
    backing = machine.loads[0]
    measure = next((m for m in machine.measures if isinstance(backing, Backing) and m.name == backing.on), None)
    if not isinstance(measure, Travel) or not isinstance(backing, Backing):
        return None
    body, at = places[measure.point]
    origin, axis = places[measure.origin], tree.joints[body].axis
    norm = math.hypot(*measure.direction)
    direction = (measure.direction[0] / norm, measure.direction[1] / norm)
    if axis is None or origin[0] != GROUND:
        return None
    sense = axis[0] * direction[0] + axis[1] * direction[1]
    return Needle(f"{measure.name}_position_m", body, at, origin[1], direction, sense, backing)


def _start(tree: PlanarTree, machine: Machine, links: dict[str, tuple[int, Point]]) -> FloatArray:
    """Compute joint positions at equally spaced angles of a turn, both ends included: shape (nodes + 1, joints)."""
    theta = np.linspace(0.0, 2.0 * np.pi, _NODES + 1)
    names = [f"point_{p}_{axis}_m" for p in machine.point_names for axis in "xy"]
    found = compile_machine(machine, names, "exact").evaluate(theta, 0.0, 0.0)
    at = {p: found[f"point_{p}_x_m"] + 1j * found[f"point_{p}_y_m"] for p in machine.point_names}
    ends = {link.name: (link.start, link.end) for link in machine.links}
    turned = {GROUND: np.zeros(theta.size)}
    start = np.empty((theta.size, len(tree.joints)))
    for on, joint in enumerate(tree.joints):
        name, vector = next((name, vector) for name, (body, vector) in links.items() if body == on)
        begin, end = (at[p] for p in ends[name])
        if joint.axis is None:
            turned[on] = np.unwrap(np.angle((end - begin) / complex(*vector)))
            start[:, on] = turned[on] - turned[joint.parent]
        else:
            turned[on] = turned[GROUND]
            start[:, on] = ((begin - complex(*joint.at)) * np.conj(complex(*joint.axis))).real
    return start
