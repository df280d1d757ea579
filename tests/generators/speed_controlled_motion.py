"""A machine under a proportional-integral speed controller, whose torque falls as the speed rises."""

from __future__ import annotations

import math

import numba
import numpy as np

from tests.generators.mill_recordings import Case, torque_of
from tests.generators.multibody import Floats

_STEP_S, _KEPT, _ANGLES = 2e-5, 10, 16384
"""Time step, number of steps between two results, and nodes of the torque over the angle.

A step of the load is a ramp over one node and passes within twenty time steps: with a tenth of these numbers the motion
does not fit the torque, and the inertia comes out 5 % wrong.
"""


def speed_controlled_motion(
    case: Case, gain_Nms: float, speeds: tuple[float, float]
) -> tuple[Floats, Floats, Floats, Floats]:
    """Integrate time [s] and the shaft's angle [rad], speed [rad/s] and torque [N m] of a case's machine, (n,) each.

    The speed starts at the first value and changes to the second between 45 % and 55 % of the time. The method is the
    Runge-Kutta method of fourth order. The machine's friction must be Coulomb's and viscous.
    """
    grid = 2.0 * math.pi * np.arange(_ANGLES) / _ANGLES
    none = np.zeros(_ANGLES)
    slow = torque_of(case, grid, none + 1e-9, none)
    viscous = case.friction.viscous_Nms
    inertia = torque_of(case, grid, none + 1e-9, none + 1.0) - slow
    centrifugal = 0.01 * (torque_of(case, grid, none + 10.0, none) - slow - 10.0 * viscous)
    tables = np.array([np.append(each, each[0]) for each in (inertia, centrifugal, slow)])
    time = np.arange(0.0, case.duration_s, _STEP_S)
    wanted = np.interp(time / case.duration_s, [0.45, 0.55], speeds)
    theta, omega, integral = _integrated(tables, wanted, viscous, gain_Nms).T
    time, wanted = time[::_KEPT], wanted[::_KEPT]
    return time, theta, omega, gain_Nms * (wanted - omega) + integral


@numba.njit(error_model="numpy", cache=True)  # type: ignore[untyped-decorator]
def _integrated(tables: Floats, wanted: Floats, viscous_Nms: float, gain_Nms: float) -> Floats:
    """Angle, speed and integral part of the controller (n, 3) at every tenth time step."""
    theta, omega, integral = 0.3, wanted[0], 0.0
    out = np.empty((-(-wanted.size // _KEPT), 3))
    for i in range(wanted.size):
        if i % _KEPT == 0:
            out[i // _KEPT, 0], out[i // _KEPT, 1], out[i // _KEPT, 2] = theta, omega, integral
        moved = (0.0, 0.0, 0.0)  # sums of the stages' rates
        speed, rate, growth = 0.0, 0.0, 0.0
        for ahead, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            step = ahead * _STEP_S
            angle, w, held = theta + step * speed, omega + step * rate, integral + step * growth
            place = (angle / (2.0 * math.pi) % 1.0) * _ANGLES
            k = min(int(place), _ANGLES - 1)
            share = place - k
            mass = tables[0, k] + share * (tables[0, k + 1] - tables[0, k])
            growing = tables[1, k] + share * (tables[1, k + 1] - tables[1, k])
            still = tables[2, k] + share * (tables[2, k + 1] - tables[2, k])
            drive = gain_Nms * (wanted[i] - w) + held
            speed = w
            rate = (drive - still - viscous_Nms * w - growing * w**2) / mass
            growth = 0.5 * gain_Nms * (wanted[i] - w)
            moved = (moved[0] + weight * speed, moved[1] + weight * rate, moved[2] + weight * growth)
        theta += _STEP_S / 6.0 * moved[0]
        omega += _STEP_S / 6.0 * moved[1]
        integral += _STEP_S / 6.0 * moved[2]
    return out
