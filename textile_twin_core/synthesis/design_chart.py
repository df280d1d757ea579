"""Key figures of designs around one machine, by its closed forms with symbolic parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.dynamics.loads import Backing
from textile_twin_core.dynamics.reactions import inertia_force
from textile_twin_core.expression import Expr, interpret, topological_order
from textile_twin_core.expression.c_source import with_parameters
from textile_twin_core.expression.graph import as_expr
from textile_twin_core.expression.loop import Numpy
from textile_twin_core.machine import Machine
from textile_twin_core.machine.model import total
from textile_twin_core.machine.slots import not_negative, values_of
from textile_twin_core.machines.symbolic_machine import Build, with_symbols
from textile_twin_core.mechanism import Arc, Displacement
from textile_twin_core.synthesis.numbers import (
    MOTION,
    largest,
    motion_number,
    shaking_numbers,
    smallest,
    torque_numbers,
)

_AT_ONCE = 11520
"""Designs times angles per evaluation, so that the arrays stay in the processor's cache."""
_ROUNDING = 1e-9
"""Largest negative closure, over its scale, of links that pass through one line."""
_REAR = 1e-3
"""Largest distance of an arc's least position from its rear point, over the stroke."""
TORQUE = ("peak_torque_Nm", "rms_torque_Nm", "torque_ripple_Nm")
SHAKING = ("largest_shaking_force_N", "rms_shaking_force_N")
TRANSMISSION = "smallest_transmission_angle_rad"


@dataclass(frozen=True)
class Turn:
    """One turn at constant speed: shaft angles (m,), and the distance from the rear that counts as dwell, if given."""

    theta_rad: FloatArray
    speed_rad_s: float
    dwell_within_m: float | None


def result_names(machine: Machine) -> tuple[str, ...]:
    """List the key figures of a machine."""
    of_measures = [f"{measure.name}_{what}" for measure in machine.measures for what in MOTION]
    of_forces = (*TORQUE, *SHAKING) if _has_masses(machine) else ()
    return (*of_measures, *((TRANSMISSION,) if _cosines(machine) is not None else ()), *of_forces)


def _has_masses(machine: Machine) -> bool:
    return bool(machine.bodies) and not machine.missing_for_torque


def _cosines(machine: Machine) -> list[Expr] | None:
    """Express the cosines of the transmission angles; None if a group does not define its own."""
    motion = machine.model.first.motion
    closing = [g for g in machine.groups if any(not closure.limit for closure in g.closures(motion))]
    try:
        return [group.transmission_cosine(motion) for group in closing]
    except NotImplementedError:
        return None


@dataclass(frozen=True)
class _Parts:
    """Expressions of a machine from which its key figures follow.

    Attributes:
        displacements: of the measures, by name.
        radii: of the arcs, by the measure's name [m].
        planes: entry and exit plane of each backing [m].
        closures: quantities that are positive where the linkage closes, and their scales.
        cosines: of the transmission angles.
        numbers: of the declaration that a machine accepts only if positive, and only if not negative.
        forces: balancing torque [N m] and components of the shaking force [N]; empty without masses.
    """

    displacements: Mapping[str, Displacement]
    radii: Mapping[str, Expr]
    planes: Sequence[tuple[Expr, Expr]]
    closures: Sequence[tuple[Expr, float]]
    cosines: Sequence[Expr]
    numbers: tuple[Sequence[Expr], Sequence[Expr]]
    forces: Sequence[Expr]

    @classmethod
    def of(cls, machine: Machine, accepts_zero: Mapping[str, bool]) -> _Parts:
        """Build the expressions; `accepts_zero` by slot, as `not_negative` returns it."""
        model = machine.model
        closures = [closure for group in machine.groups for closure in group.closures(model.first.motion)]
        value = values_of(machine)
        numbers = [[as_expr(value[slot]) for slot, z in accepts_zero.items() if z is zero] for zero in (False, True)]
        forces: list[Expr] = []
        if _has_masses(machine):
            pushes = [
                inertia_force(linkage.motion, body, model.shaft)[0]
                for linkage in model.linkages
                for body in linkage.bodies
                if not body.is_flywheel
            ]
            shaking = total(push.x for push in pushes), total(push.y for push in pushes)
            forces = [model.output("balancing_torque_Nm"), *shaking]
        return cls(
            model.first.displacements,
            {measure.name: as_expr(measure.radius_m) for measure in machine.measures if isinstance(measure, Arc)},
            [(as_expr(b.entry_plane_m), as_expr(b.exit_plane_m)) for b in _backings(machine)],
            [(closure.value, float(closure.scale)) for closure in closures],
            _cosines(machine) or (),
            (numbers[0], numbers[1]),
            forces,
        )

    @property
    def all(self) -> list[Expr]:
        """All expressions."""
        moved = [part for moved in self.displacements.values() for part in (moved.position, moved.first, moved.second)]
        planes = [plane for pair in self.planes for plane in pair]
        closures = [value for value, _ in self.closures]
        checked = [*self.radii.values(), *planes, *closures, *self.cosines, *self.numbers[0], *self.numbers[1]]
        return [*moved, *checked, *self.forces]


def _backings(machine: Machine) -> list[Backing]:
    return [load for load in machine.loads if isinstance(load, Backing)]


class DesignChart:
    """Key figures of the designs around one design, by expressions with symbolic parameters.

    Some constants of a closed form are found numerically: the reference of an unwrapped angle, the rear point of an
    arc, whether a needle reaches its backing. A design for which they differ is not covered.

    Args:
        build: constructs the machine from its numbers.
        numbers: those of the design.
        varied: names of the parameters.
        turn: the shaft's motion.
    """

    def __init__(self, build: Build, numbers: Mapping[str, float], varied: Iterable[str], turn: Turn) -> None:
        nominal = build(numbers)
        signs = not_negative(nominal)
        made = with_symbols(build, numbers, varied, lambda machine: _Parts.of(machine, signs).all)
        self.fixed, self._turn, self._nominal = made.fixed, turn, nominal
        self._parts, self._parameters = _Parts.of(made.machine, signs), {name: name for name in made.parameters}
        context = nominal.model.first.load_context
        self._enters = [backing.enters(context) for backing in _backings(nominal)]
        angles = [e for e in topological_order(self._parts.all) if e.op == "atan2"]
        with np.errstate(invalid="ignore", divide="ignore"):
            own = self._values({name: np.full((1, 1), numbers[name]) for name in self._parameters}, angles, 1)
            self._cuts = {angle: self._crossings(values) for angle, values in zip(angles, own, strict=True)}

    def evaluate(
        self, values: Mapping[str, FloatArray], names: Sequence[str]
    ) -> tuple[dict[str, FloatArray], BoolArray]:
        """Compute results by name (n,), NaN for impossible designs, and (n,) whether the chart covers each design."""
        count = max((v.size for v in values.values()), default=1)
        step = max(1, _AT_ONCE // self._turn.theta_rad.size)
        parts = []
        for begin in range(0, count, step):
            columns = {name: v[begin : begin + step, None] for name, v in values.items()}
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                parts.append(self._part(columns, names, min(step, count - begin)))
        found = {name: np.concatenate([results[name] for results, _ in parts]) for name in names}
        return found, np.concatenate([covered for _, covered in parts])

    def _part(
        self, columns: Mapping[str, FloatArray], names: Sequence[str], size: int
    ) -> tuple[dict[str, FloatArray], BoolArray]:
        parts, turn, measures = self._parts, self._turn, self._nominal.measures
        forced = any(name in (*TORQUE, *SHAKING) for name in names)
        asked = {m.name: [what for what in MOTION if f"{m.name}_{what}" in names] for m in measures}
        moved = [m.name for m in measures if asked[m.name] or forced]
        wanted: list[Sequence[Expr]] = [[value for value, _ in parts.closures], parts.cosines, *parts.numbers]
        wanted += [(d.position, d.first, d.second) for d in (parts.displacements[name] for name in moved)]
        wanted += [parts.forces if forced else ()]
        angles = [e for e in topological_order(e for group in wanted for e in group) if e in self._cuts]
        wanted += [angles, list(parts.radii.values()), [plane for pair in parts.planes for plane in pair]]
        known = self._values(columns, [e for group in wanted for e in group], size)
        closures, cosines, positive, zero, *rest = [[next(known) for _ in group] for group in wanted]
        curves, (forces, wrapped, radii, planes) = dict(zip(moved, rest[:-4], strict=True)), rest[-4:]

        possible = np.ones(size, dtype=np.bool_)
        for closure, (_, scale) in zip(closures, parts.closures, strict=True):
            possible &= smallest(closure) >= -_ROUNDING * scale
        for number in positive:
            possible &= number[:, 0] > 0.0
        for number in zero:
            possible &= number[:, 0] >= 0.0
        covered = np.ones(size, dtype=np.bool_)
        for angle, values in zip(angles, wrapped, strict=True):
            covered &= self._crossings(values) == self._cuts[angle]
        for name, radius in zip(parts.radii, radii, strict=True):
            if name in curves and self._nominal.linkage.solved.turns_fully:  # a link that turns round has no arc
                possible &= np.abs(curves[name][1].mean(axis=1)) < 0.25 * radius[:, 0]
        if forced and self._nominal.loads:
            for name in parts.radii:
                rear, front = smallest(curves[name][0]), largest(curves[name][0])
                covered &= np.abs(rear) <= _REAR * (front - rear)
            for backing, enters, (entry, leave) in zip(
                _backings(self._nominal), self._enters, zip(planes[::2], planes[1::2], strict=True), strict=True
            ):
                reaches = (leave >= entry)[:, 0] | (largest(curves[backing.on][0]) >= entry[:, 0])
                covered &= reaches == enters

        found: dict[str, FloatArray] = {}
        if TRANSMISSION in names:
            worst = np.zeros(size)
            for cosine in cosines:
                worst = np.maximum(worst, np.maximum(largest(cosine), largest(-cosine)))
            found[TRANSMISSION] = np.arccos(np.minimum(worst, 1.0))
        for name, (position, first, second) in curves.items():
            speed = turn.speed_rad_s
            for what in asked[name]:
                motion = position, first * speed, second * speed**2
                found[f"{name}_{what}"] = motion_number(what, *motion, turn.dwell_within_m)
        if forced:
            found |= torque_numbers(forces[0]) | shaking_numbers(forces[1], forces[2])
        return {name: np.where(possible, found[name], np.nan) for name in names}, covered | ~possible

    def _crossings(self, angle: FloatArray) -> IntArray:
        """Count (n,) how often angles (n, m) cross their branch cut over the turn."""
        if self._nominal.linkage.solved.turns_fully:
            angle = np.concatenate([angle, angle[:, :1]], axis=1)
        return np.asarray(np.count_nonzero(np.abs(np.diff(angle, axis=1)) > math.pi, axis=1))

    def _values(self, columns: Mapping[str, FloatArray], wanted: Sequence[Expr], size: int) -> Iterator[FloatArray]:
        """Evaluate expressions for designs in rows and angles in columns."""
        inputs = {"theta": self._turn.theta_rad[None, :], "omega": self._turn.speed_rad_s, "alpha": 0.0, **columns}
        shape = size, self._turn.theta_rad.size
        for value in interpret(with_parameters(wanted, self._parameters), inputs, Numpy):
            yield np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
