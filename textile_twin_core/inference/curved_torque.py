"""Torque of a machine with a force over one of its measures, linear in the forces at knots.

`inference/force_law.py` learns such a law; tests/comparison/test_force_law.py compares it with independent equations.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.special import ndtr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.dynamics.loads import Backing, ForceCurve, Load
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import interpret
from textile_twin_core.inference.parameter import CURVE, ModelParameter
from textile_twin_core.inference.torque_model import TabulatedTorque, Torque
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import Slot

EDGES: Final = ("curve.entry_m", "curve.exit_m")
"""Places where the force sets in and ends, on the way in and on the way out."""
FEWEST_KNOTS: Final = 8
_NODES: Final = 8192
_COARSE_RAD: Final = 0.03
"""Shaft angle over which the model smears an edge."""
_TURN: Final = 2.0 * math.pi
_BENT: Final = 8.0
"""Second difference of the forces over the miss of a straight line between their knots, of a smooth law."""
_STEPPED: Final = 4.0
"""Third difference of the forces about a step over its largest miss, half of it."""

_BEGINS: Final = (0.05, 0.1, 0.2, 0.4)
"""Shares of the measure's stroke before its largest value within which a force without a declared edge may act."""
_WHOLE: Final = (0.999,)
"""Share of a force that is asked for by name: in and out over the whole stroke it explains any torque by angle."""


@dataclass(frozen=True)
class Place:
    """Where a force law acts: measure, first and last value [m], and whether the force may step at the first."""

    name: str
    measure: str
    begin: float
    end: float
    edge: bool
    size_N: float


def place_of(machine: Machine, name: str) -> tuple[Place, Machine]:
    """Find where a force law is asked for, and return the machine without the load that it replaces.

    Args:
        machine: the machine.
        name: a load with a measure (`loads.backing`, `backing`, the name of a force curve), or the position of a
            measure (`sley_position_m`).

    Raises:
        MachineError: for a name that is neither.
    """
    asked = name.removeprefix("loads.").removesuffix(".force_N")
    for k, load in enumerate(machine.loads):
        own = load_name(load)
        measure = measure_of(load)
        if measure and asked in (own, measure):
            rest = replace(machine, loads=machine.loads[:k] + machine.loads[k + 1 :])
            return _declared(machine, load, own, measure), rest
    measures = [f"{each.name}{POSITION}" for each in machine.measures]
    asked = f"{asked}{POSITION}" if f"{asked}{POSITION}" in measures else asked
    if asked in measures:
        low, high = measured_range(machine, asked)
        return Place(asked.removesuffix(POSITION), asked, low, high, False, 0.0), machine
    there = [*(load_name(load) for load in machine.loads if measure_of(load)), *measures]
    raise MachineError(f"no load or measure '{name}' to learn a force of; available: {', '.join(there) or 'none'}")


def load_name(load: Load) -> str:
    """Return the name of a load, as in the paths of its numbers."""
    return str(getattr(load, "name", type(load).__name__.lower()))


def measure_of(load: Load) -> str:
    """Return the position over which a load acts, empty for other loads."""
    if isinstance(load, Backing):
        return f"{load.on}{POSITION}"
    return load.measure if isinstance(load, ForceCurve) and load.measure.endswith(POSITION) else ""


def is_reached(machine: Machine, load: Load) -> bool:
    """Return whether a load acts over a measure that reaches the place where it begins."""
    measure = measure_of(load)
    if not measure:
        return False
    low, high = measured_range(machine, measure)
    return low <= _begin_of(load) < high


def _begin_of(load: Load) -> float:
    return load.entry_plane_m if isinstance(load, Backing) else load.knots[0] if isinstance(load, ForceCurve) else 0.0


def _declared(machine: Machine, load: Load, name: str, measure: str) -> Place:
    low, high = measured_range(machine, measure)
    begin = _begin_of(load)
    if not is_reached(machine, load):
        raise MachineError(
            f"load '{name}': {measure} reaches from {low:.5g} to {high:.5g} m and never {begin:.5g}, where it begins"
        )
    if isinstance(load, Backing):
        return Place(name, measure, begin, high, True, load.force_N)
    assert isinstance(load, ForceCurve)
    ways = (*load.in_N, *(load.out_N or ()))
    edge = bool(load.in_N[0] or (load.out_N or (0.0,))[0])
    return Place(name, measure, begin, high, edge, max(abs(each) for each in ways))


def places_of(machine: Machine, place: Place, whole: bool) -> list[Place]:
    """Return the ranges over which the force may act, also the whole stroke; one where its begin is declared."""
    if place.size_N:
        return [place]
    low, high = measured_range(machine, place.measure)
    return [replace(place, begin=high - share * (high - low), end=high) for share in (*_BEGINS, *_WHOLE * whole)]


def measured_range(machine: Machine, measure: str) -> tuple[float, float]:
    """Compute the smallest and largest position of a measure over the turn."""
    position, _ = measured(machine, measure, 0.0, _NODES)
    return float(position.min()), float(position.max())


def measured(machine: Machine, measure: str, phase_rad: float, nodes: int) -> tuple[FloatArray, FloatArray]:
    """Compute position and its slope (nodes,) over the turn of a linkage, from its angle 0 plus the phase on."""
    declared = next(each for each in machine.measures if f"{each.name}{POSITION}" == measure)
    moved = declared.displacement(machine.linkage.solved)
    theta = machine.shaft_angles(nodes) + phase_rad
    values = interpret([moved.position, moved.first], {"theta": theta}, np)
    return tuple(np.broadcast_to(np.asarray(v, np.float64), theta.shape) for v in values)  # type: ignore[return-value]


class CurvedTorque(TabulatedTorque):
    """Torque of a machine with a force law, whose coefficients are further parameters.

    Args:
        machine: without the load that the law replaces. known, slots: its parameters.
        place: of the law. speed_rad_s: shaft speed at which the forces hold.
    """

    coarse_rad = _COARSE_RAD

    def __init__(
        self,
        machine: Machine,
        known: Sequence[ModelParameter],
        slots: Mapping[str, Slot],
        place: Place,
        speed_rad_s: float,
    ) -> None:
        super().__init__(machine, known, slots)
        self.has_laws = True
        self.place, self.speed_rad_s = place, abs(speed_rad_s)
        self.power: Literal[0, 1, 2] = 0
        self.spread_rad = _COARSE_RAD
        counts = Counter(each.phase_rad for each in machine.linkages)
        self._moved = [(count, *measured(machine, place.measure, phase, _NODES)) for phase, count in counts.items()]
        self.missed = np.zeros(0)
        """(2k,) miss of a straight line to the next knot, as far as known."""
        self.steepest = float(np.max(np.abs(self._moved[0][2])))
        self.use(np.linspace(place.begin, place.end, FEWEST_KNOTS), np.eye(2 * FEWEST_KNOTS))

    def use(self, knots: FloatArray, root: FloatArray) -> None:
        """Take other knots (k,) and another root (free, free) of the prior's covariance."""
        k = knots.size
        eye = np.eye(k)[:, 0 if self.place.edge else 1 :]
        zero = np.zeros_like(eye)
        self.knots = knots
        if self.missed.size != 2 * k:
            self.missed = np.zeros(2 * k)
        self.names = tuple(f"{CURVE}.{n}" for n in range(2 * eye.shape[1]))
        self.spread = np.block([[eye, zero], [zero, eye]]) @ root[: 2 * eye.shape[1], : 2 * eye.shape[1]]
        """(2k, free) forces at the knots, the way in first, per coefficient."""

    def expect_bends(self, x: FloatArray) -> None:
        """Let a straight line between knots miss the law as much as it bends or steps there, for coefficients x."""
        missed = []
        for way in np.split(self.spread @ x, 2):
            bends = np.pad(np.abs(np.diff(way, 2)) / _BENT, 1, mode="edge")
            steps = np.abs(np.diff(way, 3)) / _STEPPED  # of a step between the middle two knots
            missed.append(np.maximum(bends, np.pad(np.maximum(np.append(0.0, steps), np.append(steps, 0.0)), 1)))
        self.missed = np.concatenate(missed)

    def torque(
        self,
        values: Mapping[str, float],
        state: tuple[FloatArray, FloatArray, FloatArray],
        table: FloatArray,
        slopes: Collection[str] = (),
        way: FloatArray | None = None,
        spread_rad: float = _COARSE_RAD,
    ) -> Torque:
        """Torque at states, with that of the law (see `TabulatedTorque.torque`)."""
        found = super().torque(values, state, table, slopes, way, spread_rad)
        theta, omega, _ = state
        sign = np.sign(omega) if way is None else way
        forces = self.spread @ np.array([values[name] for name in self.names])
        k, knots, edge = self.knots.size, self.knots, self.place.edge
        size = sign * np.abs(omega / self.speed_rad_s) ** self.power if self.power else sign
        torque, out, variance = found.torque_Nm, dict(found.slopes), found.variance
        rotated = None if set(slopes).isdisjoint(self.names) else np.zeros((theta.size, self.spread.shape[1]))
        bumps = np.zeros((2, theta.size))
        for count, position, slope in self._moved:
            low, part = self._between(theta)
            high = low + 1 if not self.turns_fully else np.where(low + 1 == _NODES, 0, low + 1)
            place = position[low] + part * (position[high] - position[low])
            rate = slope[low] + part * (slope[high] - slope[low])
            grows = rate * np.where(omega == 0.0, sign, omega) > 0.0
            lever = count * np.abs(rate) * size
            inside: FloatArray = np.asarray(place >= knots[0], np.float64)
            if edge:
                entry, leave = (values.get(name, float(knots[0])) for name in EDGES)
                width = np.abs(rate) * self.spread_rad + 1e-6
                away = (place - np.where(grows, entry, leave)) / width
                inside = ndtr(away)
                # by the usual force: one that is not found yet would hide an edge
                variance = variance + (lever * self.place.size_N) ** 2 * inside * (1.0 - inside)
            at = np.clip(place, knots[0], knots[-1])
            left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, k - 2)
            within = (at - knots[left]) / (knots[left + 1] - knots[left])
            begin = left + np.where(grows, 0, k)
            first, second = lever * inside * (1.0 - within), lever * inside * within
            torque = torque + first * forces[begin] + second * forces[begin + 1]
            if edge:
                force = (1.0 - within) * forces[begin] + within * forces[begin + 1]
                moved = lever * force * np.exp(-0.5 * away**2) / (2.5066282746 * width)
                bumps -= np.where(grows, moved, 0.0), np.where(grows, 0.0, moved)
            variance = variance + (first * self.missed[begin] + second * self.missed[begin + 1]) ** 2
            if rotated is not None:
                on = np.flatnonzero(inside)
                beside = second[on, None] * self.spread[begin[on] + 1]
                rotated[on] += first[on, None] * self.spread[begin[on]] + beside
        if rotated is not None:
            out |= {name: rotated[:, c] for c, name in enumerate(self.names)}
            if edge:
                out |= dict(zip(EDGES, bumps, strict=True))
        return Torque(torque, out, variance, found.by_omega, found.by_alpha)

    def _between(self, theta: FloatArray) -> tuple[IntArray, FloatArray]:
        """Node below angles (m,), and the fraction to the next one."""
        if self.turns_fully:
            node = np.mod(theta, _TURN) * (_NODES / _TURN)
            low = node.astype(np.int64)
            return low % _NODES, node - low
        angles = self.machine.shaft_angles(_NODES)
        node = np.clip((theta - angles[0]) / (angles[1] - angles[0]), 0.0, _NODES - 1.001)
        low = node.astype(np.int64)
        return low, node - low
