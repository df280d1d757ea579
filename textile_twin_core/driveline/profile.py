"""Effect of a linkage on its station of the shaft, over the crank angle: inertia, gravity and loads as tables.

The load torque of a linkage is `sum_r c_r b_r(theta) omega^p_r` with smooth functions b_r and powers p_r of 0, 1 or 2;
the coefficients c_r are constant between the angles at which a load steps, and depend on the direction of rotation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.dynamics.loads.load import LoadContext
from textile_twin_core.dynamics.motion_equation import MotionEquation
from textile_twin_core.dynamics.reduction import reduce_bodies
from textile_twin_core.dynamics.shaft_state import OMEGA, ShaftState
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, derivative, substitute, variable
from textile_twin_core.expression.loop import Loop
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism.vector import Vector

TURN = 2.0 * math.pi
_SAMPLES = 720
_FEWEST_NODES, _MOST_NODES = 64, 16384
_SAME = 1e-11
"""Two functions are equal within this share of their peak."""
_POWERS = (0, 1, 2)


@dataclass(frozen=True)
class Stretches:
    """Coefficients of the load functions in one direction of rotation, constant between the angles of `starts_rad`.

    starts_rad: (k,) in [0, 2 pi), rising; the last stretch goes on to the first one's start. coefficients: (k, r). A
    load without steps has one stretch, which starts at 0.
    """

    starts_rad: FloatArray
    coefficients: FloatArray


class AngleProfile:
    """Functions of one crank angle: J, J'/2, V' and the load functions, with their steps.

    `functions` are expressions of theta: inertia J [kg m^2], half its slope, slope of the potential energy V' [N m],
    then the load functions, each with its power of the speed in `powers`. Torques of loads are positive where they help
    the shaft forward. Raises MachineError for a load that follows the speed by no polynomial of degree two.
    """

    def __init__(self, inertia: Expr, half_slope: Expr, potential: Expr, slope: Expr, loads: Sequence[Expr]) -> None:
        self.potential = potential
        equation = MotionEquation(inertia, half_slope, potential, slope, loads)
        surveys = [equation.survey(direction) for direction in (1, -1)]
        values = sorted({each for _, found in surveys for each in found})
        if any(len(each) < len(equation.leaps) for each in values):
            raise MachineError("a linkage on an elastic shaft must close over the whole turn")
        total = sum(equation.load_torques, const(0.0))
        torques = [
            substitute([total], {leap: const(v) for leap, v in zip(equation.leaps, each, strict=True)})[0]
            for each in values
        ]
        bases, self.powers, coefficients = _split_by_speed(torques)
        self.functions: tuple[Expr, ...] = (inertia, half_slope, slope, *bases)
        rows = dict(zip(values, coefficients, strict=True))
        self.forward, self.backward = (
            _stretches(angles, [rows[each] for each in found], len(bases)) for angles, found in surveys
        )

    @cached_property
    def mean_inertia_kgm2(self) -> float:
        """Mean of J over the turn."""
        return float(self.sampled[0].mean())

    @cached_property
    def sampled(self) -> FloatArray:
        """(functions, samples) over one turn from 0 on, exact."""
        return evaluate(self.functions, TURN * np.arange(_SAMPLES) / _SAMPLES)


def linkage_profile(machine: Machine) -> AngleProfile:
    """The profile of one linkage at phase 0, without loads that act once on the main shaft."""
    motion = machine.linkage.solved
    bodies = [body for body in machine.bodies if not body.is_flywheel]
    reduced = reduce_bodies(motion, bodies, Vector.of(*machine.gravity_m_s2))
    forces = _load_torques(machine, False)
    return AngleProfile(reduced.inertia, reduced.half_slope, reduced.potential, reduced.potential_slope, forces)


def main_shaft_profile(machine: Machine) -> AngleProfile | None:
    """The profile of the main shaft itself: flywheels, friction, torque tables; None without any."""
    flywheels = [body for body in machine.bodies if body.is_flywheel]
    reduced = reduce_bodies(machine.linkage.solved, flywheels, Vector.of(*machine.gravity_m_s2))
    pairs = zip(_load_torques(machine, True), _load_torques(machine, False), strict=True)
    forces = [once - each for once, each in pairs]
    if not flywheels and all(force.is_constant and force.value == 0.0 for force in forces):
        return None
    return AngleProfile(reduced.inertia, reduced.half_slope, reduced.potential, reduced.potential_slope, forces)


def _load_torques(machine: Machine, on_shaft: bool) -> list[Expr]:
    """Torque of each load on the shaft, positive along positive theta, with or without loads on the shaft itself."""
    motion = machine.linkage.solved
    measures = {measure.name: measure for measure in machine.measures}
    displacements = {name: measure.displacement(motion) for name, measure in measures.items()}
    context = LoadContext(motion, ShaftState(), measures, displacements, on_shaft)
    return [load.unit_force(context) * load.intensity(context) for load in machine.loads]


def _stretches(angles: Sequence[float], rows: Sequence[FloatArray], loads: int) -> Stretches:
    return Stretches(np.array(angles or [0.0]), np.array(rows, dtype=float).reshape(len(rows), loads))


def _split_by_speed(torques: Sequence[Expr]) -> tuple[list[Expr], IntArray, FloatArray]:
    """Base functions of the angle, the power of the speed of each, and coefficients (torques, bases)."""
    still = {OMEGA: const(0.0)}
    slopes = derivative(torques, OMEGA)
    bends = derivative(slopes, OMEGA)
    by_power = [
        substitute(torques, still),
        substitute(slopes, still),
        [0.5 * bend for bend in substitute(bends, still)],
    ]
    if any(not bend.is_constant or bend.value for bend in derivative(bends, OMEGA)):
        raise MachineError("a load on an elastic shaft may follow the speed by its first and second power alone")
    bases: list[Expr] = []
    powers: list[int] = []
    columns: list[FloatArray] = []
    for power, functions in zip(_POWERS, by_power, strict=True):
        chosen, coefficients = _independent(functions)
        bases += chosen
        powers += [power] * len(chosen)
        columns.append(coefficients)
    return bases, np.array(powers, dtype=np.int64), np.hstack(columns)


def _independent(functions: Sequence[Expr]) -> tuple[list[Expr], FloatArray]:
    """The fewest of the functions that all are combinations of, and these combinations (functions, chosen)."""
    sampled = evaluate(functions, TURN * (np.arange(_SAMPLES) + 0.377) / _SAMPLES)
    peaks = np.abs(sampled).max(axis=1)
    largest = float(peaks.max())
    if largest == 0.0:
        return [], np.zeros((len(functions), 0))
    _, corner, order = scipy.linalg.qr(sampled.T, mode="economic", pivoting=True)
    rank = int((np.abs(np.diag(corner)) > _SAME * abs(corner[0, 0])).sum())
    chosen = sorted(order[:rank].tolist())
    coefficients = np.linalg.lstsq(sampled[chosen].T, sampled.T, rcond=None)[0].T
    coefficients[np.abs(coefficients) < _SAME] = 0.0
    return [functions[k] for k in chosen], np.ascontiguousarray(coefficients)


def evaluate(functions: Sequence[Expr], theta: FloatArray) -> FloatArray:
    """(functions, angles): expressions of theta at angles [rad]."""
    found = np.empty((len(functions), theta.size))
    if functions:
        Loop(functions, ["theta"])([theta], list(found))
    return found


def tabulate(functions: Sequence[Expr], tolerance: float) -> FloatArray:
    """Periodic cubic Hermite table of functions of theta, refined until each is within the tolerance of its peak.

    Returns (nodes, functions, 4) coefficients of the powers of u in [0, 1) behind each node.
    """
    slopes = derivative(functions, variable("theta"))
    nodes = _FEWEST_NODES
    while True:
        step = TURN / nodes
        begin = step * np.arange(nodes, dtype=np.float64)
        values, rates = evaluate(functions, begin), step * evaluate(slopes, begin)
        after, rates_after = np.roll(values, -1, axis=1), np.roll(rates, -1, axis=1)
        rise = after - values
        table = np.stack([values, rates, 3.0 * rise - 2.0 * rates - rates_after, rates + rates_after - 2.0 * rise], -1)
        middle = table @ np.array([1.0, 0.5, 0.25, 0.125])
        peaks = np.maximum(np.abs(values).max(axis=1), 1e-300)
        error = float((np.abs(middle - evaluate(functions, begin + 0.5 * step)).max(axis=1) / peaks).max())
        if error <= tolerance or nodes >= _MOST_NODES:
            return np.ascontiguousarray(table.transpose(1, 0, 2))
        nodes *= 2
