"""Pairs of logs of one shaft on two clocks: an encoder's angle, and a drive's torque with or without its speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

STEP_S = 1e-3


@dataclass(frozen=True)
class Pair:
    """angle_s, angle_rad: (n,) by the encoder's logger. drive_s: (m,) by the clock of the drive's logger.

    true_s: (m,) the same moments by the encoder's clock. speed, theta, omega, alpha: (m,) of the shaft then.
    """

    angle_s: np.ndarray
    angle_rad: np.ndarray
    drive_s: np.ndarray
    true_s: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray


def pair(seed: int, *, steady: bool = False, wander: float = 3e-3, longest_s: float = 90.0) -> Pair:
    """Make a run-up, a working speed that wanders, and a coast-down; `steady` logs of the drive have the speed alone.

    The offset is up to 120 s, the drift up to 200 ppm.
    """
    random = np.random.default_rng(seed)
    offset_s, drift = random.uniform(0.0, 120.0), random.uniform(-2e-4, 2e-4)
    span_s, working = random.uniform(40.0, longest_s), random.uniform(6.0, 25.0)
    t = np.arange(0.0, span_s, STEP_S)
    start_s, stop_s = random.uniform(3.0, 8.0), span_s * random.uniform(0.6, 0.9)
    mean = working * np.clip((t - start_s) / 4.0, 0.0, 1.0) * np.clip((stop_s + 4.0 - t) / 4.0, 0.0, 1.0)
    turned = cumulative_trapezoid(mean, t, initial=0.0)
    nodes = np.arange(0.0, span_s + 4.0, 2.0)
    omega = mean * (1.0 + 0.05 * np.sin(turned) + 0.03 * np.cos(2.0 * turned + 1.0))
    omega *= 1.0 + wander * np.interp(t, nodes, random.standard_normal(nodes.size))
    theta = cumulative_trapezoid(omega, t, initial=0.0)
    alpha = np.gradient(omega, t)
    counts = 2.0 * np.pi / 4096.0
    angle_s = np.arange(0.0, span_s - 0.01, 2e-3)
    begin_s = start_s + 6.0 if steady else random.uniform(0.0, 0.2 * span_s)
    end_s = stop_s - 1.0 if steady else span_s - 0.01
    true_s = np.arange(begin_s, end_s, 4e-3)
    drive_s = (true_s - begin_s) / (1.0 + drift) + begin_s - offset_s
    at = (np.interp(true_s, t, each) for each in (theta, omega, alpha))
    return Pair(angle_s, np.floor(np.interp(angle_s, t, theta) / counts) * counts, drive_s, true_s, *at)
