"""Rocker that carries a tool through three positions, such as those of a weaver's hand."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.errors import SceneError

Point = tuple[float, float]
_FLAT = 1e-9


@dataclass(frozen=True)
class RockerThroughPoints:
    """Pivot [m], radius [m], swing [rad] and the angles of the first and last position, seen from the pivot [rad]."""

    pivot_m: Point
    radius_m: float
    swing_rad: float
    first_rad: float
    last_rad: float


def rocker_through(first: Point, second: Point, last: Point) -> RockerThroughPoints:
    """Compute pivot, length and swing of the rocker that carries a tool through three positions [m].

    The swing is the arc from the first over the second to the last position.

    Raises:
        SceneError: for points that are not three, lie on one line, or need half a turn or more.

    References:
        Topalbekiroglu and Celik 2010, Fig. 2: three point synthesis.
    """
    p1, p2, p3 = (complex(*p) for p in (first, second, last))
    if not all(math.isfinite(v) for p in (p1, p2, p3) for v in (p.real, p.imag)):
        raise SceneError("positions of the hand must be finite coordinates in metres")
    u, v = p2 - p1, p3 - p1
    cross = u.real * v.imag - u.imag * v.real
    size = max(abs(u), abs(v), abs(v - u))
    if abs(cross) <= _FLAT * size * size:
        raise SceneError("the three positions lie on one line: no rocker goes through them, give a curved path")
    centre = p1 + 1j * (u * abs(v) ** 2 - v * abs(u) ** 2) / (2.0 * cross)
    angles = [math.atan2((p - centre).imag, (p - centre).real) for p in (p1, p2, p3)]
    turn = math.copysign(1.0, cross)  # sense of the arc through the three points
    swing = math.fmod(turn * (angles[2] - angles[0]) + 4.0 * math.pi, 2.0 * math.pi)
    if not swing < math.pi:
        raise SceneError(f"the positions span {math.degrees(swing):.4g} deg of a circle; a rocker swings less than 180")
    return RockerThroughPoints((centre.real, centre.imag), abs(p1 - centre), swing, angles[0], angles[0] + turn * swing)
