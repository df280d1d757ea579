"""Four-bars and slider-cranks built from the engine's groups and in 60 digits, for the same exact doubles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import mpmath as mp
import numpy as np

from tests.generators.planar_truth import four_bar, slider_crank
from textile_twin_core.expression import Expr
from textile_twin_core.expression.loop import Loop
from textile_twin_core.expression.scalar import ScalarFunction, compile_scalar
from textile_twin_core.mechanism import Crank, Linkage, RRPDyad, RRRDyad

DIGITS = 50
NUDGE = mp.mpf(2) ** -53
"""Rounding of an angle near 1 rad."""


def by_every_back_end(expressions: Sequence[Expr], theta: float) -> list[tuple[float, ...]]:
    """Evaluate expressions at an angle by plain floats, by an array, and by the code of the compiled loop."""
    scalar, loop, one = _back_ends(tuple(expressions))
    blocks = [np.empty(9) for _ in expressions]
    loop([np.full(9, theta)], blocks)
    with np.errstate(all="ignore"):
        *values, far = one(np.float64(theta))
    assert not far
    return [scalar(theta), tuple(float(b[4]) for b in blocks), tuple(map(float, values))]


@lru_cache(maxsize=64)
def _back_ends(expressions: tuple[Expr, ...]) -> tuple[ScalarFunction, Loop, Any]:
    loop = Loop(list(expressions), ["theta"])
    return compile_scalar(list(expressions), ["theta"]), loop, loop.functions()["one"]


@dataclass(frozen=True)
class FourBarCase:
    """Crank, coupler, rocker [m], the fixed joint C [m], crank angle [rad], side of the coupler's end."""

    l1: float
    l2: float
    l3: float
    ground: tuple[float, float]
    theta: float
    left: bool

    def linkage(self, branch: str | None = None) -> Linkage:
        side: Any = branch or ("left" if self.left else "right")
        dyad = RRRDyad("l2", "l3", "A", "C", "B", (self.l2, self.l3), side)
        return Linkage({"O": (0.0, 0.0), "C": self.ground}, (Crank("l1", at="O", end="A", length_m=self.l1), dyad))

    def truth(self, nudge: Any = 0) -> dict[str, Any]:
        with mp.workdps(DIGITS):
            x, y = mp.mpf(self.ground[0]), mp.mpf(self.ground[1])
            angle, length = mp.atan2(y, x), mp.sqrt(x * x + y * y)
            theta = mp.mpf(self.theta) + nudge
            found = four_bar(
                self.l1, self.l2, self.l3, length, theta, ground_angle=angle, left=self.left, digits=DIGITS
            )
            return found | {"u2": mp.expj(found["th2"]), "u3": mp.expj(found["th3"])}

    def errors(self, branch: str | None = None) -> list[tuple[str, float, float]]:
        """Return (name, error, change by rounding of the angle) of directions and rates, for every back end.

        Speeds and accelerations are relative to the larger of the two links'.
        """
        links = self.linkage(branch).solved.links
        k2, k3 = links["l2"], links["l3"]
        expressions = [k2.first, k3.first, k2.second, k3.second, *_parts(k2.direction), *_parts(k3.direction)]
        truth, nudged = self.truth(), self.truth(NUDGE)
        speed = abs(truth["p2"]) + abs(truth["p3"])
        scales = {"p": speed, "q": abs(truth["q2"]) + abs(truth["q3"]) + speed**2, "u": 1}
        out = []
        for values in by_every_back_end(expressions, self.theta):
            p2, p3, q2, q3, *u = values
            ours = {"p2": p2, "p3": p3, "q2": q2, "q3": q3, "u2": complex(*u[:2]), "u3": complex(*u[2:])}
            for name, value in ours.items():
                scale = scales[name[0]]
                error = abs(mp.mpmathify(value) - truth[name]) / scale
                out.append((name, float(error), float(abs(nudged[name] - truth[name]) / scale)))
        return out


@dataclass(frozen=True)
class SliderCase:
    """Crank and rod [m], a point of the guide [m], its direction, crank angle [rad]; the rod points along the guide."""

    crank: float
    rod: float
    guide_point: tuple[float, float]
    guide_direction: tuple[float, float]
    theta: float

    def linkage(self) -> Linkage:
        dyad = RRPDyad("rod", "slider", "A", "B", "T", (self.rod, 1.0), self.guide_point, self.guide_direction)
        return Linkage({"O": (0.0, 0.0)}, (Crank("crank", at="O", end="A", length_m=self.crank), dyad))

    def truth(self, nudge: Any = 0) -> dict[str, Any]:
        with mp.workdps(DIGITS):
            ax, ay = mp.mpf(self.guide_direction[0]), mp.mpf(self.guide_direction[1])
            norm = mp.sqrt(ax * ax + ay * ay)
            x, y = mp.mpf(self.guide_point[0]), mp.mpf(self.guide_point[1])
            offset, turn = (ax * y - ay * x) / norm, mp.atan2(ay, ax)
            return slider_crank(self.crank, self.rod, offset, mp.mpf(self.theta) - turn + nudge, digits=DIGITS)

    def errors(self) -> list[tuple[str, float, float]]:
        """Return (name, error, change by rounding of the angle) of x, dx, d2x, relative to each or to the crank."""
        end = self.linkage().solved.points["B"]
        norm = math.hypot(*self.guide_direction)
        ax, ay = self.guide_direction[0] / norm, self.guide_direction[1] / norm
        expressions = [ax * v.x + ay * v.y for v in (end.position, end.first, end.second)]
        truth, nudged = self.truth(), self.truth(NUDGE)
        out = []
        for values in by_every_back_end(expressions, self.theta):
            for name, value in zip(("x", "dx", "d2x"), values, strict=True):
                scale = abs(truth[name]) + self.crank
                out.append(
                    (name, float(abs(value - truth[name]) / scale), float(abs(nudged[name] - truth[name]) / scale))
                )
        return out


def _parts(vector: Any) -> tuple[Expr, Expr]:
    return vector.x, vector.y
