"""Flywheel against speed ripple, from the variation of kinetic energy over one turn."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import Body
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.machine.machine import Machine
from textile_twin_core.synthesis.turn import over_turn, shaft_angles

_SAMPLES = 2880
_HEAVIEST = 1e9


@dataclass(frozen=True)
class Flywheel:
    """A machine with its flywheel, and its motion under a constant drive torque.

    Attributes:
        ripple: (largest - smallest) over mean speed, before and after.
        mean_torque_Nm: drive torque that maintains the speed.
        energy_swing_J: largest less smallest kinetic energy, from weight and loads.
        speed_at_zero_rad_s: speed at shaft angle 0 in this motion.
        rule_of_thumb_kgm2: energy swing over ripple times speed squared, which neglects the machine's own inertia.
    """

    machine: Machine
    inertia_kgm2: float
    ripple_before: float
    ripple_after: float
    mean_torque_Nm: float
    energy_swing_J: float
    speed_at_zero_rad_s: float
    rule_of_thumb_kgm2: float


def flywheel(machine: Machine, ripple: float, speed_rad_s: float | None = None) -> Flywheel:
    """Size the flywheel that limits the speed ripple, (largest - smallest)/mean, under a constant drive torque.

    At a mean drive torque the kinetic energy is E0 + integral of (mean torque - weight and loads) dtheta, and the speed
    is sqrt(2 E/(J + flywheel)), with the loads taken at the nominal speed. The flywheel is solved by bisection, without
    the usual assumption of a constant inertia. It is 0 where the machine needs none.

    Raises:
        SceneError: for a ripple outside 0 .. 1, or too small for any flywheel.
        MachineError: for a machine without masses, or one that does not turn fully.
    """
    if not 0.0 < ripple < 1.0:
        raise SceneError(f"ripple {ripple!r}: give a number between 0 and 1, such as 0.02 for 2 %")
    speed = machine.nominal_speed_rad_s if speed_rad_s is None else speed_rad_s
    inertia, work, mean = _turn(machine, speed)
    before = _ripple(inertia, work, 0.0, speed)
    swing = float(np.ptp(_energy(inertia, work, 0.0, speed) - 0.5 * inertia * speed**2))
    added = 0.0
    if before > ripple:
        if _ripple(inertia, work, _HEAVIEST, speed) > ripple:
            raise SceneError(
                f"no flywheel up to {_HEAVIEST:g} kg m^2 holds a ripple of {ripple:g} at {speed:.4g} rad/s; allow a"
                " larger ripple, or let the machine turn faster"
            )
        added = brentq(lambda extra: _ripple(inertia, work, extra, speed) - ripple, 0.0, _HEAVIEST, rtol=1e-12)
    heavier = replace(machine, bodies=(*machine.bodies, Body.flywheel(added))) if added else machine
    speeds = _speeds(inertia, work, added, speed)
    after = float(np.ptp(speeds) / speeds.mean())
    return Flywheel(heavier, added, before, after, mean, swing, float(speeds[0]), swing / (ripple * speed**2))


def _turn(machine: Machine, speed: float) -> tuple[FloatArray, FloatArray, float]:
    """Compute inertia [kg m^2], work of drive, weight and loads [J] over a turn, and the mean drive torque."""
    if not machine.linkage.solved.turns_fully:
        raise MachineError(f"machine '{machine.name}' does not turn fully; no constant torque keeps its speed")
    theta = shaft_angles(_SAMPLES)
    names = ("equivalent_inertia_kgm2", "potential_energy_J", "torque_load_Nm")
    inertia, potential, load = over_turn([machine.model.output(name) for name in names], theta, speed)
    mean = float(load.mean())
    excess = mean - load
    steps = 0.5 * (excess + np.roll(excess, -1)) * (2.0 * math.pi / _SAMPLES)
    work = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    return inertia, work - (potential - potential[0]), mean


def _energy(inertia: FloatArray, work: FloatArray, extra: float, speed: float) -> FloatArray:
    """Compute the kinetic energy (n,) of the turn whose mean speed over the angle is the requested one [J]."""
    total = inertia + extra

    def surplus(start: float) -> float:
        return float(np.mean(np.sqrt(np.maximum(2.0 * (start + work) / total, 0.0)))) - speed

    low = -float(work.min())
    high = low + float(np.max(total)) * speed**2 + float(np.ptp(work))
    return work + brentq(surplus, low, high, rtol=1e-14) if surplus(low) < 0.0 else work + low


def _speeds(inertia: FloatArray, work: FloatArray, extra: float, speed: float) -> FloatArray:
    return np.asarray(np.sqrt(2.0 * _energy(inertia, work, extra, speed) / (inertia + extra)))


def _ripple(inertia: FloatArray, work: FloatArray, extra: float, speed: float) -> float:
    speeds = _speeds(inertia, work, extra, speed)
    return float(np.ptp(speeds) / speeds.mean())
