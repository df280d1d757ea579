"""A crank-rocker computed without the engine: circles and derivatives in 40 digits, statics as a 9 x 9 system."""

from __future__ import annotations

from collections.abc import Callable

import mpmath as mp
import numpy as np

Curve = Callable[[mp.mpf], mp.mpc]


def rocker_joint(pin: mp.mpc, pivot: mp.mpc, coupler: float, rocker: float, side: int) -> mp.mpc:
    """Intersect the circles about crank pin and pivot; side +1: left of the line from pin to pivot."""
    across = pivot - pin
    distance = abs(across)
    along = (distance**2 + mp.mpf(coupler) ** 2 - mp.mpf(rocker) ** 2) / (2 * distance)
    height = side * mp.sqrt(mp.mpf(coupler) ** 2 - along**2)
    return pin + across / distance * mp.mpc(along, height)


def second_derivative(curve: Curve, theta: float) -> complex:
    """d2/dtheta2 of a point's path."""
    with mp.workdps(40):
        return complex(mp.diff(lambda t: curve(t).real, theta, 2), mp.diff(lambda t: curve(t).imag, theta, 2))


def cross(a: complex, b: complex) -> float:
    return (a.conjugate() * b).imag


def joint_forces(
    crank: tuple[complex, complex],
    coupler: tuple[complex, complex],
    rocker: tuple[complex, complex],
    wrenches: list[tuple[complex, complex, float]],
) -> tuple[np.ndarray, float]:
    """Forces (shaft on crank, crank on coupler, coupler on rocker, ground on rocker) and the crank's torque.

    Each link is (start, end); `wrenches` holds per link the point, the force there and the couple of weight
    and inertia.
    """
    links = [crank, coupler, rocker]
    # joints: (place, link it pushes, link it pushes back)
    joints = [(crank[0], 0, None), (crank[1], 1, 0), (coupler[1], 2, 1), (rocker[0], 2, None)]
    matrix, right = np.zeros((9, 9)), np.zeros(9)
    for k in range(3):
        place, force, couple = wrenches[k]
        right[3 * k : 3 * k + 3] = [-force.real, -force.imag, -(cross(place - links[k][0], force) + couple)]
    for j, (place, on, back) in enumerate(joints):
        for link, sign in ((on, 1.0), (back, -1.0)):
            if link is None:
                continue
            lever = place - links[link][0]
            matrix[3 * link, 2 * j] = sign
            matrix[3 * link + 1, 2 * j + 1] = sign
            matrix[3 * link + 2, 2 * j] = -sign * lever.imag
            matrix[3 * link + 2, 2 * j + 1] = sign * lever.real
    matrix[2, 8] = 1.0  # torque on the crank
    found = np.linalg.solve(matrix, right)
    return found[0:8:2] + 1j * found[1:8:2], float(found[8])
