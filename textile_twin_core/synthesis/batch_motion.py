"""The groups' closed forms for many designs at once: complex arrays (designs, angles), the numbers in columns.

The textbook forms, which lose digits near change points as those of `mechanism` do not: right for a search, whose
results are then a machine like any other. The tests hold one against the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import singledispatch
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.mechanism import Crank, EllipticGearPair, RigidArm, RRPDyad, RRRDyad
from textile_twin_core.synthesis.four_bar import ComplexArray

Columns = Mapping[str, FloatArray]
"""The numbers by slot, each (n, 1)."""


@dataclass
class Point:
    """A point: position [m] and derivatives by the shaft angle, complex, broadcastable to (n, m)."""

    position: Any
    first: Any
    second: Any


@dataclass
class LinkBatch:
    """A link: its start, length, unit direction, and derivatives of its angle by the shaft angle."""

    start: Point
    length: Any
    direction: Any
    first: Any
    second: Any

    def at(self, place: Any) -> Point:
        """A point of the link, at a place in its frame [m], along + i across."""
        lever = place * self.direction
        p, q = self.first, self.second
        return Point(
            self.start.position + lever,
            self.start.first + 1j * p * lever,
            self.start.second + (1j * q - p * p) * lever,
        )


@dataclass
class Chain:
    """What has been solved of a linkage, and how the dyads meet: cosines of their transmission angles."""

    columns: Columns
    points: dict[str, Point] = field(default_factory=dict)
    links: dict[str, LinkBatch] = field(default_factory=dict)
    rotations: dict[str, tuple[Any, Any, Any]] = field(default_factory=dict)
    cosines: list[FloatArray] = field(default_factory=list)

    def number(self, name: str) -> FloatArray:
        """A column (n, 1)."""
        return self.columns[name]


@singledispatch
def solve(group: object, chain: Chain) -> None:
    """Add a group's points and links."""
    raise SceneError(f"no batch form is known for a group of type {type(group).__name__}")


@solve.register
def _(group: Crank, chain: Chain) -> None:
    shaft, p, q = chain.rotations[group.driven_by]
    direction = shaft * np.exp(1j * chain.number(f"{group.name}.phase_rad"))
    _add(
        chain,
        group.name,
        group.end,
        LinkBatch(chain.points[group.at], chain.number(f"{group.name}.length_m"), direction, p, q),
    )


@solve.register
def _(group: RigidArm, chain: Chain) -> None:
    on = chain.links[group.on]
    direction = on.direction * np.exp(1j * chain.number(f"{group.name}.angle_rad"))
    _add(
        chain,
        group.name,
        group.end,
        LinkBatch(on.start, chain.number(f"{group.name}.length_m"), direction, on.first, on.second),
    )


@solve.register
def _(group: RRRDyad, chain: Chain) -> None:
    if group.branch not in ("left", "right"):
        raise SceneError(f"dyad '{group.name}': no batch form for the branch '{group.branch}'")
    side = 1.0 if group.branch == "left" else -1.0
    start, ground = chain.points[group.from_point], chain.points[group.ground]
    b, c = (chain.number(f"{link}.length_m") for link in (group.coupler, group.rocker))
    way = ground.position - start.position
    squared = way.real**2 + way.imag**2
    along = (squared + (b - c) * (b + c)) / (2.0 * squared)
    arm = way * (along + (1j * side) * np.sqrt(b * b / squared - along * along))
    coupler, rocker = arm / b, (arm - way) / c
    # closure, twice differentiated: i p2 b u2 - i p3 c u3 = v and so on; solved by crossing with either link
    sine = _cross(coupler, rocker)
    v = ground.first - start.first
    p2, p3 = _dot(v, rocker) / (b * sine), _dot(v, coupler) / (c * sine)
    w = ground.second - start.second + p2 * p2 * arm - p3 * p3 * (arm - way)
    q2, q3 = _dot(w, rocker) / (b * sine), _dot(w, coupler) / (c * sine)
    chain.cosines.append((b * b + c * c - squared) / (2.0 * b * c))
    _add(chain, group.coupler, group.end, LinkBatch(start, b, coupler, p2, q2))
    chain.links[group.rocker] = LinkBatch(ground, c, rocker, p3, q3)


@solve.register
def _(group: RRPDyad, chain: Chain) -> None:
    start, axis = chain.points[group.from_point], complex(*group.axis)
    rod, slider = (chain.number(f"{link}.length_m") for link in (group.rod, group.slider))
    guide = chain.number(f"{group.slider}.guide_x_m") + 1j * chain.number(f"{group.slider}.guide_y_m")
    offset = ((start.position - guide) / axis).imag
    reach = (1.0 if group.branch == "forward" else -1.0) * np.sqrt((rod - offset) * (rod + offset))
    drift, sag = (start.first / axis).imag, (start.second / axis).imag
    p = -drift / reach
    q = -(sag + offset * p * p) / reach
    chain.cosines.append(offset / rod)
    _add(chain, group.rod, group.end, LinkBatch(start, rod, (reach - 1j * offset) / rod * axis, p, q))
    joint = chain.points[group.end]
    joint.first, joint.second = ((z / axis).real * axis for z in (joint.first, joint.second))
    zero = np.zeros(1)
    _add(chain, group.slider, group.tip, LinkBatch(joint, slider, axis, zero, zero))


@solve.register
def _(group: EllipticGearPair, chain: Chain) -> None:
    shaft, p, q = chain.rotations[group.driven_by]
    k = chain.number(f"{group.driver}.axis_ratio")
    e = np.sqrt((1.0 - k) * (1.0 + k))
    line = chain.points[group.driven_at].position - chain.points[group.at].position
    rest = -line / np.abs(line)
    turn = shaft * np.exp(1j * chain.number(f"{group.driver}.phase_rad"))
    width = 1.0 + e * turn
    norm = width.real**2 + width.imag**2
    ratio = (1.0 - e * e) / norm
    growth = 2.0 * e * turn.imag * ratio / norm
    driven = np.conj((turn + e) / width) * rest
    rate, change = -ratio * p, -(growth * p * p + ratio * q)
    chain.rotations[group.driven] = driven, rate, change
    length = e * np.abs(line)
    _add(chain, group.driver, group.ends[0], LinkBatch(chain.points[group.at], length, turn * rest, p, q))
    _add(chain, group.driven, group.ends[1], LinkBatch(chain.points[group.driven_at], length, driven, rate, change))


def _add(chain: Chain, name: str, end: str, link: LinkBatch) -> None:
    chain.links[name] = link
    chain.points[end] = link.at(link.length)


def _cross(a: ComplexArray, b: ComplexArray) -> FloatArray:
    return np.asarray(a.real * b.imag - a.imag * b.real)


def _dot(a: ComplexArray, b: ComplexArray) -> FloatArray:
    return np.asarray(a.real * b.real + a.imag * b.imag)
