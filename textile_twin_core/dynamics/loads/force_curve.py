"""Force over a measure of the linkage, such as a needle's depth or a sley's position, between knots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.loads.load import Crossing, LoadContext
from textile_twin_core.dynamics.loads.relative import link_of_load, turn_links
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, absolute, at_least, atan2, piecewise, real, sign, square
from textile_twin_core.mechanism import MAIN_SHAFT, Arc, Displacement, Travel
from textile_twin_core.mechanism.angles import link_angle
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches

POSITION, SHAFT_ANGLE = "_position_m", "theta_rad"
_TURN: Final = 2.0 * math.pi
_WHOLE_TURN: Final = 1e-9
"""Largest distance [rad] of the knots' range from a full turn that counts as a full turn."""


class Piece(NamedTuple):
    """A polynomial between two knots: coefficients of the powers of the distance from `lower`, lowest first."""

    lower: float
    upper: float
    coefficients: tuple[float, ...]

    @property
    def integral(self) -> float:
        """Work over the piece, in closed form."""
        width = self.upper - self.lower
        return math.fsum(c * width ** (n + 1) / (n + 1) for n, c in enumerate(self.coefficients))


@dataclass(frozen=True)
class ForceCurve:
    """A force against the motion of a measure, as a function of the measure: `in_N` while it grows, `out_N` while it
    shrinks.

    A positive force opposes the motion, so that a grip on the needle is positive both ways; a cloth that springs back
    is negative on the way out. Without `out_N` the force is the same both ways. Outside the knots the force is zero,
    and a value other than zero at the first or last knot is a step there. Two equal knots are a step between them. At
    standstill the force is zero.

    Args:
        name: name of the load.
        measure: output of the linkage over which the force is declared: `NAME_position_m` of a measure, `theta_K_rad`
            of a link, or `theta_rad`, the crank's angle within one turn. Over an angle the values are torques [N m].
        knots: values of the measure, ascending.
        in_N: force at the knots while the measure grows [N].
        out_N: force at the knots while the measure shrinks [N].
        between: form between the knots: `linear`, or `monotone` (cubic, without overshoot).
        speed_power: the force grows as this power of the shaft speed: 0, 1 or 2.
        at_speed_rad_s: shaft speed at which the values hold; needed with a power.

    References:
        Fritsch and Carlson, Monotone piecewise cubic interpolation, SIAM J. Numer. Anal. 17, 1980.
    """

    name: str
    measure: str
    knots: tuple[float, ...]
    in_N: tuple[float, ...]
    out_N: tuple[float, ...] | None = None
    between: Literal["linear", "monotone"] = "linear"
    speed_power: Literal[0, 1, 2] = 0
    at_speed_rad_s: float | None = None

    def __post_init__(self) -> None:
        what = f"force curve '{self.name}'"
        if not self.name:
            raise MachineError("force curve: name must not be empty")
        columns = {"knots": self.knots, "in_N": self.in_N} | ({} if self.out_N is None else {"out_N": self.out_N})
        for key, values in columns.items():
            if len(values) != len(self.knots):
                raise MachineError(f"{what}: {key} has {len(values)} values for {len(self.knots)} knots")
            if not all(math.isfinite(v) for v in values):
                raise MachineError(f"{what}: {key} must be finite numbers")
        if len(self.knots) < 2 or self.knots[0] == self.knots[-1]:
            raise MachineError(f"{what}: give two knots or more, apart from each other")
        for k, (low, high) in enumerate(pairwise(self.knots)):
            if high < low or (k > 0 and self.knots[k - 1] == high):
                raise MachineError(f"{what}: knots must rise, with at most two equal ones for a step; see knot {k + 2}")
        if self.between not in ("linear", "monotone"):
            raise MachineError(f"{what}: between must be linear or monotone, not '{self.between}'")
        if self.speed_power not in (0, 1, 2):
            raise MachineError(f"{what}: speed_power must be 0, 1 or 2, not {self.speed_power!r}")
        speed = self.at_speed_rad_s
        if self.speed_power and not (speed is not None and math.isfinite(speed) and speed > 0.0):
            raise MachineError(f"{what}: at_speed_rad_s must be a positive speed; the values hold there")
        if self.measure == SHAFT_ANGLE and self.knots[-1] - self.knots[0] > _TURN + _WHOLE_TURN:
            raise MachineError(f"{what}: knots over the crank's angle must lie within one turn")

    @property
    def unit(self) -> str:
        """Unit of the values: N, or N m over an angle."""
        return "N" if self.measure.endswith(POSITION) else "N m"

    @property
    def steps(self) -> tuple[tuple[float, float, float], ...]:
        """Places of a position at which the force steps, each with its change on the way in and on the way out."""
        if not self.measure.endswith(POSITION):
            return ()
        down, up = self.in_N, self.in_N if self.out_N is None else self.out_N
        found = [(self.knots[0], down[0], up[0])]
        for k, (low, high) in enumerate(pairwise(self.knots)):
            if low == high:
                found.append((low, down[k + 1] - down[k], up[k + 1] - up[k]))
        found.append((self.knots[-1], -down[-1], -up[-1]))
        return tuple(each for each in found if each[1] or each[2])

    def pieces(self, growing: bool = True) -> tuple[Piece, ...]:
        """Return the polynomials between the knots while the measure grows, or shrinks."""
        values = self.in_N if growing or self.out_N is None else self.out_N
        shape = _straight if self.between == "linear" else _monotone
        found: list[Piece] = []
        begin = 0
        for end in range(1, len(self.knots) + 1):  # runs of knots without a step between them
            if end == len(self.knots) or self.knots[end] == self.knots[end - 1]:
                if end - begin > 1:
                    found += shape(self.knots[begin:end], values[begin:end])
                begin = end
        return tuple(found)

    def values(self, places: npt.ArrayLike, growing: bool = True) -> FloatArray:
        """Compute the force at values of the measure, of any shape, at the speed at which the curve holds."""
        places = np.asarray(places, dtype=np.float64)
        found = np.zeros(places.shape)
        for piece in self.pieces(growing):
            inside = (piece.lower <= places) & (places < piece.upper)
            found[inside] = np.polynomial.polynomial.polyval(places[inside] - piece.lower, piece.coefficients)
        return found

    def work_J(self, low: float, high: float, growing: bool = True) -> float:
        """Compute the work against the force between two values of the measure, in closed form [J]."""
        parts = []
        for piece in self.pieces(growing):
            begin, end = max(low, piece.lower), min(high, piece.upper)
            if end > begin:
                parts.append(_antiderivative(piece, end) - _antiderivative(piece, begin))
        return math.fsum(parts)

    def intensity(self, context: LoadContext) -> Expr:
        """Express the force along the growing measure."""
        place = self._displacement(context)
        rate, omega = place.first * context.shaft.omega, context.shaft.omega
        force = self._force(place.position, at_least(rate, 0.0))
        if self.speed_power:
            share = absolute(omega) / (self.at_speed_rad_s or 1.0)
            force = force * (share if self.speed_power == 1 else square(share))
        return -sign(rate) * force

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the measure's derivative, through which the force acts on the shaft."""
        return self._displacement(context).first

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply the force at the measure's point, or the torque to its link."""
        motion = context.motion
        if self.measure == SHAFT_ANGLE:
            wrenches.add_torque(MAIN_SHAFT, intensity)
            return
        if not self.measure.endswith(POSITION):
            turn_links(wrenches, self._link(context), None, intensity)
            return
        measure = context.measures[self.measure.removesuffix(POSITION)]
        if isinstance(measure, Travel):
            norm = math.hypot(*measure.direction)
            direction = Vector.of(measure.direction[0] / norm, measure.direction[1] / norm)
            wrenches.pull_on_point(measure.point, intensity * direction)
            return
        assert isinstance(measure, Arc)
        link = motion.links[measure.link]
        along = (float(measure.sense) * intensity) * link.direction.turned_left()
        if motion.points[link.start].is_fixed:
            wrenches.add_at(link, measure.radius_m * link.direction, along)
        else:
            turn_links(wrenches, measure.link, None, (float(measure.sense) * measure.radius_m) * intensity)

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """Return the events of entering and leaving the range of the knots."""
        place = self._displacement(context).position
        if self.measure == SHAFT_ANGLE:
            return ()
        part = self.measure.removesuffix(POSITION)
        return (
            Crossing(f"{part}_enters_{self.name}", place - self.knots[0], rising=True),
            Crossing(f"{part}_leaves_{self.name}", place - self.knots[0], rising=False),
        )

    def _force(self, place: Expr, growing: Expr) -> Expr:
        """Express the force at a value of the measure, on either branch."""
        nothing = (0.0, 0.0)
        ways = [[(piece.lower, *piece.coefficients) for piece in self.pieces(way)] for way in (True, False)]
        edges = [piece.lower for piece in self.pieces()] + [self.knots[-1]]
        if self.measure == SHAFT_ANGLE and self._covers_the_turn:
            return piecewise(place, growing, edges[1:-1], *ways)
        return piecewise(place, growing, edges, *([nothing, *way, nothing] for way in ways))

    @property
    def _covers_the_turn(self) -> bool:
        return self.knots[-1] - self.knots[0] >= _TURN - _WHOLE_TURN

    def _displacement(self, context: LoadContext) -> Displacement:
        if self.measure == SHAFT_ANGLE:
            return self._crank_angle(context)
        if self.measure.endswith(POSITION):
            name = self.measure.removesuffix(POSITION)
            if name in context.displacements:
                return context.displacements[name]
        elif self.measure.startswith("theta_"):
            link = link_of_load(context.motion, self._link(context))
            middle = 0.5 * (self.knots[0] + self.knots[-1])
            return Displacement(link_angle(link, context.motion, middle), link.first, link.second)
        there = ", ".join([*(f"{name}{POSITION}" for name in context.measures), SHAFT_ANGLE, "theta_K_rad of a link"])
        raise MachineError(f"force curve '{self.name}': measure '{self.measure}' does not exist; available: {there}")

    def _link(self, context: LoadContext) -> str:
        name = self.measure.removeprefix("theta_").removesuffix("_rad")
        return f"l{name}" if name.isdigit() else name

    def _crank_angle(self, context: LoadContext) -> Displacement:
        """Express the crank's angle within the turn around the middle of the knots."""
        crank = context.motion.rotations[MAIN_SHAFT]
        middle = 0.5 * (self.knots[0] + self.knots[-1])
        reference = Vector.of(real.cos(middle), real.sin(middle))
        swing = atan2(reference.cross(crank.direction), reference.dot(crank.direction))
        return Displacement(swing + middle, crank.first, crank.second)


def _straight(knots: Sequence[float], values: Sequence[float]) -> list[Piece]:
    pairs = pairwise(zip(knots, values, strict=True))
    return [Piece(low, high, (begin, (end - begin) / (high - low))) for (low, begin), (high, end) in pairs]


def _monotone(knots: Sequence[float], values: Sequence[float]) -> list[Piece]:
    """Interpolate by cubics with the slopes of Fritsch and Carlson, which add no extremum between the knots."""
    steps = [b - a for a, b in pairwise(knots)]
    rises = [(b - a) / h for (a, b), h in zip(pairwise(values), steps, strict=True)]
    if len(steps) == 1:
        return _straight(knots, values)
    slopes = [_end_slope(steps[0], steps[1], rises[0], rises[1])]
    for (h0, h1), (r0, r1) in zip(pairwise(steps), pairwise(rises), strict=True):
        w0, w1 = 2.0 * h1 + h0, h1 + 2.0 * h0
        slopes.append((w0 + w1) / (w0 / r0 + w1 / r1) if r0 * r1 > 0.0 else 0.0)
    slopes.append(_end_slope(steps[-1], steps[-2], rises[-1], rises[-2]))
    found = []
    for k, (h, rise) in enumerate(zip(steps, rises, strict=True)):
        a, b = slopes[k], slopes[k + 1]
        cubic = (values[k], a, (3.0 * rise - 2.0 * a - b) / h, (a + b - 2.0 * rise) / (h * h))
        found.append(Piece(knots[k], knots[k + 1], cubic))
    return found


def _end_slope(h0: float, h1: float, r0: float, r1: float) -> float:
    """Compute the slope at an end from three knots, limited so that the curve stays monotone."""
    slope = ((2.0 * h0 + h1) * r0 - h0 * r1) / (h0 + h1)
    if slope * r0 <= 0.0:
        return 0.0
    return 3.0 * r0 if r0 * r1 < 0.0 and abs(slope) > 3.0 * abs(r0) else slope


def _antiderivative(piece: Piece, place: float) -> float:
    return Piece(piece.lower, place, piece.coefficients).integral
