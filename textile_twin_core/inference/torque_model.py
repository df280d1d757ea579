"""Torque of a machine over the shaft's state, and its slopes by every number of the machine.

Over the shaft angle theta the torque is J alpha + sum_p (E_p + O_p sign(omega)) |omega|^p with p = 0 .. 3: E_0 is the
weight, E_2 holds the linkage's own J'/2, O_0 is dry friction, O_1 damping, O_2 a drag. Each function of the angle is
evaluated from the expression graph at the nodes of one table, for the machine and for the machine with each number
changed; samples read the tables by linear interpolation. Linkages at the same phase are evaluated once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import ndtr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.dynamics.loads import Backing, ForceCurve, ShaftFriction
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.dynamics.loads.load import LoadContext
from textile_twin_core.dynamics.reduction import reduce_bodies
from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.expression import Expr, const, interpret
from textile_twin_core.inference.parameter import COULOMB, ROTOR, VISCOUS, ModelParameter
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import Slot, changed
from textile_twin_core.mechanism import Linkage, Motion
from textile_twin_core.mechanism.vector import Vector

TURN = 2.0 * np.pi
_NODES = 1024
_STEP = 1e-3
"""Step of the numerical slopes, as a share of a departure's standard deviation."""
_MOVED = 0.05
"""Grid of the values at which tables are evaluated, in standard deviations of a departure."""
_TABLES = 8
"""Number of tables in the cache."""
SPREAD_RAD = 0.03
"""Shaft angle over which a step of the load is smeared, so that the model has slopes there."""
_BESIDE = 1e-6
_ROUNDING = 1e-9
"""Relative size of the rounding errors of slopes."""
_SPEEDS = np.array([0.5, 1.0, 1.5, 2.0])
"""Shaft speeds, over the nominal one, that give the powers 0 to 3 of a load's torque in each direction."""
_POWERS = range(_SPEEDS.size)
INERTIA, EVEN, ODD = 0, 1, 1 + len(_POWERS)
"""Rows of a table: inertia, then the functions of the powers of the speed, even in its sign and odd."""
WEIGHT, SQUARE, DRY, DAMPING = EVEN, EVEN + 2, ODD, ODD + 1
_TRAVELS = ODD + len(_POWERS)
"""First row of the positions of travels, each before its derivative."""


@dataclass(frozen=True)
class Torque:
    """Torque at states.

    Attributes:
        torque_Nm: (m,). variance: (m,) of samples whose side of a step is uncertain.
        slopes: (m,) by parameter. by_omega, by_alpha: (m,) slopes by the shaft's speed and acceleration.
    """

    torque_Nm: FloatArray
    slopes: dict[str, Any]
    variance: FloatArray
    by_omega: FloatArray
    by_alpha: FloatArray


@dataclass(frozen=True)
class Linearisation:
    """Functions of the angle `table` (c, nodes) at values of the tabulated parameters."""

    values: Mapping[str, float]
    table: FloatArray


class TabulatedTorque:
    """Torque and slopes of one machine from tables over the angle.

    Args:
        machine: the machine; its sensors are not used.
        parameters: the parameters of the slopes.
        slots: of the parameters in the machine's declaration.

    Attributes:
        has_laws: true if a force depends on a measure.
    """

    coarse_rad = SPREAD_RAD
    """Shaft angle over which a step of the load is smeared in a fit."""

    def __init__(self, machine: Machine, parameters: Sequence[ModelParameter], slots: Mapping[str, Slot]) -> None:
        self.machine, self.parameters = machine, tuple(parameters)
        self._slots = dict(slots)
        self._backings = [load for load in machine.loads if isinstance(load, Backing)]
        self._of_backing = [
            {slot.attribute: name for name, slot in slots.items() if (slot.field, slot.entry) == ("loads", place)}
            for place, load in enumerate(machine.loads)
            if isinstance(load, Backing)
        ]
        self.has_laws = any(isinstance(load, ForceCurve) for load in machine.loads)
        self._curves = [load for load in machine.loads if isinstance(load, ForceCurve) and load.steps]
        of_backings = {name for each in self._of_backing for name in each.values()}
        self.tabulated = [p for p in self.parameters if p.name in slots and p.name not in of_backings]
        self._phases = Counter(place.phase_rad for place in machine.linkages)
        self.turns_fully = machine.linkage.solved.turns_fully
        self._theta = machine.shaft_angles(_NODES)
        self._speed = machine.nominal_speed_rad_s
        self._linkages: dict[tuple[float, ...], tuple[Linkage, Motion]] = {}
        here = {p.name: p.nominal for p in self.tabulated}
        self.nominal = Linearisation(here, self._evaluate(here))
        self._known = {tuple(here.values()): self.nominal}
        self._slopes = self._slopes_at_nominal()
        self._nodal: dict[tuple[int, ...], tuple[list[int], FloatArray]] = {}
        travel = self.nominal.table[_TRAVELS : _TRAVELS + 2 * len(self._backings) * len(self._phases) : 2]
        entry = [load.entry_plane_m for load in self._backings for _ in self._phases]
        self._passes = [bool(np.max(h) >= plane) for h, plane in zip(travel, entry, strict=True)]

    @property
    def in_file(self) -> tuple[ModelParameter, ...]:
        """Parameters in the machine's declaration."""
        return tuple(p for p in self.parameters if p.name in self._slots)

    def slot_name(self, name: str) -> str:
        """Name of the slot in the machine's declaration of a parameter."""
        return self._slots[name].name

    @property
    def mean_inertia(self) -> float:
        """Mean inertia of the shaft over the turn [kg m2]."""
        return float(np.mean(self.nominal.table[INERTIA]))

    @cached_property
    def shaft_inertias(self) -> frozenset[str]:
        """Parameters that act as an inertia of the shaft itself, the same at all angles, as that of a crank."""
        found = {ROTOR}
        for p, slopes in zip(self.tabulated, self._slopes, strict=True):
            rest = np.abs(slopes).max(axis=1)
            rest[INERTIA] = np.ptp(slopes[INERTIA])
            if np.all(rest < _ROUNDING * float(np.max(np.abs(slopes[INERTIA])))):
                found.add(p.name)
        return frozenset(found)

    def torque_orders(self, speed_rad_s: float) -> FloatArray:
        """Amplitude of the torque at constant speed by order of the turn, from 1 on [N m]."""
        if not self.turns_fully:
            return np.zeros(_NODES // 2)
        speed = np.full(_NODES, speed_rad_s)
        values = {p.name: p.nominal for p in self.parameters}
        torque = self.torque(values, (self._theta, speed, np.zeros(_NODES)), self.nominal.table).torque_Nm
        return np.asarray(2.0 * np.abs(np.fft.rfft(np.nan_to_num(torque)))[1:] / _NODES)

    def depends_on_angle(self) -> bool:
        """True if the torque depends on the shaft angle; without a linkage it does not."""
        w, table = self._speed, self.nominal.table
        torque = sum((table[EVEN + p] + table[ODD + p]) * w**p for p in _POWERS)
        return bool(np.ptp(torque) > 1e-12 * np.max(np.abs(table[INERTIA])) * w**2 or self._backings)

    def linearised(self, values: Mapping[str, float], off_nominal: Collection[str]) -> Linearisation:
        """Evaluate the tables near the values of the off_nominal parameters, at the nominal values of all others.

        The values are rounded to a grid, so that a step too small to matter needs no new table, and the result depends
        on the values alone. Where no linkage of these lengths closes, the nominal table serves. The slopes stay those
        at the nominal values, since mistakes of lengths are small.
        """
        here = {p.name: p.nominal for p in self.tabulated}
        for p in self.tabulated:
            if p.name in off_nominal:
                step = _MOVED * p.departure
                here[p.name] = max(p.nominal + step * round((values[p.name] - p.nominal) / step), p.low)
        key = tuple(here.values())
        if key not in self._known:
            if len(self._known) > _TABLES:
                del self._known[list(self._known)[1]]  # the nominal one stays
            table = self._evaluate(here)
            self._known[key] = Linearisation(here, table) if np.isfinite(table).all() else self.nominal
        return self._known[key]

    def _slopes_at_nominal(self) -> FloatArray:
        """Slopes (k, c, nodes) of the tables by the tabulated parameters."""
        here, nominal = self.nominal.values, self.nominal.table
        slopes = np.empty((len(self.tabulated), *nominal.shape))
        for k, p in enumerate(self.tabulated):
            step = _STEP * p.departure
            slopes[k] = (self._evaluate({**here, p.name: here[p.name] + step}) - nominal) / step
        return slopes

    def table(self, values: Mapping[str, float], about: Linearisation) -> FloatArray:
        """Functions of the angle (c, nodes) with these values, linear about a linearisation."""
        table = about.table.copy()
        for k, p in enumerate(self.tabulated):
            away = values[p.name] - about.values[p.name]
            if away:
                table += away * self._slopes[k]
        return table

    def torque(
        self,
        values: Mapping[str, float],
        state: tuple[FloatArray, FloatArray, FloatArray],
        table: FloatArray,
        slopes: Collection[str] = (),
        way: FloatArray | None = None,
        spread_rad: float = SPREAD_RAD,
    ) -> Torque:
        """Torque at states (theta, omega, alpha), each (m,).

        Args:
            values: by parameter. state: of the shaft. table: of these values.
            slopes: names of the parameters whose slopes are evaluated.
            way: sense of rotation, if it differs from omega's.
            spread_rad: shaft angle over which a step of the load is smeared.
        """
        theta, omega, alpha = state
        sign = np.sign(omega) if way is None else way
        place, share = self._place(theta)
        rows = self._read(table, place, share)
        inertia = rows[INERTIA]
        torque = (inertia + values[ROTOR]) * alpha + values[VISCOUS] * omega + values[COULOMB] * sign
        out: dict[str, Any] = {VISCOUS: omega, COULOMB: sign, ROTOR: alpha} if slopes else {}
        factors: dict[int, Any] = {INERTIA: alpha}
        by_omega: FloatArray = np.full_like(omega, values[VISCOUS])
        ahead, power = np.sign(omega), np.ones_like(omega)
        below = np.zeros_like(omega)
        for p in _POWERS:
            for row, factor, slope in ((EVEN + p, power, ahead), (ODD + p, power * sign, 1.0)):
                factors[row] = factor
                if np.any(rows[row]):
                    torque = torque + rows[row] * factor
                    by_omega = by_omega + p * rows[row] * below * slope
            below, power = power, power * np.abs(omega)
        variance = np.zeros_like(torque)
        counts = list(self._phases.values())
        for k, passes in enumerate(self._passes):
            names, backing = self._of_backing[k // len(counts)], self._backings[k // len(counts)]
            count = counts[k % len(counts)]
            force, free, entry, leave = (  # a force of 0 is no parameter
                values[names[what]] if what in names else getattr(backing, what)
                for what in ("force_N", "free_force_N", "entry_plane_m", "exit_plane_m")
            )
            travel, rate = rows[_TRAVELS + 2 * k], rows[_TRAVELS + 1 + 2 * k]
            going_in = rate * omega > 0.0
            width = np.abs(rate) * spread_rad + _BESIDE
            away = (travel - np.where(going_in, entry, leave)) / width
            inside = ndtr(away) if passes else np.zeros_like(torque)
            lever = count * np.abs(rate) * sign
            torque = torque + lever * (free + (force - free) * inside)
            variance = variance + (lever * (force - free)) ** 2 * inside * (1.0 - inside)
            if slopes:
                bump = -lever * (force - free) * np.exp(-0.5 * away**2) / (2.5066282746 * width) * passes
                for what, column in (
                    ("force_N", lever * inside),
                    ("free_force_N", lever * (1.0 - inside)),
                    ("entry_plane_m", bump * going_in),
                    ("exit_plane_m", bump * ~going_in),
                ):
                    if what in names:
                        out[names[what]] = out.get(names[what], 0.0) + column
                factors[_TRAVELS + 2 * k] = -bump
                factors[_TRAVELS + 1 + 2 * k] = count * np.sign(rate) * sign * (free + (force - free) * inside)
        variance = variance + self._beside_steps(rows, sign, omega, spread_rad)
        if asked := [k for k, p in enumerate(self.tabulated) if p.name in slopes]:
            found = self._chain(tuple(asked), factors, place, share)
            out |= {self.tabulated[k].name: column for k, column in zip(asked, found.T, strict=True)}
        return Torque(torque, out, variance, by_omega, inertia + values[ROTOR])

    def _beside_steps(self, rows: list[Any], sign: FloatArray, omega: FloatArray, spread_rad: float) -> Any:
        """Variance (m,) of samples beside a step of a force curve, whose side is uncertain."""
        counts, variance = list(self._phases.values()), 0.0
        for k, (load, count) in enumerate((load, count) for load in self._curves for count in counts):
            place = _TRAVELS + 2 * (len(self._backings) * len(counts) + k)
            travel, rate = rows[place], rows[place + 1]
            width = np.abs(rate) * spread_rad + _BESIDE
            for at, coming_in, going_out in load.steps:
                inside = ndtr((travel - at) / width)
                step = count * np.abs(rate) * np.where(rate * omega > 0.0, coming_in, going_out) * sign
                variance = variance + step**2 * inside * (1.0 - inside)
        return variance

    def _chain(
        self, asked: tuple[int, ...], factors: Mapping[int, Any], place: tuple[IntArray, IntArray], share: FloatArray
    ) -> FloatArray:
        """Slopes (m, k) by the tabulated parameters asked for, interpolated from those at the nodes."""
        if asked not in self._nodal:
            slopes = self._slopes[list(asked)]
            rows = np.flatnonzero(np.any(slopes, axis=(0, 2)))
            self._nodal[asked] = rows.tolist(), np.ascontiguousarray(slopes[:, rows].transpose(2, 1, 0))
        used, nodal = self._nodal[asked]
        found, weights = np.zeros((share.size, len(asked))), np.zeros((len(used), share.size))
        for weight, c in zip(weights, used, strict=True):
            weight += factors.get(c, 0)
        _add_slopes(*place, share, weights, nodal, found)
        return found

    def _place(self, theta: FloatArray) -> tuple[Any, FloatArray]:
        """Nodes on either side of angles (m,), and the fraction between them."""
        if self.turns_fully:
            u = np.mod(theta, TURN) * (_NODES / TURN)
            low = u.astype(np.int64)
            share, low = u - low, low % _NODES
            return (low, np.where(low + 1 == _NODES, 0, low + 1)), share
        u = np.clip((theta - self._theta[0]) / (self._theta[1] - self._theta[0]), 0.0, _NODES - 1.001)
        low = u.astype(np.int64)
        return (low, low + 1), u - low

    @staticmethod
    def _read(table: FloatArray, place: Any, share: FloatArray) -> list[Any]:
        low, high = place
        return [row[low] * (1.0 - share) + row[high] * share if row.any() else 0.0 for row in table]

    def _evaluate(self, values: Mapping[str, float]) -> FloatArray:
        """Functions of the angle (c, nodes) of the machine with these values of the tabulated parameters."""
        machine = self.machine
        other = {self._slots[p.name].name: values[p.name] for p in self.tabulated if values[p.name] != p.nominal}
        changes = changed(machine, other)
        bodies, loads, measures = (changes.get(f, getattr(machine, f)) for f in ("bodies", "loads", "measures"))
        motion = self._motion(values, changes)
        shaft, gravity = ShaftState(), Vector.of(*machine.gravity_m_s2)
        displacements = {m.name: m.displacement(motion) for m in measures}
        reduced = reduce_bodies(motion, [b for b in bodies if not b.is_flywheel], gravity)
        pulls = [const(0.0), const(0.0)]
        for k, first in enumerate((True, False)):
            context = LoadContext(motion, shaft, {m.name: m for m in measures}, displacements, first)
            for load in loads:
                if not isinstance(load, (Backing, ShaftFriction)):
                    pulls[k] = pulls[k] - load.unit_force(context) * load.intensity(context)
        travels = [displacements[b.on] for b in self._backings]
        travels += [displacements[load.measure.removesuffix(POSITION)] for load in self._curves]
        parts = [reduced.inertia, reduced.half_slope, reduced.potential_slope]
        parts += [expr for each in travels for expr in (each.position, each.first)]
        rows = np.zeros((_TRAVELS + 2 * len(travels) * len(self._phases), _NODES))
        with np.errstate(all="ignore"):
            for number, (phase, count) in enumerate(self._phases.items()):
                theta = self._theta + (phase - machine.linkages[0].phase_rad)
                found = interpret(parts, _states(theta, self._speed), np)
                for k, row in enumerate((INERTIA, SQUARE, WEIGHT)):
                    rows[row] += count * found[k]
                for k in range(len(travels)):
                    place = _TRAVELS + 2 * (k * len(self._phases) + number)
                    rows[place], rows[place + 1] = found[3 + 2 * k], found[4 + 2 * k]
                firsts = int(number == 0)
                for pull, times in zip(pulls, (firsts, count - firsts), strict=True):
                    for k, row in self._loads(pull, theta) if times else ():
                        rows[k] += times * row
        return rows

    def _motion(self, values: Mapping[str, float], changes: Mapping[str, Any]) -> Motion:
        """Motion of the first linkage, solved once for equal points and groups."""
        machine = self.machine
        key = tuple(values[p.name] for p in self.tabulated if self._slots[p.name].field in ("points", "groups"))
        if key not in self._linkages:
            if len(self._linkages) > 1:
                self._linkages.popitem()
            points, groups = (changes.get(field, getattr(machine, field)) for field in ("points", "groups"))
            linkage = Linkage(points, groups, machine.range_rad)
            self._linkages[key] = linkage, linkage.motion(machine.linkages[0].phase_rad)
        return self._linkages[key][1]

    def _loads(self, pull: Expr, theta: FloatArray) -> list[tuple[int, Any]]:
        """Functions of the angle of the loads' torque, by the powers of the speed in each direction."""
        if pull.is_constant:
            return [(WEIGHT, pull.value)]
        speeds = self._speed * np.concatenate([_SPEEDS, -_SPEEDS])
        states = {"theta": np.tile(theta, speeds.size), "omega": np.repeat(speeds, theta.size)}
        states["alpha"] = np.zeros(speeds.size * theta.size)
        torque = np.broadcast_to(interpret([pull], states, np)[0], states["theta"].shape).reshape(2, -1, theta.size)
        powers = np.linalg.solve(np.vander(_SPEEDS, increasing=True), torque)  # (2, powers, nodes), of |speed|
        powers[np.abs(powers) < _ROUNDING * np.max(np.abs(torque))] = 0.0
        powers = powers / self._speed ** np.array(_POWERS)[:, None]
        even, odd = 0.5 * (powers[0] + powers[1]), 0.5 * (powers[0] - powers[1])
        return [*zip(range(EVEN, ODD), even, strict=True), *zip(range(ODD, _TRAVELS), odd, strict=True)]


@compiled
def _add_slopes(
    low: IntArray, high: IntArray, share: FloatArray, weights: FloatArray, nodal: FloatArray, out: FloatArray
) -> None:
    """Add weights (c, m) times the slopes (nodes, c, k) between two nodes of each sample."""
    for i in range(share.size):
        for c in range(weights.shape[0]):
            weight = weights[c, i]
            if weight != 0.0:
                second = weight * share[i]
                first = weight - second
                for k in range(out.shape[1]):
                    out[i, k] += first * nodal[low[i], c, k] + second * nodal[high[i], c, k]


def _states(theta: FloatArray, speed: float) -> dict[str, FloatArray]:
    return {"theta": theta, "omega": np.full(theta.size, speed), "alpha": np.zeros(theta.size)}
