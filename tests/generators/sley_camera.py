"""The fourth paper's test: the sley's displacement filmed by a high-speed camera, by independent equations.

The gears follow the closed form of equal ellipses about their foci (Zhao, Ren and Chen 2011, Eq. 1-5), the crank-rocker
the law of cosines, without code of the engine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.generators.multibody import Floats
from tests.generators.planned_motion import Plan

AXIS_RATIO, PAST_RAD = 0.85, math.radians(4.0)
CRANK, COUPLER, ROCKER, GROUND, SLEY = 0.040, 0.100, 0.180, 0.199, 0.1895
START_NS = 1_000_000_000


@dataclass(frozen=True)
class CameraTrace:
    """Log at 1 kHz: stamps [ns], wrapped spindle angle [rad], displacement from the rear [m]."""

    stamps_ns: npt.NDArray[np.int64]
    angle_rad: Floats
    displacement_m: Floats


def displacement(theta: Floats) -> Floats:
    """Compute the sley's arc from its rear point [m] at spindle angles (n,); at 0 the sley is in front."""
    turned = _driven(theta + PAST_RAD) - _driven(np.array([PAST_RAD]))
    reach = CRANK + COUPLER  # stretched at the front
    front = math.acos((reach**2 + GROUND**2 - ROCKER**2) / (2.0 * reach * GROUND))
    swing = _rocker(front - turned)
    return np.asarray(SLEY * (swing - _rocker(np.linspace(0.0, 2.0 * np.pi, 200_001)).min()))


def _driven(angle: Floats) -> Floats:
    """Compute the driven gear's angle since its greatest speed from the driver's, unwrapped."""
    eccentricity = math.sqrt(1.0 - AXIS_RATIO**2)
    factor = (1.0 + eccentricity) / (1.0 - eccentricity)
    turn = np.rint(angle / (2.0 * np.pi))
    return np.asarray(2.0 * np.pi * turn + 2.0 * np.arctan(factor * np.tan(0.5 * (angle - 2.0 * np.pi * turn))))


def _rocker(crank: Floats) -> Floats:
    """Compute the angle at the rocker's axis from the ground line, given the crank angle from the ground line."""
    pin_x, pin_y = CRANK * np.cos(crank), CRANK * np.sin(crank)
    away = np.hypot(GROUND - pin_x, pin_y)
    to_pin = np.arctan2(pin_y, GROUND - pin_x)
    return np.asarray(to_pin + np.arccos((ROCKER**2 + away**2 - COUPLER**2) / (2.0 * ROCKER * away)))


def filmed(
    seed: int, scale: float, delay_s: float, zero_rad: float, duration_s: float = 12.0, run_up: bool = True
) -> CameraTrace:
    """Film at 100 r/min with 0.2 mm of noise, camera errors in scale and delay, and an encoder zero."""
    rng = np.random.default_rng([seed, 4])
    speed = 100.0 * 2.0 * math.pi / 60.0
    points = (
        [(0.0, 0.3 * speed), (2.0, 0.4 * speed), (7.0, speed), (duration_s + 1.0, speed)]
        if run_up
        else [(0.0, speed), (99.0, speed)]
    )
    plan = Plan(points, float(rng.uniform(0.0, 6.0)), [(1, 0.01, 0.4)])
    time = np.arange(0.1, duration_s, 1e-3)
    angle = np.mod(plan.at(time)[0] + zero_rad, 2.0 * np.pi)
    angle = np.rint(angle / (2.0 * np.pi) * 4096.0) * (2.0 * np.pi / 4096.0)
    seen = scale * displacement(plan.at(time - delay_s)[0]) + 2e-4 * rng.standard_normal(time.size)
    return CameraTrace(START_NS + np.rint(time * 1e9).astype(np.int64), angle, seen)
