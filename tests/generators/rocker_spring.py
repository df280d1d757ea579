"""A spring between the end of the rocker and the ground: its torque on the shaft, from circles that cross.

The stiffness is that of the machine; the torque is the slope of the energy over the crank angle, by a periodic spline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from tests.generators.multibody import Floats


@dataclass(frozen=True)
class RockerSpring:
    """Lengths [m] of crank, coupler and rocker, the rocker's ground joint, and a spring from its end to `anchor`."""

    crank_m: float
    coupler_m: float
    rocker_m: float
    ground: complex
    anchor: complex
    stiffness_N_m: float
    free_length_m: float

    def end(self, theta: Floats) -> Floats:
        """End of the rocker (n,), complex: left of the line from the crank's pin to the ground joint."""
        pin = self.crank_m * np.exp(1j * theta)
        across = self.ground - pin
        along = (np.abs(across) ** 2 + self.coupler_m**2 - self.rocker_m**2) / (2.0 * np.abs(across))
        return np.asarray(pin + across / np.abs(across) * (along + 1j * np.sqrt(self.coupler_m**2 - along**2)))


SPRINGS = {
    "tufting": RockerSpring(0.015, 0.138, 0.115, 0.07 + 0.155j, 0.07 + 0.4j, 2.0e4, 0.1),
    "loom": RockerSpring(0.06, 0.2, 0.23, 0.3 + 0j, 0.6 + 0.1j, 600.0, 0.25),
}
"""By machine; the linkage is that of the machine."""


@cache
def _slope(machine: str) -> CubicSpline:
    spring = SPRINGS[machine]
    theta = np.linspace(0.0, 2.0 * math.pi, 8193)
    stretch = np.abs(spring.end(theta) - spring.anchor) - spring.free_length_m
    energy = 0.5 * spring.stiffness_N_m * stretch**2
    energy[-1] = energy[0]
    return CubicSpline(theta, energy, bc_type="periodic").derivative()


def spring_torque(machine: str, theta: Floats) -> Floats:
    """Torque [N m] that the shaft must balance at angles (n,)."""
    return np.asarray(_slope(machine)(np.mod(theta, 2.0 * math.pi)))
