"""A machine under a proportional-integral speed controller, whose torque falls as the speed rises."""

from __future__ import annotations

import math

import numpy as np

from tests.generators.mill_recordings import Case, torque_of
from tests.generators.multibody import Floats

_STEP_S, _ANGLES = 2e-4, 4096


_State = tuple[float, float, float]


def speed_controlled_motion(
    case: Case, gain_Nms: float, speeds: tuple[float, float]
) -> tuple[Floats, Floats, Floats, Floats]:
    """Integrate time [s] and the shaft's angle [rad], speed [rad/s] and torque [N m] of a case's machine, (n,) each.

    The speed starts at the first value and changes to the second between 45 % and 55 % of the time. The method is the
    Runge-Kutta method of fourth order. The machine's friction must be Coulomb's and viscous, its torque otherwise
    smooth.
    """
    grid = 2.0 * math.pi * np.arange(_ANGLES) / _ANGLES
    none = np.zeros(_ANGLES)
    slow = torque_of(case, grid, none + 1e-9, none)
    viscous = case.friction.viscous_Nms
    inertia = torque_of(case, grid, none + 1e-9, none + 1.0) - slow
    centrifugal = 0.01 * (torque_of(case, grid, none + 10.0, none) - slow - 10.0 * viscous)
    tables = [(*np.append(each, each[0]).tolist(),) for each in (inertia, centrifugal, slow)]
    time = np.arange(0.0, case.duration_s, _STEP_S)
    wanted = np.interp(time / case.duration_s, [0.45, 0.55], speeds).tolist()

    def rate(theta: float, omega: float, integral: float, wish: float) -> _State:
        place = (theta / (2.0 * math.pi) % 1.0) * _ANGLES
        k = min(int(place), _ANGLES - 1)
        mass, growing, still = (t[k] + (place - k) * (t[k + 1] - t[k]) for t in tables)
        drive = gain_Nms * (wish - omega) + integral
        resisting = still + viscous * omega + growing * omega**2
        return omega, (drive - resisting) / mass, 0.5 * gain_Nms * (wish - omega)

    state: _State = (0.3, speeds[0], 0.0)
    out, h = np.empty((time.size, 3)), _STEP_S
    for i, wish in enumerate(wanted):
        out[i] = state
        first = rate(*state, wish)
        second = rate(*_moved(state, first, 0.5 * h), wish)
        third = rate(*_moved(state, second, 0.5 * h), wish)
        fourth = rate(*_moved(state, third, h), wish)
        for slope, weight in ((first, 1.0), (second, 2.0), (third, 2.0), (fourth, 1.0)):
            state = _moved(state, slope, weight * h / 6.0)
    theta, omega, integral = out.T
    return time, theta, omega, gain_Nms * (np.asarray(wanted) - omega) + integral


def _moved(state: _State, slope: _State, step: float) -> _State:
    return state[0] + step * slope[0], state[1] + step * slope[1], state[2] + step * slope[2]
