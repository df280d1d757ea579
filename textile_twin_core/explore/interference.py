"""Interference: links that cross in the plane over a turn and therefore need different planes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import EllipticGearPair

_EVERY = 4
"""Step between the checked samples."""
_TOUCH = 1e-9
"""Sine of the angle below which the end of a link lies on the other link, such as a crank pin in a slot."""


@dataclass(frozen=True)
class Clash:
    """Two links whose centre lines cross, over a range of the shaft angle [rad]; 0 and 2 pi for the whole turn."""

    first: str
    second: str
    begin_rad: float
    end_rad: float


def clashes(
    machine: Machine, points: Mapping[str, tuple[FloatArray, FloatArray]], theta: FloatArray
) -> tuple[Clash, ...]:
    """Find pairs of links, other than gears, that share no joint or slot and cross, with their widest range of
    crossing.
    """
    places = {name: (x + 1j * y)[::_EVERY] for name, (x, y) in points.items()}
    gears = {name for g in machine.groups if isinstance(g, EllipticGearPair) for name in (g.driver, g.driven)}
    links = [link for link in machine.links if link.name not in gears]
    slotted = [{joint.parent_link, joint.child_link} for joint in machine.joints if joint.kind == "prismatic"]
    found = []
    for i, a in enumerate(links):
        for b in links[i + 1 :]:
            if {a.start, a.end} & {b.start, b.end} or {a.name, b.name} in slotted:
                continue
            crossed = _cross(places[a.start], places[a.end], places[b.start], places[b.end])
            if crossed.any():
                begin, end = _widest(crossed, theta[::_EVERY])
                found.append(Clash(a.name, b.name, begin, end))
    return tuple(found)


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Return (n,) true where the segments a-b and c-d cross."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        along, to = q - p, r - p
        found = np.asarray((np.conj(along) * to).imag)
        return np.where(np.abs(found) > _TOUCH * np.abs(along) * np.abs(to), found, 0.0)

    return np.asarray((side(a, b, c) * side(a, b, d) < 0.0) & (side(c, d, a) * side(c, d, b) < 0.0))


def _widest(crossed: BoolArray, theta: FloatArray) -> tuple[float, float]:
    if crossed.all():
        return 0.0, 2.0 * math.pi
    start = int(np.argmin(crossed))  # a sample at which they do not cross
    turned = np.roll(crossed, -start)
    edges = np.flatnonzero(np.diff(turned.astype(int), prepend=0, append=0))
    begins, ends = edges[::2], edges[1::2]
    k = int(np.argmax(ends - begins))
    size = theta.size
    return float(theta[(start + begins[k]) % size]), float(theta[(start + ends[k] - 1) % size])
