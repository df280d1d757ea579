"""Force over a measure of the linkage, inferred from the torque together with sensors, friction and machine.

A load's torque is its force times the slope of its measure, so the forces at knots are linear parameters. They have a
Gaussian process as prior (Matern, order 3/2, with a free mean) on the way in and on the way out; its size and length
follow from the evidence. The coefficients of the prior's root are parameters of the measurement model like any other,
so that `map_fit`, the evidence of departures and the settled values hold unchanged.

References:
    Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapters 2 and 5.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.special import ndtr

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.dynamics.loads import Backing, ForceCurve, Load
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import interpret
from textile_twin_core.inference.evidence import Choice, Departures, QuadraticEvidence, choose, is_one
from textile_twin_core.inference.map_fit import Fit, fit_with_prior_update, map_fit
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    COULOMB,
    CURVE,
    DELAY,
    EDGE,
    GAIN,
    OFFSET,
    VISCOUS,
    ZERO,
    ModelParameter,
)
from textile_twin_core.inference.posterior import Posterior
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.torque_model import TabulatedTorque, Torque
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import Slot

EDGES: Final = ("curve.entry_m", "curve.exit_m")
"""Places where the force sets in and ends, on the way in and on the way out."""
_NODES: Final = 8192
_MOST_KNOTS, _FEWEST_KNOTS, _SAMPLES_A_KNOT = 28, 8, 25
_SIZES: Final = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Standard deviations of the force about its mean, over the usual force, that the evidence compares."""
_LENGTHS: Final = (0.08, 0.15, 0.3, 0.6, 1.2)
"""Lengths of the prior over the range of the knots."""
_FINER: Final = (1.6, 1.3, 1.3, 1.15, 1.15, 1.07, 1.07, 1.03)
"""Factors by which size and length move from the best of the grid on."""
_MOVED: Final = 0.3
"""Change of their logarithm above which the law is fitted again."""
_MEAN, _JITTER = 3.0, 1e-4
"""Standard deviation of the mean force, and smallest independent part, over the usual force."""
_EDGE_M: Final = 5e-4
"""Standard deviation of the place of an edge: cloth is thicker here than there [m]."""
_COARSE_RAD, _FINE_RAD = 0.03, 0.006
"""Shaft angle over which the model smears an edge, in the first fits and in the last."""
_BEGINS: Final = (0.05, 0.1, 0.2, 0.4, 0.999)
"""Shares of the measure's stroke before its largest value within which a force without a declared edge may act."""
_OTHER_SPEED_NATS: Final = 6.0
"""Log evidence by which a force that grows with the speed must be likelier."""
_WORKING, _VARIES = 0.3, 0.2
"""Share of the fast speeds from which the machine works, and relative spread of these that shows a law of the speed."""
_FEW: Final = 3000
"""Samples of the first fits."""
_FIRST: Final = (0.3, 0.15)
"""Size and length of the first fits."""
_MISSED: Final = 0.005
"""Miss of a straight line between two knots, over the peak, above which there are twice as many."""
_TURN: Final = 2.0 * math.pi
_ROUNDS, _SETTLING, _REFINED = 4, 2, 1
_EXPLAINED: Final = 0.98
"""Share of the torque that a first fit explains which needs no other start."""
_WORKING_SAMPLES: Final = 6000
"""Samples of all fits but the last."""
_BENT: Final = 8.0
"""Second difference of the forces over the miss of a straight line between their knots, of a smooth law."""
_SENSORS: Final = (ZERO, DELAY, GAIN, OFFSET, COULOMB, VISCOUS)
_DETERMINED: Final = 0.1
"""Standard deviation over the curve's peak above which a knot counts as not determined."""


@dataclass(frozen=True)
class Place:
    """Where a force law acts: measure, first and last value [m], and whether the force may step at the first."""

    name: str
    measure: str
    begin: float
    end: float
    edge: bool
    size_N: float


@dataclass(frozen=True)
class LearnedCurve:
    """A force law with standard deviations.

    Attributes:
        name, measure: of the load. knots: (k,) values of the measure.
        in_N, out_N: (k,) force against the motion while the measure grows and shrinks.
        covariance: (2k, 2k) of both together, the way in first.
        speed_power: power of the shaft speed with which the force grows. at_speed_rad_s: speed of the values.
    """

    name: str
    measure: str
    knots: FloatArray
    in_N: FloatArray
    out_N: FloatArray
    covariance: FloatArray
    speed_power: Literal[0, 1, 2]
    at_speed_rad_s: float

    @property
    def in_sigma_N(self) -> FloatArray:
        """(k,) standard deviations on the way in."""
        return np.sqrt(np.diag(self.covariance)[: self.knots.size])

    @property
    def out_sigma_N(self) -> FloatArray:
        """(k,) standard deviations on the way out."""
        return np.sqrt(np.diag(self.covariance)[self.knots.size :])

    @property
    def peak_N(self) -> float:
        """Largest force."""
        return float(max(np.max(np.abs(self.in_N)), np.max(np.abs(self.out_N))))

    def undetermined(self, growing: bool = True) -> BoolArray:
        """(k,) mask of the knots whose force the record does not determine."""
        sigma = self.in_sigma_N if growing else self.out_sigma_N
        return np.asarray(sigma > _DETERMINED * self.peak_N)

    def load(self) -> ForceCurve:
        """Return the law as a load of a machine."""
        down, up = (tuple(np.round(each, 3).tolist()) for each in (self.in_N, self.out_N))
        knots, speed = tuple(np.round(self.knots, 8).tolist()), self.at_speed_rad_s if self.speed_power else None
        return ForceCurve(self.name, self.measure, knots, down, up, speed_power=self.speed_power, at_speed_rad_s=speed)

    def work_J(self) -> tuple[float, float, float, float]:
        """Work against the force on the way in and on the way out, each with its standard deviation [J]."""
        width = np.diff(self.knots, prepend=self.knots[0], append=self.knots[-1])
        share = 0.5 * (width[:-1] + width[1:])
        found = []
        for k, force in enumerate((self.in_N, self.out_N)):
            part = slice(k * share.size, (k + 1) * share.size)
            found += [float(share @ force), math.sqrt(max(float(share @ self.covariance[part, part] @ share), 0.0))]
        return found[0], found[1], found[2], found[3]


@dataclass(frozen=True)
class CurvePosterior:
    """Posterior of a record under a force law: the usual posterior, and the law."""

    posterior: Posterior
    curve: LearnedCurve


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


def _declared(machine: Machine, load: Load, name: str, measure: str) -> Place:
    low, high = measured_range(machine, measure)
    if isinstance(load, Backing):
        begin, edge, size = load.entry_plane_m, True, load.force_N
    else:
        assert isinstance(load, ForceCurve)
        forces = (*load.in_N, *(load.out_N or ()))
        begin, size = load.knots[0], max(abs(each) for each in forces)
        edge = bool(load.in_N[0] or (load.out_N or (0.0,))[0])
    if not low <= begin < high:
        raise MachineError(
            f"load '{name}': {measure} reaches from {low:.5g} to {high:.5g} m and never {begin:.5g}, where it begins"
        )
    return Place(name, measure, begin, high, edge, size)


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
        self.place, self.speed_rad_s = place, abs(speed_rad_s)
        self.power: Literal[0, 1, 2] = 0
        self.spread_rad = _COARSE_RAD
        counts = Counter(each.phase_rad for each in machine.linkages)
        self._moved = [(count, *measured(machine, place.measure, phase, _NODES)) for phase, count in counts.items()]
        self.steepest = float(np.max(np.abs(self._moved[0][2])))
        self.use(np.linspace(place.begin, place.end, _FEWEST_KNOTS), np.eye(2 * _FEWEST_KNOTS))

    def use(self, knots: FloatArray, root: FloatArray) -> None:
        """Take other knots (k,) and another root (free, free) of the prior's covariance."""
        k = knots.size
        eye = np.eye(k)[:, 0 if self.place.edge else 1 :]
        zero = np.zeros_like(eye)
        self.knots, self.missed = knots, np.zeros(2 * k)
        self.names = tuple(f"{CURVE}.{n}" for n in range(2 * eye.shape[1]))
        self.spread = np.block([[eye, zero], [zero, eye]]) @ root[: 2 * eye.shape[1], : 2 * eye.shape[1]]
        """(2k, free) forces at the knots, the way in first, per coefficient."""

    def expect_bends(self, x: FloatArray) -> None:
        """Let a straight line between knots miss the law as much as its bends there suggest, for coefficients x."""
        bends = [np.abs(np.diff(way, 2)) / _BENT for way in np.split(self.spread @ x, 2)]
        self.missed = np.concatenate([np.pad(each, 1, mode="edge") for each in bends])

    def torque(
        self,
        values: Mapping[str, float],
        state: tuple[FloatArray, FloatArray, FloatArray],
        table: FloatArray,
        slopes: bool = False,
        way: FloatArray | None = None,
        only_forces: bool = False,
        spread_rad: float = _COARSE_RAD,
    ) -> Torque:
        """Torque at states, with that of the law (see `TabulatedTorque.torque`)."""
        found = super().torque(values, state, table, slopes, way, only_forces, spread_rad)
        theta, omega, _ = state
        sign = np.sign(omega) if way is None else way
        forces = self.spread @ np.array([values[name] for name in self.names])
        k, knots, edge = self.knots.size, self.knots, self.place.edge
        size = sign * np.abs(omega / self.speed_rad_s) ** self.power if self.power else sign
        torque, out, variance = found.torque_Nm, dict(found.slopes), found.variance
        rotated = np.zeros((theta.size, self.spread.shape[1])) if slopes else None
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
                width = np.abs(rate) * min(spread_rad, self.spread_rad) + 1e-6
                away = (place - np.where(grows, entry, leave)) / width
                inside = ndtr(away)
                # by the usual force: one that is not found yet would hide an edge
                variance = variance + (lever * self.place.size_N) ** 2 * inside * (1.0 - inside)
                density = lever * np.exp(-0.5 * away**2) / (2.5066282746 * width)
                bumps += np.where(grows, density, 0.0), np.where(grows, 0.0, density)
            at = np.clip(place, knots[0], knots[-1])
            left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, k - 2)
            within = (at - knots[left]) / (knots[left + 1] - knots[left])
            begin = left + np.where(grows, 0, k)
            first, second = lever * inside * (1.0 - within), lever * inside * within
            torque = torque + first * forces[begin] + second * forces[begin + 1]
            variance = variance + (first * self.missed[begin] + second * self.missed[begin + 1]) ** 2
            if rotated is not None:
                rotated += first[:, None] * self.spread[begin] + second[:, None] * self.spread[begin + 1]
        if rotated is not None:
            out |= {name: rotated[:, c] for c, name in enumerate(self.names)}
            if edge:
                out |= {EDGES[0]: -forces[0] * bumps[0], EDGES[1]: -forces[k] * bumps[1]}
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


def learn_curve(plain: Posterior, machine: Machine, place: Place) -> CurvePosterior:
    """Infer a force law from the record of a posterior that has been found without it.

    Args:
        plain: posterior of the record without the law.
        machine: without the load that the law replaces. place: of the law.
    """
    found = likely_curve(plain, machine, place, 0.0)
    assert found is not None
    return found


def likely_curve(plain: Posterior, machine: Machine, place: Place, least: float) -> CurvePosterior | None:
    """Infer a force law as `learn_curve`; None where its first fit explains less than the share `least`."""
    record = plain.measurement.record
    few = record if record.block_s else record.thinned(_FEW)
    laws = [_Law(plain, machine, each, few) for each in _places(machine, place)]
    for law in laws:
        law.begin()
    smallest = min(laws, key=lambda each: each.fit.scale).fit
    best = max(laws, key=lambda each: each.at_scale(smallest))
    speed = np.abs(few.motion.at(few.time_s)[1])
    speed = speed[speed > _WORKING * np.percentile(speed, 95.0)]
    if not record.one_speed and float(np.ptp(np.percentile(speed, (5.0, 95.0)))) > _VARIES * float(np.mean(speed)):
        best.choose_power()
    return None if best.explained < least else best.finish(record)


def _places(machine: Machine, place: Place) -> list[Place]:
    """Return the ranges over which the force may act; one where its begin is declared."""
    if place.size_N:
        return [place]
    low, high = measured_range(machine, place.measure)
    return [replace(place, begin=high - share * (high - low), end=high) for share in _BEGINS]


class _Law:
    """Fits of one force law: knots, size and length of the prior, departures, and the final values."""

    fit: Fit

    def __init__(self, plain: Posterior, machine: Machine, place: Place, record: Record) -> None:
        self.plain, self.place = plain, place
        working = plain.measurement.working_torque_Nm
        speed = abs(record.speed_rad_s * plain.hypothesis.turn)
        inertia = max(plain.measurement.model.mean_inertia, 1e-12)
        known, slots = parameters(machine, WorkingPoint(working, speed, inertia))
        self.model = CurvedTorque(machine, known, slots, place, speed)
        self.size_N = place.size_N or working / max(self.model.steepest, 1e-9)
        edges = tuple(_edge(name, place.begin) for name in EDGES) if place.edge else ()
        self.known, self.record, self.working = (*known, *edges), record, working
        self.knots = np.linspace(place.begin, place.end, _count(machine, place, record))
        self.hyper = _FIRST
        self.off_nominal: Departures = frozenset()
        self._renew(self.record)

    def _renew(self, record: Record) -> None:
        """Build the measurement for the present knots, size and length."""
        root = self._root(self.hyper)
        self.model.use(self.knots, root)
        law = tuple(ModelParameter(name, CURVE, 0.0, 1.0, 1.0, 1.0, 0.5, math.inf, "") for name in self.model.names)
        self.m = Measurement(record, self.model, (*self.known, *law), self.working)

    def begin(self) -> None:
        """Fit the law and the sensors alone: a force that is not found yet would pass for a wrong length."""
        fits = list[tuple[float, int, Fit, Departures, tuple[float, float]]]()
        for start, hypothesis, off_nominal in self._starts():
            self.hyper, self.off_nominal, self.hypothesis = _FIRST, off_nominal, hypothesis
            self._renew(self.record)
            fit = map_fit(self.m, hypothesis, start, off_nominal, iterations=15)
            for _ in range(_SETTLING):
                fit, _ = self._tuned(fit)
                fit = map_fit(self.m, hypothesis, fit.x, off_nominal, iterations=10)
            fits.append((fit.rms, len(fits), fit, off_nominal, self.hyper))
            if fit.explained > _EXPLAINED:
                break
        *_, self.fit, self.off_nominal, self.hyper = min(fits, key=lambda each: each[:2])
        self.hypothesis = self.fit.hypothesis
        self._renew(self.record)

    def _starts(self) -> list[tuple[FloatArray, Hypothesis, Departures]]:
        """Start at the sensors of the machine file, and at those of the plain posterior."""
        m = self.m
        sensors = frozenset(_SENSORS) & set(m.names)
        if m.record.one_speed:  # a delay then looks like a zero
            sensors -= {DELAY}
        x = m.nominal.copy()
        for name in sensors & self.plain.off_nominal:
            x[m.place[name]] = self.plain.value(name)
        return [(m.nominal.copy(), self.plain.configured, sensors), (x, self.plain.hypothesis, sensors)]

    @property
    def explained(self) -> float:
        """Share of the torque's variance that the first fit explains, outliers aside."""
        return 1.0 - (self.fit.rms**2 / max(float(np.var(self.record.torque_Nm)), 1e-300))

    def at_scale(self, like: Fit) -> float:
        """Log evidence with the scale and inflation of another fit, so that laws can be compared."""
        fit = map_fit(self.m, self.hypothesis, self.fit.x, self.off_nominal, inflation=like.inflation, scale=like.scale)
        return QuadraticEvidence(self.m, fit, fit.inflation)(self.off_nominal) + fit.log_likelihood

    def choose_power(self) -> None:
        """Let the force grow with a power of the speed if that is clearly likelier."""
        found = list[tuple[float, Literal[0, 1, 2], Fit]]()
        powers: tuple[Literal[0, 1, 2], ...] = (0, 1, 2)
        for power in powers:
            self.model.power = power
            found.append((0.0, power, map_fit(self.m, self.hypothesis, self.fit.x, self.off_nominal)))
        least = min((each[2] for each in found), key=lambda fit: fit.scale)
        tried = dict[int, float]()
        for _, power, fit in found:
            self.model.power, self.fit = power, fit
            tried[power] = self.at_scale(least)
        best = max(found, key=lambda each: tried[each[1]] - (_OTHER_SPEED_NATS if each[1] else 0.0))
        _, self.model.power, self.fit = best

    def finish(self, record: Record) -> CurvePosterior:
        """Fit all samples, with finer knots where the law bends between them, and choose the departures."""
        some = record if record.block_s else record.thinned(_WORKING_SAMPLES)
        self._renew(some)
        fit = map_fit(self.m, self.hypothesis, self.fit.x, self.off_nominal, iterations=10)
        for _ in range(_REFINED):
            if self._bends(fit) and _count_of(record, self.knots.size):
                fit, _ = self._tuned(self._refined(fit, some))
        # Samples beside an edge enter last: while the zero is off by more than their spread, they hold it there.
        self.model.spread_rad = _FINE_RAD
        for _ in range(_ROUNDS):
            fit, same = self._round(fit)
            if same:
                break
        if some is not record:
            self._renew(record)
            fit = map_fit(self.m, self.hypothesis, fit.x, self.off_nominal, iterations=3)
            fit, _ = self._round(fit)
        value = QuadraticEvidence(self.m, fit, fit.inflation)(self.off_nominal) + fit.log_likelihood
        choice = Choice(self.off_nominal, value, tuple(self.choice.rivals))
        posterior = Posterior(
            self.m.linearised(fit.x, self.off_nominal), self.plain.configured, fit, choice, value, self.plain.others
        )
        return CurvePosterior(posterior, learned(posterior))

    def _round(self, fit: Fit) -> tuple[Fit, bool]:
        """Tune the prior, choose the departures and fit again; return the fit, and whether these are as before."""
        fit, moved = self._tuned(fit)
        self.model.expect_bends(fit.x[len(self.known) :])
        chosen = self._departures(fit)
        fit = fit_with_prior_update(self.m, self.hypothesis, fit.x, chosen, iterations=15, relinearise=True)
        same = chosen == self.off_nominal and not moved
        self.off_nominal = chosen
        return fit, same

    def _bends(self, fit: Fit) -> bool:
        """Return whether a straight line between the knots misses the law by much."""
        forces = self.model.spread @ fit.x[len(self.known) :]
        off = max(float(np.max(np.abs(np.diff(way, 2)))) for way in np.split(forces, 2)) / 8.0
        return off > _MISSED * float(np.max(np.abs(forces)))

    def _refined(self, fit: Fit, record: Record) -> Fit:
        """Fit again with twice as many knots, from the same forces."""
        ways = np.split(self.model.spread @ fit.x[len(self.known) :], 2)
        before, self.knots = self.knots, np.linspace(self.knots[0], self.knots[-1], 2 * self.knots.size - 1)
        self._renew(record)
        free = slice(0 if self.place.edge else 1, None)
        forces = np.concatenate([np.interp(self.knots, before, way)[free] for way in ways])
        x = np.concatenate([fit.x[: len(self.known)], np.linalg.solve(self._root(self.hyper), forces)])
        return map_fit(self.m, self.hypothesis, x, self.off_nominal, iterations=15)

    def _root(self, hyper: tuple[float, float]) -> FloatArray:
        """Root (free, free) of the prior's covariance."""
        size, length = hyper
        knots = self.knots if self.place.edge else self.knots[1:]
        apart = math.sqrt(3.0) / (length * float(np.ptp(self.knots))) * np.abs(knots[:, None] - knots)
        one = size**2 * (1.0 + apart) * np.exp(-apart) + _JITTER**2 * np.eye(knots.size)
        one = one + (_MEAN**2 if self.place.edge else 0.0)
        root = np.asarray(np.linalg.cholesky(one) * self.size_N, np.float64)
        zero = np.zeros_like(root)
        return np.block([[root, zero], [zero, root]])

    def _tuned(self, fit: Fit) -> tuple[Fit, bool]:
        """Choose size and length of the prior by the evidence on the quadratic form of a fit; rewrite it in them.

        Both are continuous: a size between two steps of a grid would pull the sensor's gain to the nearer one.
        """
        begin, here = len(self.known), self._root(self.hyper)
        tried = dict[tuple[float, float], tuple[float, Fit]]()

        def value(hyper: tuple[float, float]) -> float:
            if hyper not in tried:
                turned = _in_root(fit, begin, np.asarray(np.linalg.solve(here, self._root(hyper)), np.float64))
                tried[hyper] = QuadraticEvidence(self.m, turned, fit.inflation)(self.off_nominal), turned
            return tried[hyper][0]

        best = max([self.hyper, *((size, length) for size in _SIZES for length in _LENGTHS)], key=value)
        for factor in _FINER:
            size, length = best
            beside = [
                (size * factor, length),
                (size / factor, length),
                (size, length * factor),
                (size, length / factor),
            ]
            best = max([best, *beside], key=value)
        moved = max(abs(math.log(one / other)) for one, other in zip(best, self.hyper, strict=True)) > _MOVED
        self.hyper = best
        self._renew(self.m.record)
        return tried[best][1], moved

    def _departures(self, fit: Fit) -> Departures:
        """Choose the departures from the file, with the law's coefficients integrated out."""
        n = len(self.known)
        a, g = fit.information / fit.inflation, fit.gradient / fit.inflation
        inner = np.linalg.solve(a[n:, n:] + np.eye(a.shape[0] - n), np.column_stack([a[n:, :n], g[n:] - fit.x[n:]]))
        reduced = replace(
            fit,
            x=fit.x[:n],
            information=(a[:n, :n] - a[:n, n:] @ inner[:, :n]) * fit.inflation,
            gradient=(g[:n] - a[:n, n:] @ inner[:, n]) * fit.inflation,
            covariance=fit.covariance[:n, :n],
        )
        m = Measurement(self.m.record, self.model, self.known, self.m.working_torque_Nm)
        # from the sensors on alone: a gain beside a mass that makes up for it would stay
        starts = {frozenset[str](), *(() if is_one(m, self.off_nominal) else (self.off_nominal,))}
        self.choice = max((choose(m, reduced, fit.inflation, s) for s in starts), key=lambda each: each.log_evidence)
        return self.choice.off_nominal


def learned(posterior: Posterior, fit: Fit | None = None) -> LearnedCurve:
    """Return the force law of a posterior of `learn_curve`, from its own fit or another one of its parameters."""
    model = posterior.measurement.model
    assert isinstance(model, CurvedTorque)
    fit = fit or posterior.fit
    k = [posterior.measurement.place[name] for name in model.names]
    forces = model.spread @ fit.x[k]
    covariance = model.spread @ fit.covariance[np.ix_(k, k)] @ model.spread.T
    place, way = model.place, model.knots.size
    return LearnedCurve(
        place.name, place.measure, model.knots, forces[:way], forces[way:], covariance, model.power, model.speed_rad_s
    )


def curve_and(name: str, posterior: Posterior, fit: Fit) -> FloatArray:
    """Return the covariance (2k,) of the forces with another parameter."""
    m = posterior.measurement
    assert isinstance(m.model, CurvedTorque)
    return np.asarray(m.model.spread @ fit.covariance[[m.place[each] for each in m.model.names], m.place[name]])


def _in_root(fit: Fit, begin: int, turn: FloatArray) -> Fit:
    """Rewrite a fit for other coefficients c' of the law, c = turn c'."""
    whole = np.eye(fit.x.size)
    whole[begin:, begin:] = turn
    x = fit.x.copy()
    x[begin:] = np.linalg.solve(turn, x[begin:])
    return replace(fit, x=x, information=whole.T @ fit.information @ whole, gradient=whole.T @ fit.gradient)


def _edge(name: str, place_m: float) -> ModelParameter:
    return ModelParameter(name, EDGE, place_m, _EDGE_M, _EDGE_M, _EDGE_M, 1e-9, math.inf, "m")


def _count(machine: Machine, place: Place, record: Record) -> int:
    """Number of knots for the record: enough samples beside each."""
    position, _ = measured(machine, place.measure, 0.0, 720)
    inside = float(np.mean(position >= place.begin)) * record.time_s.size
    return int(min(max(inside / (2.0 * _SAMPLES_A_KNOT), _FEWEST_KNOTS), _MOST_KNOTS))


def _count_of(record: Record, knots: int) -> bool:
    """Return whether a record has enough samples for twice as many knots."""
    return record.time_s.size > 4.0 * _SAMPLES_A_KNOT * knots
