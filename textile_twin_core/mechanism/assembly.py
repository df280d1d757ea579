"""Assembly: does the chain close over its whole range, and how near does it come to a change point."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr
from textile_twin_core.expression.blocks import BlockProgram
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.mechanism.group import Group
from textile_twin_core.mechanism.linkage import Linkage
from textile_twin_core.mechanism.rrr_dyad import RRRDyad

FULL_TURN = (0.0, 2.0 * math.pi)
_SAMPLES = 1441
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Closeness:
    """How near one group comes to opening.

    `margin` is the smallest closure value over its scale (0: change point or toggle) at the shaft
    angle `theta_rad`; `transmission_angle_rad` is the smallest angle between coupler and rocker,
    folded to 0..90 deg, for an RRR dyad.
    """

    group: str
    margin: float
    theta_rad: float
    transmission_angle_rad: float | None


def check_assembly(linkage: Linkage, range_rad: tuple[float, float] = FULL_TURN) -> tuple[Closeness, ...]:
    """Closeness of every group that can open, over a range of the shaft angle.

    Raises MachineError with the shaft angle where the chain opens.
    """
    motion = linkage.solved
    reports = []
    for group in linkage.groups:
        found = group.closures(motion)
        if not found:
            continue
        minima = [_minimum(closure.value, range_rad) for closure in found]
        for closure, (theta, value) in zip(found, minima, strict=True):
            if not value >= -_ROUNDING * closure.scale:
                opens = _opens_at(closure.value, range_rad, theta)
                raise MachineError(
                    f"group '{group.name}' cannot close: at a shaft angle of {math.degrees(opens):.4f} deg "
                    f"{closure.how}; change its lengths or where it is fixed"
                )
        margin, theta = min((v / c.scale, t) for c, (t, v) in zip(found, minima, strict=True))
        reports.append(Closeness(group.name, max(margin, 0.0), theta, _transmission(group, minima)))
    return tuple(reports)


def _transmission(group: Group, minima: list[tuple[float, float]]) -> float | None:
    if not isinstance(group, RRRDyad):
        return None
    l2, l3 = group.lengths_m
    angles = []
    for _, value in minima:
        ratio = max(value, 0.0) / (4.0 * l2 * l3)  # cos^2 or sin^2 of half the angle
        angles.append(2.0 * math.asin(min(1.0, math.sqrt(ratio))))
    return min(angles)


def _values(value: Expr, thetas: FloatArray) -> FloatArray:
    out = np.empty_like(thetas)
    BlockProgram([value], ["theta"])([thetas], [out])
    return out


def _minimum(value: Expr, range_rad: tuple[float, float]) -> tuple[float, float]:
    thetas = np.linspace(*range_rad, _SAMPLES)
    sampled = _values(value, thetas)
    if np.isnan(sampled).any():
        return float(thetas[np.isnan(sampled)][0]), -math.inf
    i = int(np.argmin(sampled))
    function = compile_scalar([value], ["theta"])
    low, high = thetas[max(i - 1, 0)], thetas[min(i + 1, _SAMPLES - 1)]
    best = minimize_scalar(lambda t: function(t)[0], bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    if best.fun < sampled[i]:
        return float(best.x), float(best.fun)
    return float(thetas[i]), float(sampled[i])


def _opens_at(value: Expr, range_rad: tuple[float, float], worst: float) -> float:
    thetas = np.linspace(*range_rad, _SAMPLES)
    sampled = _values(value, thetas)
    opened = np.flatnonzero(~(sampled >= 0.0))
    if opened.size == 0 or opened[0] == 0:
        return worst if opened.size == 0 else float(thetas[0])
    return float(thetas[opened[0]])
