"""A spring between two points that minimises a machine's torque at one speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.loads import Spring
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.expression import sqrt
from textile_twin_core.machine.machine import Machine
from textile_twin_core.synthesis.turn import SAMPLES, over_turn, without_effect

_SHORTEST = 0.02
"""Smallest distance of a spring's ends as a share of their largest distance."""


@dataclass(frozen=True)
class Sprung:
    """A machine with its spring, and the balancing torque over a turn, (n,) [N m], before and after."""

    machine: Machine
    spring: Spring
    theta_rad: FloatArray
    before_Nm: FloatArray
    after_Nm: FloatArray

    @property
    def rms_share(self) -> float:
        """RMS torque after over that before."""
        return float(np.sqrt(np.mean(self.after_Nm**2) / np.mean(self.before_Nm**2)))


def balancing_spring(
    machine: Machine, speed_rad_s: float | None = None, ends: Sequence[tuple[str, str]] | None = None
) -> Sprung:
    """Find the spring that minimises the mean square of the balancing torque at a constant speed.

    Between two points at distance d a spring adds k d d' - k d0 d' to the torque, linear in k and k d0. Each pair of
    `ends` (by default all pairs of a fixed and a moving point) is fitted by least squares with k positive, and the best
    pair is taken. The spring suits one speed, since the inertial torque grows with the square of the speed. With
    several linkages on the shaft each has one spring.

    Raises:
        MachineError: if no pair helps, or masses are missing.
        SceneError: for an unknown point.
    """
    speed = machine.nominal_speed_rad_s if speed_rad_s is None else speed_rad_s
    theta = machine.shaft_angles(SAMPLES)
    (before,) = over_turn([machine.model.output("balancing_torque_Nm")], theta, speed)
    best: tuple[float, Spring] | None = None
    for start, end in _pairs(machine) if ends is None else ends:
        spring, residual = _fit(machine, start, end, theta, before)
        if spring is not None and (best is None or residual < best[0]):
            best = residual, spring
    if best is None or not best[0] < float(np.sum(before**2)):
        raise MachineError(f"machine '{machine.name}': no spring between these points lowers its torque")
    sprung = replace(machine, loads=(*machine.loads, best[1]))
    (after,) = over_turn([sprung.model.output("balancing_torque_Nm")], theta, speed)
    return Sprung(sprung, best[1], theta, before, after)


def _pairs(machine: Machine) -> list[tuple[str, str]]:
    points = machine.linkage.solved.points
    fixed = [name for name, point in points.items() if point.is_fixed]
    return [(a, b) for a in fixed for b, point in points.items() if not point.is_fixed]


def _fit(machine: Machine, start: str, end: str, theta: FloatArray, before: FloatArray) -> tuple[Spring | None, float]:
    points = machine.linkage.solved.points
    for name in (start, end):
        if name not in points:
            raise SceneError(f"there is no point '{name}' for a spring; points: {', '.join(points)}")
    effect = np.zeros((theta.size, 2))
    for linkage in machine.model.linkages:  # each linkage carries such a spring, as it carries every load
        here = linkage.motion.points
        span = here[end].position - here[start].position
        length = sqrt(span.dot(span))
        slope = span.dot(here[end].first - here[start].first) / length
        d, d_slope = over_turn([length, slope], theta)
        if not d.min() > _SHORTEST * d.max() or not np.ptp(d) > 1e-9 * d.max():
            return None, np.inf
        single = np.stack([d * d_slope, -d_slope], axis=1)
        effect += single
    if without_effect(effect, single).any():
        return None, np.inf
    stiffness, pull = np.linalg.lstsq(effect, -before, rcond=1e-12)[0].tolist()
    if not stiffness > 0.0:
        return None, np.inf
    residual = float(np.sum((before + effect @ np.array([stiffness, pull])) ** 2))
    free = pull / stiffness
    if free >= 0.0:
        return Spring(start, end, stiffness, free), residual
    return Spring(start, end, stiffness, 0.0, preload_N=-pull), residual
