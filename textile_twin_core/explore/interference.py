"""Interference: links that cross in the plane over a turn and therefore need different planes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import EllipticGearPair

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
    places = {name: x + 1j * y for name, (x, y) in points.items()}
    gears = {name for g in machine.groups if isinstance(g, EllipticGearPair) for name in (g.driver, g.driven)}
    links = [link for link in machine.links if link.name not in gears]
    slotted = [{joint.parent_link, joint.child_link} for joint in machine.joints if joint.kind == "prismatic"]
    found = []
    for i, a in enumerate(links):
        for b in links[i + 1 :]:
            if {a.start, a.end} & {b.start, b.end} or {a.name, b.name} in slotted:
                continue
            margin = _margin(places[a.start], places[a.end], places[b.start], places[b.end])
            if np.any(margin > 0.0):
                begin, end = _widest(margin, theta)
                found.append(Clash(a.name, b.name, begin, end))
    return tuple(found)


def _margin(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return (n,) positive values where the segments a-b and c-d cross."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        along, to = q - p, r - p
        size = np.abs(along) * np.abs(to)
        found = np.asarray((np.conj(along) * to).imag) / np.where(size > 0.0, size, 1.0)
        return np.where(np.abs(found) > _TOUCH, found, 0.0)

    return np.minimum(-side(a, b, c) * side(a, b, d), -side(c, d, a) * side(c, d, b))


def _widest(margin: FloatArray, theta: FloatArray) -> tuple[float, float]:
    """Return the widest range of positive margins, with its ends interpolated between the samples."""
    crossed = margin > 0.0
    if crossed.all():
        return 0.0, 2.0 * math.pi
    start = int(np.argmin(crossed))  # a sample at which they do not cross
    edges = np.flatnonzero(np.diff(np.roll(crossed, -start).astype(int), prepend=0, append=0))
    begins, ends = edges[::2], edges[1::2]
    k = int(np.argmax(ends - begins))

    def zero(inside: int, outside: int) -> float:
        """Angle of zero margin between two samples; that inside where the other is across an end of the range."""
        inside, outside = (start + inside) % theta.size, (start + outside) % theta.size
        step = math.remainder(float(theta[outside] - theta[inside]), 2.0 * math.pi)
        if abs(step) > 1.5 * abs(float(theta[1] - theta[0])):
            return float(theta[inside])
        return float(theta[inside]) + step * float(margin[inside] / (margin[inside] - margin[outside]))

    begin, end = zero(begins[k], begins[k] - 1), zero(ends[k] - 1, ends[k])
    return begin % (2.0 * math.pi), end % (2.0 * math.pi)
