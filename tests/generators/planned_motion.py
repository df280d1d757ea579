"""Shaft motions in closed form: standstill, run-up, steady speed with ripple, speed changes, coast-down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tests.generators.multibody import Floats


@dataclass(frozen=True)
class Plan:
    """Mean speed over time by raised cosines between (time [s], speed [rad/s]) points, with ripple by angle.

    psi is the integral of the mean speed b; theta = start + psi + sum a_k sin(k psi + p_k) / k, so speed and
    acceleration are its exact derivatives: omega = b (1 + sum a_k cos(k psi + p_k)).
    """

    points: Sequence[tuple[float, float]]
    start_rad: float = 0.0
    ripple: Sequence[tuple[int, float, float]] = ()

    def at(self, time: npt.NDArray[np.floating[Any]]) -> tuple[Floats, Floats, Floats]:
        """Compute angle [rad], speed [rad/s] and acceleration [rad/s^2] at times (n,) within the plan."""
        psi, mean, change = np.zeros_like(time), np.zeros_like(time), np.zeros_like(time)
        done = 0.0
        for (t0, b0), (t1, b1) in zip(self.points[:-1], self.points[1:], strict=True):
            span, rise = t1 - t0, b1 - b0
            inside = (time >= t0) & ((time < t1) | (t1 == self.points[-1][0]))
            s = time[inside] - t0
            wave = math.pi / span
            psi[inside] = done + b0 * s + 0.5 * rise * (s - np.sin(wave * s) / wave)
            mean[inside] = b0 + 0.5 * rise * (1.0 - np.cos(wave * s))
            change[inside] = 0.5 * rise * wave * np.sin(wave * s)
            done += 0.5 * (b0 + b1) * span
        theta, factor, slope = self.start_rad + psi, np.ones_like(time), np.zeros_like(time)
        for order, size, phase in self.ripple:
            angle = order * psi + phase
            theta += size * (np.sin(angle) - math.sin(phase)) / order
            factor += size * np.cos(angle)
            slope -= size * order * np.sin(angle)
        return theta, mean * factor, change * factor + mean**2 * slope


def steady(duration_s: float, speed: float, rng: np.random.Generator) -> Plan:
    """Plan one speed throughout, with 0.3 % of wander and a ripple of 1 to 3 %."""
    times = np.arange(0.0, duration_s + 3.0, 3.0)
    points = [(float(t), speed * (1.0 + 0.003 * rng.standard_normal())) for t in times]
    return Plan(points, float(rng.uniform(0.0, 2.0 * math.pi)), _ripple(rng))


def run_up_and_down(duration_s: float, speed: float, rng: np.random.Generator) -> Plan:
    """Plan a second of standstill, run-up in 4 s, running with two changes of speed, coast-down in 5 s, standstill."""
    end = duration_s
    third = (end - 11.0) / 3.0
    points = [(0.0, 0.0), (1.0, 0.0), (5.0, speed), (5.0 + third, speed * (1.0 + 0.003 * rng.standard_normal()))]
    points += [(5.0 + 1.3 * third, 0.75 * speed), (5.0 + 2.0 * third, 0.76 * speed), (5.0 + 2.2 * third, speed)]
    points += [(end - 6.0, 1.002 * speed), (end - 1.0, 0.0), (end, 0.0)]
    return Plan(points, float(rng.uniform(0.0, 2.0 * math.pi)), _ripple(rng))


def _ripple(rng: np.random.Generator) -> list[tuple[int, float, float]]:
    sizes = [(1, rng.uniform(0.01, 0.03)), (2, rng.uniform(0.003, 0.012)), (3, rng.uniform(0.0, 0.004))]
    return [(order, float(size), float(rng.uniform(0.0, 2.0 * math.pi))) for order, size in sizes]
