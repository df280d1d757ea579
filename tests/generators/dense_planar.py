"""Any class-II linkage as bodies and constraints, with one dense Newton-Euler system per sample.

The coordinates are start point and angle of every link. The constraints, differentiated twice by the complex step, give
positions (by Newton's method) and both derivatives. The unknown forces of all joints and the torque on the shaft follow
from one linear system of three equations per link, without closed forms and without a division into groups.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import (
    MAIN_SHAFT,
    Crank,
    GearPair,
    PRPDyad,
    RigidArm,
    RPPDyad,
    RPRDyad,
    RRPDyad,
    RRRDyad,
)

Array = npt.NDArray[Any]
GROUND = -1
_STEP = 1e-30


def turned(angle: Any, vector: complex) -> Array:
    """Rotate a vector by an angle, which may be complex for the complex step."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector.real - s * vector.imag, s * vector.real + c * vector.imag])


@dataclass(frozen=True)
class Pin:
    """Points of two links coincide; for the ground (GROUND) the second is a position."""

    name: str
    one: int
    at_one: complex
    two: int
    at_two: complex


@dataclass(frozen=True)
class Slide:
    """A link's start lies on a line of another link, and the link points along that line."""

    name: str
    slider: int
    carrier: int
    place: complex
    angle: float


@dataclass(frozen=True)
class Mesh:
    """Gears in mesh, touching at `share` of the centre line.

    The constant is angle(driven) - (1 - k) angle(carrier) - k angle(driver).
    """

    name: str
    driven: int
    driver: int | None
    shaft: bool
    at_name: str
    carrier: int
    k: float
    share: float
    at: tuple[int, complex]
    driven_at: tuple[int, complex]


@dataclass(frozen=True)
class Same:
    """Two links with a constant relative angle; a driven link keeps its angle to the shaft (`one` is None)."""

    one: int | None
    two: int


@dataclass
class Dense:
    """A machine of one linkage at phase 0."""

    machine: Machine
    links: list[str] = field(default_factory=list)
    joints: list[Pin | Slide | Mesh | Same] = field(default_factory=list)

    def __post_init__(self) -> None:
        places: dict[str, tuple[int, complex]] = {
            name: (GROUND, complex(*at)) for name, at in self.machine.points.items()
        }
        ends = {link.name: (link.start, link.end) for link in self.machine.links}
        lengths = {name: link.length for name, link in self.machine.linkage.solved.links.items()}

        def add(name: str, start: str | None = None) -> int:
            self.links.append(name)
            here = len(self.links) - 1
            if start is not None:
                self.joints.append(Pin(start, here, 0j, *places[start]))
            return here

        def number(name: str | None) -> int:
            return GROUND if name is None else self.links.index(name)

        for group in self.machine.groups:
            match group:
                case Crank():
                    here = add(group.name, group.at)
                    self.joints.append(Same(None if group.driven_by == MAIN_SHAFT else number(group.driven_by), here))
                    places[group.end] = (here, complex(group.length_m))
                case RigidArm():
                    here, on = add(group.name), number(group.on)
                    self.joints += [Pin(f"{group.name} mount", here, 0j, on, 0j), Same(on, here)]
                    places[group.end] = (here, complex(group.length_m))
                case RRRDyad():
                    one, two = add(group.coupler, group.from_point), add(group.rocker, group.ground)
                    b, c = group.lengths_m
                    self.joints.append(Pin(group.end, two, complex(c), one, complex(b)))
                    places[group.end] = (two, complex(c))
                case RRPDyad():
                    rod, slider = add(group.rod, group.from_point), add(group.slider)
                    self.joints += [
                        Pin(group.end, slider, 0j, rod, complex(group.lengths_m[0])),
                        self._slide(slider, number(group.guide_on), group.guide_point_m, group.guide_direction),
                    ]
                    places[group.end], places[group.tip] = (rod, complex(group.lengths_m[0])), (slider, 0j)
                case RPRDyad():
                    slider, lever = add(group.slider, group.from_point), add(group.lever, group.pivot)
                    self.joints.append(Slide(group.slider, slider, lever, 1j * group.offset_m, 0.0))
                    places[group.end] = (lever, complex(group.lengths_m[1]))
                    places[group.tip] = (slider, complex(group.lengths_m[0]))
                case RPPDyad():
                    block, slider = add(group.block, group.from_point), add(group.slider)
                    on = number(group.guide_on)
                    self.joints += [
                        self._slide(slider, on, group.guide_point_m, group.guide_direction),
                        Slide(group.block, block, slider, 0j, group.slot_angle_rad),
                    ]
                    places[group.end] = (slider, 0j)
                    places[group.tips[0]] = (block, complex(group.lengths_m[0]))
                    places[group.tips[1]] = (slider, complex(group.lengths_m[1]))
                case PRPDyad():
                    one, two = add(group.sliders[0]), add(group.sliders[1])
                    self.joints.append(Pin(group.end, two, 0j, one, 0j))
                    for here, guide in zip((one, two), group.guides, strict=True):
                        self.joints.append(self._slide(here, number(guide.on), guide.point_m, guide.direction))
                    places[group.end] = (one, 0j)
                    for here, tip, length in zip((one, two), group.tips, group.lengths_m, strict=True):
                        places[tip] = (here, complex(length))
                case GearPair():
                    here = add(group.driven, group.driven_at)
                    z1, z2 = group.teeth[0], group.teeth[1] * (-1 if group.internal else 1)
                    carrier = next(
                        (k for k, n in enumerate(self.links) if {*ends[n]} == {group.at, group.driven_at}), GROUND
                    )
                    driver = self.links.index(group.driver) if group.driver in self.links else None
                    at = places[group.at]
                    if driver is not None and driver != at[0]:
                        name = self.links[driver]
                        at = (driver, 0j if ends[name][0] == group.at else complex(lengths[name]))
                    mesh = Mesh(
                        group.mesh,
                        here,
                        driver,
                        group.driver == MAIN_SHAFT,
                        group.at,
                        carrier,
                        -z1 / z2,
                        z1 / (z1 + z2),
                        at,
                        places[group.driven_at],
                    )
                    self.joints.append(mesh)
                    places[group.end] = (here, complex(group.length_m))
                case _:
                    raise NotImplementedError(type(group).__name__)
        self._ends = ends

    def _slide(self, slider: int, carrier: int, point: tuple[float, float], direction: tuple[float, float]) -> Slide:
        return Slide(self.links[slider], slider, carrier, complex(*point), cmath.phase(complex(*direction)))

    def point(self, q: Array, link: int, at: complex) -> Array:
        if link == GROUND:
            return np.array([at.real, at.imag])
        return np.asarray(q[3 * link : 3 * link + 2] + turned(q[3 * link + 2], at))

    def angle(self, q: Array, link: int) -> Any:
        return 0.0 if link == GROUND else q[3 * link + 2]

    def residual(self, q: Array, theta: Any, offsets: dict[int, Any]) -> Array:
        """Compute the residual of the constraints; `offsets` holds the constant angles of meshes and welds."""
        rows: list[Any] = []
        for k, joint in enumerate(self.joints):
            match joint:
                case Pin():
                    rows += list(self.point(q, joint.one, joint.at_one) - self.point(q, joint.two, joint.at_two))
                case Slide():
                    line = self.angle(q, joint.carrier) + joint.angle
                    way = q[3 * joint.slider : 3 * joint.slider + 2] - self.point(q, joint.carrier, joint.place)
                    rows += [turned(line, 1j) @ way, q[3 * joint.slider + 2] - line - offsets[k]]
                case Mesh():
                    driver = theta if joint.shaft else 0.0 if joint.driver is None else q[3 * joint.driver + 2]
                    carried = (1.0 - joint.k) * self.angle(q, joint.carrier)
                    rows.append(q[3 * joint.driven + 2] - carried - joint.k * driver - offsets[k])
                case Same():
                    other = theta if joint.one is None else q[3 * joint.one + 2]
                    rows.append(q[3 * joint.two + 2] - other - offsets[k])
        return np.array(rows)

    def slopes(self, q: Array, theta: float, offsets: dict[int, Any]) -> tuple[Array, Array]:
        """Compute the Jacobian by q and the derivative by theta with the complex step."""
        columns = []
        for k in range(q.size):
            nudged = q.astype(complex)
            nudged[k] += 1j * _STEP
            columns.append(self.residual(nudged, theta, offsets).imag / _STEP)
        return np.array(columns).T, self.residual(q.astype(complex), theta + 1j * _STEP, offsets).imag / _STEP

    def bend(self, q: Array, q1: Array, theta: float, offsets: dict[int, Any]) -> Array:
        """Compute the second derivative of the residual along (q1, 1)."""
        jets = np.array([Jet(a, b) for a, b in zip(q, q1, strict=True)], dtype=object)
        return np.array([float(getattr(row, "second", 0.0)) for row in self.residual(jets, Jet(theta, 1.0), offsets)])

    def assembled(self, guess: Array, theta: float, offsets: dict[int, Any]) -> Array:
        """Solve the coordinates at theta by Newton's method."""
        q = guess.copy()
        for _ in range(20):
            jacobian, _ = self.slopes(q, theta, offsets)
            step = np.linalg.solve(jacobian, self.residual(q, theta, offsets))
            q = q - step
            if np.abs(step).max() < 1e-15 * max(1.0, np.abs(q).max()):
                break
        return np.asarray(q)

    def forces(
        self, q: Array, theta: float, omega: float, alpha: float, offsets: dict[int, Any]
    ) -> tuple[dict[str, Array], float]:
        """Solve the force of every joint on its first link (pins: x, y; slides: across, moment), and the torque."""
        jacobian, by_theta = self.slopes(q, theta, offsets)
        q1 = -np.linalg.solve(jacobian, by_theta)
        q2 = -np.linalg.solve(jacobian, self.bend(q, q1, theta, offsets))
        gravity = np.array(self.machine.gravity_m_s2)
        right = np.zeros(q.size)  # mass times acceleration less weight, with moments about each link's start
        for body in self.machine.bodies:
            k = self.links.index(body.on)
            length = self.machine.linkage.solved.links[body.on].length
            lever = turned(q[3 * k + 2], complex(*body.centroid) * length)
            left = np.array([-lever[1], lever[0]])
            p, b = q1[3 * k + 2], q2[3 * k + 2]
            first, second = q1[3 * k : 3 * k + 2] + p * left, q2[3 * k : 3 * k + 2] + b * left - p * p * lever
            force = body.mass_kg * (second * omega**2 + first * alpha - gravity)
            right[3 * k : 3 * k + 2] += force
            turning = body.inertia_kgm2 * (b * omega**2 + p * alpha)
            right[3 * k + 2] += lever[0] * force[1] - lever[1] * force[0] + turning
        columns: list[Array] = []
        names: list[str] = []

        def push(name: str, pairs: list[tuple[int, Array, Array, float]]) -> None:
            column = np.zeros(q.size)
            for link, place, force, moment in pairs:
                if link == GROUND:
                    continue
                lever = place - q[3 * link : 3 * link + 2]
                column[3 * link : 3 * link + 2] += force
                column[3 * link + 2] += lever[0] * force[1] - lever[1] * force[0] + moment
            columns.append(column)
            names.append(name)

        nothing, on_shaft = np.zeros(2), []
        for joint in self.joints:
            match joint:
                case Pin():
                    at = self.point(q, joint.one, joint.at_one)
                    for axis in np.eye(2):
                        push(joint.name, [(joint.one, at, axis, 0.0), (joint.two, at, -axis, 0.0)])
                case Slide():
                    at = q[3 * joint.slider : 3 * joint.slider + 2]
                    n = turned(self.angle(q, joint.carrier) + joint.angle, 1j)
                    push(joint.name, [(joint.slider, at, n, 0.0), (joint.carrier, at, -n, 0.0)])
                    push(joint.name, [(joint.slider, at, nothing, 1.0), (joint.carrier, at, nothing, -1.0)])
                case Mesh():
                    one, two = self.point(q, *joint.at), self.point(q, *joint.driven_at)
                    way = two - one
                    at, n = one + joint.share * way, np.array([-way[1], way[0]]) / np.hypot(*way)
                    pairs = [(joint.driven, at, n, 0.0)]
                    if joint.driver is not None:
                        pairs.append((joint.driver, at, -n, 0.0))
                    push(joint.name, pairs)
                    if joint.shaft:
                        lever = joint.share * way
                        on_shaft.append((len(columns) - 1, float(lever[0] * n[1] - lever[1] * n[0])))
                case Same():
                    pairs = [(joint.two, nothing + q[3 * joint.two : 3 * joint.two + 2], nothing, 1.0)]
                    if joint.one is not None:
                        pairs.append((joint.one, q[3 * joint.one : 3 * joint.one + 2], nothing, -1.0))
                    else:
                        on_shaft.append((len(columns), 1.0))
                    push("drive" if joint.one is None else "", pairs)
        solved = np.linalg.solve(np.array(columns).T, right)
        torque = sum(solved[k] * lever for k, lever in on_shaft)
        by_name: dict[str, list[float]] = {}
        for name, value in zip(names, solved, strict=True):
            by_name.setdefault(name, []).append(float(value))
        return {name: np.array(value) for name, value in by_name.items()}, float(torque)


def compare(machine: Machine, found: dict[str, Array], theta: Array, omega: float, alpha: float) -> dict[str, float]:
    """Compute the largest differences from the dense solution, over longest link, peak torque and largest force.

    `found` holds the machine's outputs at the angles: points, link angles, the two torques, and `reaction_P` of pins.
    Only pins of two links are compared, which are one joint of the dense system.
    """
    dense = Dense(machine)
    starts = {link.name: link.start for link in machine.links}
    size = max(link.length for link in machine.linkage.solved.links.values())
    worst = dict.fromkeys(("place", "torque", "newton_euler", "reaction"), 0.0)
    peak = float(np.abs(found["balancing_torque_Nm"]).max())
    forces: dict[str, list[Array]] = {}
    offsets: dict[int, Any] = {}
    torques = []
    for k, angle in enumerate(theta.tolist()):
        guess = np.zeros(3 * len(dense.links))
        for i, link in enumerate(dense.links):
            short = link[1:] if link[:1] == "l" and link[1:].isdigit() else link
            guess[3 * i : 3 * i + 3] = [
                np.broadcast_to(found[name], theta.shape)[k]
                for name in (f"point_{starts[link]}_x_m", f"point_{starts[link]}_y_m", f"theta_{short}_rad")
            ]
        if not offsets:  # constant angles, from the first sample
            zero = dict.fromkeys(range(len(dense.joints)), 0.0)
            rows, row = dense.residual(guess, angle, zero), 0
            for j, joint in enumerate(dense.joints):
                row += 1 if isinstance(joint, (Same, Mesh)) else 2
                offsets[j] = 0.0 if isinstance(joint, Pin) else float(rows[row - 1])
        q = dense.assembled(guess, angle, offsets)
        moved = np.abs(q - guess) / np.tile([size, size, 1.0], len(dense.links))
        worst["place"] = max(worst["place"], float(moved.max()))
        joints, torque = dense.forces(q, angle, omega, alpha, offsets)
        torques.append(torque)
        for name, force in joints.items():
            forces.setdefault(name, []).append(force)
    for key, name in (("torque", "balancing_torque_Nm"), ("newton_euler", "balancing_torque_newton_euler_Nm")):
        worst[key] = float(np.abs(np.array(torques) - found[name]).max()) / peak
    largest = max(float(np.abs(f).max()) for f in forces.values())
    shared = {joint.at_name for joint in dense.joints if isinstance(joint, Mesh) and joint.shaft}
    for name, solved in forces.items():
        outputs = [f"reaction_{name}_x_N", f"reaction_{name}_y_N"]
        if outputs[0] in found and name not in shared:
            ours: Array = np.column_stack([np.broadcast_to(found[o], theta.shape) for o in outputs])
            theirs = np.array(solved)
            if theirs.shape[1] == 2:
                worst["reaction"] = max(worst["reaction"], float(np.abs(ours - theirs).max()) / largest)
    return worst


@dataclass(frozen=True)
class Jet:
    """A value with its first and second derivative along a curve."""

    value: Any
    first: Any = 0.0
    second: Any = 0.0

    def __add__(self, other: Any) -> Jet:
        o = other if isinstance(other, Jet) else Jet(other)
        return Jet(self.value + o.value, self.first + o.first, self.second + o.second)

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.first, -self.second)

    def __sub__(self, other: Any) -> Jet:
        return self.__add__(-other)

    def __rsub__(self, other: Any) -> Jet:
        return self.__neg__().__add__(other)

    def __mul__(self, other: Any) -> Jet:
        o = other if isinstance(other, Jet) else Jet(other)
        bend = self.second * o.value + 2.0 * self.first * o.first + self.value * o.second
        return Jet(self.value * o.value, self.first * o.value + self.value * o.first, bend)

    __radd__ = __add__
    __rmul__ = __mul__

    def cos(self) -> Jet:
        c, s = math.cos(self.value), math.sin(self.value)
        return Jet(c, -s * self.first, -s * self.second - c * self.first**2)

    def sin(self) -> Jet:
        c, s = math.cos(self.value), math.sin(self.value)
        return Jet(s, c * self.first, c * self.second - s * self.first**2)
