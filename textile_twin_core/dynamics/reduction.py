"""Reduction to one degree of freedom: J(theta) alpha + J'(theta)/2 omega^2 + V'(theta).

Each body is replaced by two masses at the ends of its link and a correction of inertia with the same energy
(dynamically equivalent masses). The groups provide the joints' speeds in their shortest form, so that no centroid has
to be computed.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from textile_twin_core.dynamics.body import Body
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const
from textile_twin_core.expression.graph import scaled
from textile_twin_core.mechanism import Motion
from textile_twin_core.mechanism.vector import Vector


@dataclass(frozen=True)
class Reduction:
    """Inertia and potential of a linkage's bodies, reduced to the shaft.

    Attributes:
        inertia: equivalent inertia J [kg m^2].
        half_slope: J'/2 [kg m^2/rad].
        potential: V [J], zero at height 0 of the frame.
        potential_slope: V' [N m].
    """

    inertia: Expr
    half_slope: Expr
    potential: Expr
    potential_slope: Expr


def reduce_bodies(motion: Motion, bodies: Iterable[Body], gravity: Vector) -> Reduction:
    """Reduce bodies on a solved motion to the shaft. Raises MachineError for a body on an unknown link."""
    mass_at: dict[str, float] = defaultdict(float)
    inertia_of: dict[str, float] = defaultdict(float)
    zero = const(0.0)
    across_inertia, across_slope, across_potential, across_pull = zero, zero, zero, zero
    squares, products = _Sum(), _Sum()
    for body in bodies:
        if body.is_flywheel:
            shaft = motion.rotations[body.on]
            squares.add(body.inertia_kgm2, shaft.first * shaft.first)
            products.add(body.inertia_kgm2, shaft.first * shaft.second)
            continue
        link = motion.links.get(body.on)
        if link is None:
            raise MachineError(f"body on '{body.on}': there is no such link; links: {', '.join(motion.links)}")
        along, across = body.centroid
        squared = link.length * link.length
        mass_at[link.start] += (1.0 - along) * body.mass_kg
        mass_at[link.end] += along * body.mass_kg
        inertia_of[link.name] += body.inertia_kgm2 + body.mass_kg * squared * (across**2 - along * (1.0 - along))
        if across:
            moment = body.mass_kg * across * link.length
            start, u, p, q = motion.points[link.start], link.direction, link.first, link.second
            drift = start.first.dot(u)
            drift_slope = start.second.dot(u) + p * start.first.dot(u.turned_left())
            across_inertia += (-2.0 * moment) * (p * drift)
            across_slope += (-moment) * (q * drift + p * drift_slope)
            across_potential += (-moment) * gravity.dot(u.turned_left())
            across_pull += moment * (p * gravity.dot(u))
    inertia, half_slope, potential, pull = across_inertia, across_slope, across_potential, across_pull
    weight, pulls = _Sum(), _Sum()
    for name, mass in mass_at.items():
        point = motion.points[name]
        squares.add(mass, point.speed_squared)
        products.add(mass, point.speed_product)
        for g, height, slope in (
            (gravity.x, point.position.x, point.first.x),
            (gravity.y, point.position.y, point.first.y),
        ):
            weight.add(-mass, g * height)
            pulls.add(-mass, g * slope)
    for name, value in inertia_of.items():
        link = motion.links[name]
        squares.add(value, link.first * link.first)
        products.add(value, link.first * link.second)
    return Reduction(
        inertia + squares.total(),
        half_slope + products.total(),
        potential + weight.total(),
        pull + pulls.total(),
    )


class _Sum:
    """A weighted sum that merges equal terms, such as the two ends of a slider."""

    def __init__(self) -> None:
        self._weights: dict[Expr, float] = defaultdict(float)

    def add(self, weight: float, term: Expr) -> None:
        factor, base = scaled(term)
        self._weights[base] += weight * factor

    def total(self) -> Expr:
        result = const(0.0)
        for term, weight in self._weights.items():
            result += weight * term
        return result
