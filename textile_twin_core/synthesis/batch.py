"""Evaluation of many designs of one machine at once, tens of thousands of designs per second."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.machine.drive import load_names
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machine.slots import not_negative, read
from textile_twin_core.mechanism import MAIN_SHAFT
from textile_twin_core.synthesis.batch_loads import Turn, displacement, is_known, load_torque
from textile_twin_core.synthesis.batch_motion import Chain, Columns, Point, solve
from textile_twin_core.synthesis.numbers import MOTION, largest, motion_number, shaking_numbers, torque_numbers
from textile_twin_core.synthesis.turn import shaft_angles

SAMPLES = 180
_AT_ONCE = 11520
"""Designs times angles per evaluation, so that the arrays stay in the processor's cache."""
_ROUNDING = 1e-9
"""Largest excess over 1 of the cosine of a transmission angle where two links pass through one line."""
TORQUE = ("peak_torque_Nm", "rms_torque_Nm", "torque_ripple_Nm")
SHAKING = ("largest_shaking_force_N", "rms_shaking_force_N")
TRANSMISSION = "smallest_transmission_angle_rad"


class Batch:
    """Results of many designs that differ from one machine in the values of some slots (see `slots`).

    If some load has no batch form, results of the torque are not available. Raises SceneError for a machine with a
    group that has none.
    """

    def __init__(
        self,
        machine: Machine,
        speed_rad_s: float | None = None,
        dwell_within_m: float | None = None,
        samples: int = SAMPLES,
    ) -> None:
        self.machine, self.dwell_within_m = machine, dwell_within_m
        self.speed_rad_s = machine.nominal_speed_rad_s if speed_rad_s is None else speed_rad_s
        self.base = read(machine)
        self._not_negative = not_negative(machine)
        self._theta = shaft_angles(samples)
        self._has_masses = bool(machine.bodies) and not machine.missing_for_torque
        self._knows_loads = all(is_known(load) for load in machine.loads)
        self.evaluate({}, self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the available results."""
        of_measures = [f"{measure.name}_{what}" for measure in self.machine.measures for what in MOTION]
        of_torque = TORQUE if self._has_masses and self._knows_loads else ()
        return (*of_measures, TRANSMISSION, *of_torque, *(SHAKING if self._has_masses else ()))

    def evaluate(self, values: Mapping[str, FloatArray], names: Iterable[str]) -> dict[str, FloatArray]:
        """Compute results by name, each (n,), for the values (n,) by slot; NaN for a design that is impossible.

        A design is impossible if it cannot close, has a negative mass, inertia or length, or a length of zero.

        Raises:
            SceneError: for an unknown result or slot.
        """
        names = tuple(names)
        for name in names:
            if name not in self.names:
                raise SceneError(f"there is no number '{name}'; available: {', '.join(self.names)}")
        for slot in values:
            if slot not in self.base:
                raise SceneError(f"machine '{self.machine.name}' has no number '{slot}'")
        count = max((np.size(v) for v in values.values()), default=1)
        step = max(1, _AT_ONCE // self._theta.size)
        parts = []
        for begin in range(0, count, step):
            size = min(step, count - begin)
            columns = {name: np.full((1, 1), value) for name, value in self.base.items()}
            columns |= {
                name: np.broadcast_to(v, count)[begin : begin + size, None].astype(np.float64)
                for name, v in values.items()
            }
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                parts.append(self._part(columns, names, size))
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

    def _part(self, columns: Columns, names: tuple[str, ...], size: int) -> dict[str, FloatArray]:
        first = self._chain(columns, self.machine.linkages[0].phase_rad)
        found: dict[str, Any] = {}
        shape = (size, self._theta.size)
        for measure in self.machine.measures:
            asked = [what for what in MOTION if f"{measure.name}_{what}" in names]
            if asked:
                h, h1, h2 = displacement(measure, first)
                w = self.speed_rad_s
                x, v, a = (np.broadcast_to(c, shape) for c in (h, h1 * w, h2 * w * w))
                for what in asked:
                    found[f"{measure.name}_{what}"] = motion_number(what, x, v, a, self.dwell_within_m)
        worst = np.ones(1)
        for cosine in first.cosines:
            worst = np.minimum(worst, 1.0 - np.maximum(largest(cosine), largest(-cosine)))
        closes = (worst >= -_ROUNDING) & self._can_be(columns)
        for margin in first.slot_margins:
            closes = closes & (largest(-margin) <= 0.0)
        found[TRANSMISSION] = np.arccos(1.0 - np.maximum(worst, 0.0))
        if self._has_masses and any(name in TORQUE or name in SHAKING for name in names):
            torque, shaking = self._forces(columns, first)
            found |= torque_numbers(np.broadcast_to(torque, shape))
            found |= shaking_numbers(*(np.broadcast_to(part, shape) for part in (shaking.real, shaking.imag)))
        return {n: np.where(np.broadcast_to(closes, size), np.broadcast_to(found[n], size), np.nan) for n in names}

    def _can_be(self, columns: Columns) -> Any:
        """Return (n,) or (1,) whether every number is positive where a machine requires it."""
        sound = np.ones(1, dtype=np.bool_)
        for name, zero in self._not_negative.items():
            column = columns[name][:, 0]
            sound = sound & ((column >= 0.0) if zero else (column > 0.0))
        return sound

    def _chain(self, columns: Columns, phase_rad: float) -> Chain:
        chain = Chain(columns, ends={link.name: (link.start, link.end) for link in self.machine.links})
        zero = np.zeros((1, 1))
        chain.rotations[MAIN_SHAFT] = np.exp(1j * (self._theta + phase_rad))[None, :], zero + 1.0, zero
        for name in self.machine.points:
            chain.points[name] = _ground(columns, name)
        for group in self.machine.groups:
            solve(group, chain)
        return chain

    def _forces(self, columns: Columns, first: Chain) -> tuple[Any, Any]:
        """Compute balancing torque [N m] and shaking force [N, complex] of all linkages at constant speed."""
        torque: Any = 0.0
        shaking: Any = 0.0
        w2, pull = self.speed_rad_s**2, complex(*self.machine.gravity_m_s2)
        for number, place in enumerate(self.machine.linkages):
            chain = first if number == 0 else self._chain(columns, place.phase_rad)
            seen: dict[str, int] = {}
            for body in self.machine.bodies:
                seen[body.on] = seen.get(body.on, 0) + 1
                name = body.on if seen[body.on] == 1 else f"{body.on}#{seen[body.on]}"
                if body.is_flywheel:
                    continue
                mass, inertia = columns[f"{name}.mass_kg"], columns[f"{name}.inertia_kgm2"]
                link = chain.links[body.on]
                along, across = columns[f"{name}.centroid_along"], columns[f"{name}.centroid_across"]
                centre = link.at((along + 1j * across) * link.length)
                inertial = mass * w2 * centre.second
                push = inertial - mass * pull
                torque = torque + (np.conj(centre.first) * push).real + (w2 * inertia) * (link.first * link.second)
                shaking = shaking - inertial
            turn = Turn(chain, self.machine.measures, self.speed_rad_s, number == 0)
            for name, load in zip(load_names(self.machine.loads), self.machine.loads, strict=True):
                if not self._knows_loads:
                    break  # the torque is not available
                torque = torque + load_torque(load, name, turn)
        return torque, shaking


def _ground(columns: Columns, name: str) -> Point:
    zero = np.zeros((1, 1))
    return Point(columns[f"{name}.x_m"] + 1j * columns[f"{name}.y_m"], zero, zero)
