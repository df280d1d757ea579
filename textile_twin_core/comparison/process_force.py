"""Force of the process turn by turn: peak force, depth of the pierce, work in and out of a stitch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.dynamics.loads import ForceCurve, Load
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.inference.curved_torque import load_name, measure_of, measured, place_of
from textile_twin_core.machine import Machine
from textile_twin_core.twin import compile_rigid

_NODES, _BINS = 4096, 12
_WEAK = 0.1
"""Squared lever of a bin over the usual one below which its force is not determined."""
COLUMNS = ("force_peak_N", "pierce_depth_m", "work_in_J", "work_out_J")
"""Columns of the trend, in the order of `StitchForces`."""
_PLACES = 257
_PEAKED, _OPPOSED = 0.05, 0.1
"""Over the work of the way in: least work above the usual force of a pierce, least work of the way out with cloth."""


class LoadTorque:
    """Torque of one load of a machine on a rigid shaft."""

    def __init__(self, machine: Machine, load: Load) -> None:
        self._twin = compile_rigid(replace(machine, loads=(load,), shaft=None), ["torque_load_Nm"])

    def torque(self, theta: FloatArray, omega: FloatArray, alpha: FloatArray) -> FloatArray:
        """Compute the torque at states (n,)."""
        torque: FloatArray = self._twin.evaluate(theta, omega, alpha)["torque_load_Nm"]
        return torque


def pierce_of(machine: Machine) -> ForceCurve | None:
    """Return the pierce of the first force curve over a measure: its force above the usual one of the way in.

    A curve without a peak is a pierce as a whole way in. None without such a curve, and where the way out shows no
    force by which cloth would differ from needles.
    """
    for load in machine.loads:
        if not isinstance(load, ForceCurve) or not load.measure.endswith(POSITION):
            continue
        places = np.linspace(load.knots[0], load.knots[-1], _PLACES)[:-1]
        down, up = load.values(places), load.values(places, growing=False)
        usual = float(np.median(down))
        above, work = np.maximum(down - usual, 0.0), float(np.sum(np.abs(down)))
        if work > 0.0 and float(np.sum(np.abs(up))) > _OPPOSED * work:
            peaked = float(np.sum(above)) > _PEAKED * work
            forces = tuple(max(force - usual, 0.0) for force in load.in_N) if peaked else load.in_N
            return replace(load, in_N=forces, out_N=tuple(0.0 for _ in load.knots))
    return None


@dataclass(frozen=True)
class StitchForces:
    """Forces of turns, (t,) each.

    Attributes:
        turn: number of the turn.
        force_peak_N: largest force on the way in. pierce_depth_m: distance beyond the load's begin at which it acts.
        work_in_J, work_out_J: work against the force on the way in and on the way out.
    """

    turn: IntArray
    force_peak_N: FloatArray
    pierce_depth_m: FloatArray
    work_in_J: FloatArray
    work_out_J: FloatArray

    def columns(self, turns: IntArray) -> Mapping[str, FloatArray]:
        """Return the columns for other turns, nan where there is no force."""
        place = np.searchsorted(self.turn, turns)
        inside = np.minimum(place, max(self.turn.size - 1, 0))
        known = (
            (place < self.turn.size) & (self.turn[inside] == turns) if self.turn.size else np.zeros(turns.size, bool)
        )
        found = {}
        for name in COLUMNS:
            values = np.full(turns.size, math.nan)
            values[known] = getattr(self, name)[inside[known]]
            found[name] = values
        return found


class ProcessForce:
    """Forces of one load over its measure, from the residual of the torque.

    The load's own torque is added to the residual and divided by the lever, in bins of the measure. Linkages at one
    phase act together, and the force is that of each.

    Args:
        machine: with a load over a measure (see `of`).
        name: of the load.

    Attributes:
        place: where the load acts. count: linkages that act together.
    """

    def __init__(self, machine: Machine, name: str) -> None:
        self.place, _ = place_of(machine, name)
        load = next(each for each in machine.loads if load_name(each) == name)
        self._own = LoadTorque(machine, load)
        phase = machine.linkages[0].phase_rad
        self.count = len(machine.linkages)
        self._position, self._slope = measured(machine, self.place.measure, phase, _NODES)
        self._way_rad = [
            float(np.mean((self._position >= self.place.begin) & (sense * self._slope > 0.0))) * TURN
            for sense in (1.0, -1.0)
        ]

    @classmethod
    def of(cls, machine: Machine) -> ProcessForce | None:
        """Return the forces of the first load over a measure; None without one, or with linkages at several phases."""
        names = [load_name(load) for load in machine.loads if measure_of(load)]
        phases = {place.phase_rad for place in machine.linkages}
        usable = names and len(phases) == 1 and machine.linkage.solved.turns_fully and not machine.missing_for_torque
        return cls(machine, names[0]) if usable else None

    def turns(
        self, residual_Nm: FloatArray, states: tuple[FloatArray, FloatArray, FloatArray], good: BoolArray
    ) -> StitchForces:
        """Compute the forces of every turn.

        Args:
            residual_Nm: (n,) torque on the shaft that the machine file does not predict.
            states: angle, speed and acceleration of the shaft, (n,) each.
            good: (n,) mask of the usable samples.
        """
        theta, omega, alpha = (each[good] for each in states)
        torque = residual_Nm[good] + self._own.torque(theta, omega, alpha)
        node = np.minimum((np.mod(theta, TURN) * (_NODES / TURN)).astype(np.int64), _NODES - 1)
        position, slope = self._position[node], self._slope[node]
        lever = self.count * np.abs(slope) * np.sign(omega)
        grows = slope * omega > 0.0
        inside = position >= self.place.begin
        whole = np.floor(theta / TURN).astype(np.int64)
        turns, row = np.unique(whole, return_inverse=True)
        count = turns.size
        works = []
        for way, sense in ((grows, 0), (~grows, 1)):
            at, speed = inside & way, np.abs(omega)
            path = np.bincount(row[at], speed[at], count)
            work = np.bincount(row[at], (torque * np.sign(omega) * speed)[at], count)
            works.append(np.where(path > 0.0, work / np.maximum(path, 1e-300) * self._way_rad[sense], math.nan))
        depth = (position - self.place.begin) / (self.place.end - self.place.begin)
        box = np.clip((depth * _BINS).astype(np.int64), 0, _BINS - 1)
        at = inside & grows
        cell = row[at] * _BINS + box[at]
        square = np.bincount(cell, lever[at] ** 2, count * _BINS).reshape(count, _BINS)
        product = np.bincount(cell, (lever * torque)[at], count * _BINS).reshape(count, _BINS)
        known = square > _WEAK * np.median(square, axis=1, keepdims=True)
        force = np.where(known & (square > 0.0), product / np.maximum(square, 1e-300), -math.inf)
        peak = np.argmax(force, axis=1)
        largest = force[np.arange(count), peak]
        width = (self.place.end - self.place.begin) / _BINS
        seen = np.isfinite(largest)
        depth_m = np.where(seen, (peak + 0.5) * width, math.nan)
        return StitchForces(turns, np.where(seen, largest, math.nan), depth_m, works[0], works[1])
