"""Closed forms of the groups for many designs at once: complex arrays (designs, angles), numbers in columns.

These are the textbook forms, which lose precision near change points where those of `mechanism` do not. They suit a
search, whose results are evaluated as machines afterwards. The tests compare the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import singledispatch
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.mechanism import (
    Crank,
    EllipticGearPair,
    GearPair,
    PRPDyad,
    RigidArm,
    RPPDyad,
    RPRDyad,
    RRPDyad,
    RRRDyad,
)
from textile_twin_core.synthesis.four_bar import ComplexArray

Columns = Mapping[str, FloatArray]
"""Numbers by slot, each (n, 1)."""


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
    slides: Any = None
    """Derivative of a slider's position along its guide by the shaft angle; None for other links."""

    def at(self, place: Any) -> Point:
        """Return a point of the link, at a position in its frame [m], along + i across."""
        lever = place * self.direction
        p, q = self.first, self.second
        return Point(
            self.start.position + lever,
            self.start.first + 1j * p * lever,
            self.start.second + (1j * q - p * p) * lever,
        )


@dataclass
class Chain:
    """Solved parts of a linkage.

    Attributes:
        cosines: cosines of the dyads' transmission angles.
        slot_margins: distances to the ends of slots [m].
        ends: points of every link.
    """

    columns: Columns
    points: dict[str, Point] = field(default_factory=dict)
    links: dict[str, LinkBatch] = field(default_factory=dict)
    rotations: dict[str, tuple[Any, Any, Any]] = field(default_factory=dict)
    cosines: list[FloatArray] = field(default_factory=list)
    slot_margins: list[FloatArray] = field(default_factory=list)
    ends: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def number(self, name: str) -> FloatArray:
        """Return a column (n, 1)."""
        return self.columns[name]

    def turning(self, name: str) -> tuple[Any, Any, Any]:
        """Return the direction of a link or shaft, and the derivatives of its angle."""
        if name in self.links:
            link = self.links[name]
            return link.direction, link.first, link.second
        return self.rotations[name]

    def within(self, position: Any, slot_m: tuple[float, float] | None) -> None:
        """Record the distances of a slider from the ends of its slot."""
        if slot_m is not None:
            self.slot_margins += [position - slot_m[0], slot_m[1] - position]


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
    between = ground.position - start.position
    squared = between.real**2 + between.imag**2
    along = (squared + (b - c) * (b + c)) / (2.0 * squared)
    arm = between * (along + (1j * side) * np.sqrt(b * b / squared - along * along))
    coupler, rocker = arm / b, (arm - between) / c
    # loop closure, differentiated twice: i p2 b u2 - i p3 c u3 = v etc., solved by the cross product with each link
    sine = _cross(coupler, rocker)
    v = ground.first - start.first
    p2, p3 = _dot(v, rocker) / (b * sine), _dot(v, coupler) / (c * sine)
    w = ground.second - start.second + p2 * p2 * arm - p3 * p3 * (arm - between)
    q2, q3 = _dot(w, rocker) / (b * sine), _dot(w, coupler) / (c * sine)
    chain.cosines.append((b * b + c * c - squared) / (2.0 * b * c))
    _add(chain, group.coupler, group.end, LinkBatch(start, b, coupler, p2, q2))
    chain.links[group.rocker] = LinkBatch(ground, c, rocker, p3, q3)


@dataclass
class GuideBatch:
    """A guide: a point on it, its unit direction, and the derivatives of its angle."""

    origin: Point
    axis: Any
    first: Any
    second: Any
    fixed: bool = False

    def seen(self, point: Point) -> tuple[Any, Any, Any]:
        """Express a point in the frame of the guide, along + i across, with its derivatives there."""
        if self.fixed:
            d = point.position - self.origin.position
            return d / self.axis, point.first / self.axis, point.second / self.axis
        d = (point.position - self.origin.position) / self.axis
        v = (point.first - self.origin.first) / self.axis - 1j * self.first * d
        w = (point.second - self.origin.second) / self.axis
        return d, v, w - 2j * self.first * v - (1j * self.second - self.first**2) * d

    def point(self, position: Any, first: Any, second: Any) -> Point:
        """Return the point at a position along the guide."""
        if self.fixed:
            return Point(self.origin.position + position * self.axis, first * self.axis, second * self.axis)
        p, q = self.first, self.second
        return Point(
            self.origin.position + position * self.axis,
            self.origin.first + (first + 1j * p * position) * self.axis,
            self.origin.second + (second + 2j * p * first + (1j * q - p * p) * position) * self.axis,
        )

    def slider(self, chain: Chain, name: str, end: str, tip: str, positions: tuple[Any, Any, Any]) -> None:
        """Add a slider that starts at a position along the guide."""
        chain.points[end] = self.point(*positions)
        length = chain.number(f"{name}.length_m")
        _add(chain, name, tip, LinkBatch(chain.points[end], length, self.axis, self.first, self.second, positions[1]))


def _track(chain: Chain, on: str | None, slider: str, direction: tuple[float, float]) -> GuideBatch:
    axis = complex(*direction)
    axis /= abs(axis)
    place = chain.number(f"{slider}.guide_x_m") + 1j * chain.number(f"{slider}.guide_y_m")
    zero = np.zeros((1, 1))
    if on is None:
        return GuideBatch(Point(place, zero, zero), axis, zero, zero, fixed=True)
    link = chain.links[on]
    return GuideBatch(link.at(place), link.direction * axis, link.first, link.second)


@solve.register
def _(group: RRPDyad, chain: Chain) -> None:
    start, line = chain.points[group.from_point], _track(chain, group.guide_on, group.slider, group.guide_direction)
    rod = chain.number(f"{group.rod}.length_m")
    d, v, w = line.seen(start)
    offset, drift, sag = d.imag, v.imag, w.imag
    reach = (1.0 if group.branch == "forward" else -1.0) * np.sqrt((rod - offset) * (rod + offset))
    p = -drift / reach
    q = -(sag + offset * p * p) / reach
    chain.cosines.append(offset / rod)
    direction = (reach - 1j * offset) / rod * line.axis
    chain.links[group.rod] = LinkBatch(start, rod, direction, p + line.first, q + line.second)
    positions = d.real + reach, v.real + offset * p, w.real + offset * q + drift * p
    line.slider(chain, group.slider, group.end, group.tip, positions)
    chain.within(positions[0], group.slot_m)


@solve.register
def _(group: RPRDyad, chain: Chain) -> None:
    pin, centre = chain.points[group.from_point], chain.points[group.pivot]
    slider, lever = (chain.number(f"{link}.length_m") for link in (group.slider, group.lever))
    e = chain.number(f"{group.lever}.offset_m")
    d, v, w = pin.position - centre.position, pin.first - centre.first, pin.second - centre.second
    squared = d.real**2 + d.imag**2
    s = (1.0 if group.branch == "forward" else -1.0) * np.sqrt(squared - e * e)
    u = d / (s + 1j * e)
    v, w = v / u, w / u
    p = v.imag / s
    rate = v.real + e * p
    q = (w.imag - 2.0 * p * rate + e * p * p) / s
    chain.cosines.append(e / np.sqrt(squared))
    _add(chain, group.slider, group.tip, LinkBatch(pin, slider, u, p, q, rate))
    _add(chain, group.lever, group.end, LinkBatch(centre, lever, u, p, q))
    chain.within(s, group.slot_m)


@solve.register
def _(group: RPPDyad, chain: Chain) -> None:
    pin, line = chain.points[group.from_point], _track(chain, group.guide_on, group.slider, group.guide_direction)
    angle = chain.number(f"{group.slider}.slot_angle_rad")
    along, across = [], []
    for z in line.seen(pin):
        t = z.imag / np.sin(angle)
        across.append(t)
        along.append(z.real - np.cos(angle) * t)
    line.slider(chain, group.slider, group.end, group.tips[1], (along[0], along[1], along[2]))
    block = chain.number(f"{group.block}.length_m")
    slot = line.axis * np.exp(1j * angle)
    _add(chain, group.block, group.tips[0], LinkBatch(pin, block, slot, line.first, line.second, across[1]))
    chain.within(across[0], group.slot_m)


@solve.register
def _(group: PRPDyad, chain: Chain) -> None:
    one, two = (_track(chain, g.on, s, g.direction) for g, s in zip(group.guides, group.sliders, strict=True))
    sine = _cross(one.axis, two.axis)

    def positions(between: Any) -> tuple[Any, Any]:
        return _cross(between, two.axis) / sine, _cross(between, one.axis) / sine

    position = positions(two.origin.position - one.origin.position)
    zero = np.zeros((1, 1))
    carried = [line.point(x, zero, zero).first for line, x in zip((one, two), position, strict=True)]
    rate = positions(carried[1] - carried[0])
    bent = [line.point(x, v, zero).second for line, x, v in zip((one, two), position, rate, strict=True)]
    bend = positions(bent[1] - bent[0])
    chain.cosines.append(_dot(one.axis, two.axis))
    for k, (line, guide) in enumerate(zip((one, two), group.guides, strict=True)):
        line.slider(chain, group.sliders[k], group.end, group.tips[k], (position[k], rate[k], bend[k]))
        chain.within(position[k], guide.slot_m)


@solve.register
def _(group: GearPair, chain: Chain) -> None:
    k = group.ratio
    if k.denominator != 1:
        raise SceneError(f"gears '{group.name}': no batch form is known for a ratio that is no whole number")
    whole, centre = int(k), chain.points[group.driven_at]
    carrier = next((n for n, ends in chain.ends.items() if {*ends} == {group.at, group.driven_at}), None)
    direction, first, second = np.exp(1j * chain.number(f"{group.driven}.phase_rad")), 0.0, 0.0
    for share, name in ((1 - whole, carrier), (whole, group.driver)):
        if name is not None:
            u, p, q = chain.turning(name)
            direction, first, second = direction * u**share, first + share * p, second + share * q
    chain.rotations[group.driven] = direction, first, second
    link = LinkBatch(centre, chain.number(f"{group.driven}.length_m"), direction, first, second)
    _add(chain, group.driven, group.end, link)


@solve.register
def _(group: EllipticGearPair, chain: Chain) -> None:
    shaft, p, q = chain.rotations[group.driven_by]
    k = chain.number(f"{group.driver}.axis_ratio")
    e = np.sqrt((1.0 - k) * (1.0 + k))
    line = chain.points[group.driven_at].position - chain.points[group.at].position
    towards_driver = -line / np.abs(line)
    turn = shaft * np.exp(1j * chain.number(f"{group.driver}.phase_rad"))
    width = 1.0 + e * turn
    norm = width.real**2 + width.imag**2
    ratio = (1.0 - e * e) / norm
    growth = 2.0 * e * turn.imag * ratio / norm
    driven = np.conj((turn + e) / width) * towards_driver
    rate, change = -ratio * p, -(growth * p * p + ratio * q)
    chain.rotations[group.driven] = driven, rate, change
    length = e * np.abs(line)
    _add(chain, group.driver, group.ends[0], LinkBatch(chain.points[group.at], length, turn * towards_driver, p, q))
    _add(chain, group.driven, group.ends[1], LinkBatch(chain.points[group.driven_at], length, driven, rate, change))


def _add(chain: Chain, name: str, end: str, link: LinkBatch) -> None:
    chain.links[name] = link
    chain.points[end] = link.at(link.length)


def _cross(a: ComplexArray, b: ComplexArray) -> FloatArray:
    return np.asarray(a.real * b.imag - a.imag * b.real)


def _dot(a: ComplexArray, b: ComplexArray) -> FloatArray:
    return np.asarray(a.real * b.real + a.imag * b.imag)
