"""A second linkage on the same shaft, out of phase, so that the inertial torques compensate each other."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MachineError
from textile_twin_core.machine import Machine, ShaftPlace
from textile_twin_core.synthesis.turn import over_turn, shaft_angles

_GRID = 721


@dataclass(frozen=True)
class Phased:
    """A machine with a second linkage at `phase_rad`, and the inertial torque over a turn, (n,) [N m].

    `together_Nm` is the torque of two linkages in phase, `apart_Nm` that of the two at the phase.
    """

    machine: Machine
    phase_rad: float
    theta_rad: FloatArray
    together_Nm: FloatArray
    apart_Nm: FloatArray


def opposed_linkages(machine: Machine, phase_rad: float | None = None, speed_rad_s: float | None = None) -> Phased:
    """Add a second linkage, ahead by `phase_rad` or by the phase of least inertial torque.

    With the torque's harmonics c_n, two linkages at the phase p give c_n (1 + e^(i n p)). In antiphase (p = pi) the odd
    harmonics vanish and the even ones double. Without `phase_rad` the result is the p of the smallest sum of squares.

    Raises:
        MachineError: for a machine that does not turn fully or has no masses.
    """
    if not machine.linkage.solved.turns_fully:
        raise MachineError(f"machine '{machine.name}' does not turn fully; phases on its shaft mean nothing")
    speed = machine.nominal_speed_rad_s if speed_rad_s is None else speed_rad_s
    theta = shaft_angles()
    single = replace(machine, linkages=machine.linkages[:1])
    (torque,) = over_turn([single.model.output("torque_inertial_Nm")], theta, speed)
    if phase_rad is None:
        phase_rad = _best_phase(np.abs(np.fft.rfft(torque)) ** 2)
    start = machine.linkages[0].phase_rad
    pair = replace(machine, linkages=(machine.linkages[0], ShaftPlace(start + phase_rad)))
    (apart,) = over_turn([pair.model.output("torque_inertial_Nm")], theta, speed)
    return Phased(pair, phase_rad, theta, 2.0 * torque, apart)


def _best_phase(power: FloatArray) -> float:
    """Find the phase p in (0, pi] of the smallest sum of squares of c_n (1 + e^(i n p)), even and periodic in p."""
    orders = np.arange(power.size)

    def power_at(phase: float) -> float:
        return float(np.sum(power * (1.0 + np.cos(orders * phase))))

    grid = np.linspace(0.0, math.pi, _GRID)
    k = int(np.argmin([power_at(p) for p in grid.tolist()]))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, _GRID - 1)]
    found = minimize_scalar(power_at, bounds=(low, high), method="bounded", options={"xatol": 1e-12})
    return min((float(found.x), float(grid[k])), key=power_at)
