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
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache
from typing import Final, Literal

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.curved_torque import EDGES, FEWEST_KNOTS, CurvedTorque, Place, measured, places_of
from textile_twin_core.inference.evidence import (
    EQUIVALENT_NATS,
    OF_BODIES,
    Choice,
    Departures,
    QuadraticEvidence,
    choose,
    is_one,
)
from textile_twin_core.inference.filter_scan import likely_filters
from textile_twin_core.inference.learned_curve import LearnedCurve, learned
from textile_twin_core.inference.map_fit import Fit, fit_with_prior_update, inflations, map_fit, prior_variance, weigh
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    COULOMB,
    CURVE,
    DELAY,
    ECCENTRIC,
    EDGE,
    GAIN,
    HIGH_PASS,
    OFFSET,
    VISCOUS,
    ZERO,
    ModelParameter,
)
from textile_twin_core.inference.posterior import Posterior
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.starts import BLOCKING_HZ
from textile_twin_core.machine import Machine

_MOST_KNOTS, _SAMPLES_A_KNOT = 28, 25
_SIZES: Final = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Standard deviations of the force about its mean, over the usual force, that the evidence compares."""
_LENGTHS: Final = (0.08, 0.15, 0.3, 0.6, 1.2)
"""Lengths of the prior over the range of the knots."""
_FINER: Final = (1.6, 1.3, 1.3, 1.15, 1.15, 1.07, 1.07, 1.03)
"""Factors by which size and length move from the best of the grid on."""
_MOVED: Final = 0.3
"""Change of their logarithm above which the law is fitted again."""
_NO_LOAD: Final = 1e-3
"""Force of a declared load, over that of the working torque, below which it says nothing of a law's size."""
_MEAN, _JITTER = 3.0, 1e-4
"""Standard deviation of the mean force, and smallest independent part, over the usual force."""
_EDGE_M: Final = 5e-4
"""Standard deviation of the place of an edge: cloth is thicker here than there [m]."""
_FINE_RAD: Final = 0.006
"""Shaft angle over which the model smears an edge in the last fits."""
_OTHER_SPEED_NATS: Final = 6.0
"""Log evidence by which a force that grows with the speed must be likelier."""
_WORKING, _VARIES = 0.3, 0.2
"""Share of the fast speeds from which the machine works, and relative spread of these that shows a law of the speed."""
_FEW: Final = 3000
"""Samples of the first fits."""
_FIRST: Final = (0.3, 0.15)
"""Size and length of the first fits."""
_MISSED, _HELPED = 0.002, 0.5
"""Miss of a straight line between two knots, over the peak, above which there are twice as many; share of it to which
these reduce it unless the law steps there."""
_ROUNDS, _SETTLING, _REFINED = 4, 2, 2
_ITERATIONS, _SOME, _LAST = 15, 10, 3
"""Most iterations of a fit, of one near its end, and of those of all samples from that of a part of them on."""
_WHITE: Final = 1.5
"""Inflation of the residual below which a law leaves noise alone."""
_FILTERED: Final = 2
"""Most filters of the torque sensor that are fitted beside a law."""
_EXPLAINED: Final = 0.98
"""Share of the torque that a first fit explains which needs no other start."""
_WORKING_SAMPLES: Final = 3000
"""Samples of all fits but the last."""
SENSORS: Final = frozenset((ZERO, DELAY, GAIN, OFFSET, COULOMB, VISCOUS))
"""Parameters that every law is fitted with."""


@dataclass(frozen=True)
class CurvePosterior:
    """Posterior of a record under a force law: the usual posterior, the law, and whether it leaves noise alone."""

    posterior: Posterior
    curve: LearnedCurve
    is_white: bool


def learn_curve(plain: Posterior, machine: Machine, place: Place) -> CurvePosterior:
    """Infer a force law from the record of a posterior that has been found without it.

    Args:
        plain: posterior of the record without the law.
        machine: without the load that the law replaces. place: of the law.
    """
    found = likely_curve(plain, machine, place, 0.0)
    assert found is not None
    return found


def likely_curve(
    plain: Posterior, machine: Machine, place: Place, least: float, runs: Record | None = None
) -> CurvePosterior | None:
    """Infer a force law as `learn_curve`; None where its first fit explains less than the share `least`.

    Args:
        plain: posterior of the record without the law. machine, place: as in `learn_curve`.
        least: share of the torque's variance.
        runs: samples in which the torque is filtered over time, to try filters of the torque sensor beside a law that
            leaves more than noise; None: none are tried.
    """
    record = plain.measurement.record
    few = record if record.block_s else record.thinned(_FEW)
    laws = [_Law(plain, machine, each, few) for each in places_of(machine, place, whole=not least)]
    speed = np.abs(few.motion.at(few.time_s)[1])
    speed = speed[speed > _WORKING * np.percentile(speed, 95.0)]
    varies = float(np.ptp(np.percentile(speed, (5.0, 95.0)))) > _VARIES * float(np.mean(speed))
    for law in laws:
        law.begin(varies and not record.one_speed)
    smallest = min(laws, key=lambda each: each.fit.scale).fit
    best = max(laws, key=lambda each: each.at_scale(smallest)) if len(laws) > 1 else laws[0]
    power = best.model.power
    found = None if best.explained < least else best.finish(record)
    if runs is None or plain.hypothesis.filters or (found is not None and found.is_white):
        return found
    begun = _Law(plain, machine, best.place, few)
    begun.model.power = power
    begun.begin()
    filters = [(HIGH_PASS, BLOCKING_HZ, 0.0)]  # which leaves a fit without it no resemblance
    if found is not None:
        scanned = begun.m.on(runs).linearised(begun.fit.x, begun.off_nominal)
        likely = likely_filters(scanned, begun.fit)[:_FILTERED]
        filters = [*likely, *(each for each in filters if each[0] not in {name for name, *_ in likely})]
    tried = [begun.filtered(machine, runs, *each) for each in filters]
    for law in sorted(tried, key=lambda each: each.fit.rms):
        if law.explained > least:
            filtered = law.finish(runs)
            return filtered if filtered.is_white else found
    return found


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
        usual = working / max(self.model.steepest, 1e-9)
        self.size_N = place.size_N if place.size_N > _NO_LOAD * usual else usual
        edges = tuple(_edge(name, place.begin) for name in EDGES) if place.edge else ()
        if HIGH_PASS in plain.hypothesis.filters:  # none has settled before a run begins
            known = Measurement(record, self.model, known, working).with_starts().parameters
        self.known, self.record, self.working = (*known, *edges), record, working
        self.knots = np.linspace(place.begin, place.end, _count(machine, place, record))
        self.hyper = _FIRST
        self.off_nominal: Departures = frozenset()
        self.inflation = 0.0
        self._bodies = frozenset(p.name for p in self.known if p.kind in OF_BODIES)
        self._renew(self.record)

    def _renew(self, record: Record) -> None:
        """Build the measurement for the present knots, size and length."""
        root = self._root(self.hyper)
        self.model.use(self.knots, root)
        law = tuple(ModelParameter(name, CURVE, 0.0, 1.0, 1.0, 1.0, 0.5, math.inf, "") for name in self.model.names)
        self.m = Measurement(record, self.model, (*self.known, *law), self.working)

    def begin(self, by_speed: bool = False) -> None:
        """Fit the law and the sensors alone: a force that is not found yet would pass for a wrong length.

        Args:
            by_speed: choose the power of the speed with which the force grows.
        """
        fits = list[tuple[float, int, Fit, Departures, tuple[float, float], Literal[0, 1, 2]]]()
        for start, hypothesis, off_nominal in self._starts():
            self.hyper, self.off_nominal, self.hypothesis = _FIRST, off_nominal, hypothesis
            self.model.power = 0 if by_speed else self.model.power
            self._renew(self.record)
            fit = self._held(start, _ITERATIONS)
            for _ in range(_SETTLING):
                fit, _ = self._tuned(fit)
                fit = self._held(fit.x, _SOME)
            self.fit = fit
            if by_speed:
                self.choose_power()
            fits.append((self.fit.rms, len(fits), self.fit, off_nominal, self.hyper, self.model.power))
            if self.explained > _EXPLAINED and not hypothesis.filters:
                break
        *_, self.fit, self.off_nominal, self.hyper, self.model.power = min(fits, key=lambda each: each[:2])
        self.hypothesis = self.fit.hypothesis
        self._renew(self.record)

    def filtered(self, machine: Machine, runs: Record, name: str, value: float, late_s: float) -> _Law:
        """Return the law begun beside a filter of the torque sensor, from this one's sensors on."""
        plain, m = self.plain, self.plain.measurement
        x = m.nominal.copy()
        if self.explained > _EXPLAINED:
            for each in SENSORS & set(m.names):
                x[m.place[each]] = self.fit.x[self.m.place[each]]
        x[m.place[name]] = value
        x[m.place[DELAY]] += late_s
        hypothesis = replace(self.hypothesis, filters=self.hypothesis.filters | {name})
        fit = replace(plain.fit, x=x, hypothesis=hypothesis)
        choice = replace(plain.choice, off_nominal=SENSORS | {name})
        law = _Law(
            replace(plain, measurement=m.on(runs), fit=fit, choice=choice), machine, self.place, runs.thinned(_FEW)
        )
        law.model.power = self.model.power
        law.begin()
        return law

    def _starts(self) -> list[tuple[FloatArray, Hypothesis, Departures]]:
        """Start at the sensors of the machine file, and at those of the plain posterior; beside a filter at these."""
        m = self.m
        filters = frozenset(n for n in self.plain.hypothesis.filters if not m.nominal[m.place[n]])
        sensors = SENSORS & set(m.names) | filters
        if m.record.one_speed:  # a delay then looks like a zero
            sensors -= {DELAY}
        x = m.nominal.copy()
        for name in sensors & self.plain.off_nominal:
            x[m.place[name]] = self.plain.value(name)
        plain = x, self.plain.hypothesis, sensors
        if not filters:
            return [(m.nominal.copy(), self.plain.configured, sensors), plain]
        right = x.copy()  # without the filter its smearing was the zero's
        right[m.place[ZERO]] = m.nominal[m.place[ZERO]]
        return [(right, self.plain.hypothesis, sensors), *([plain] if self.plain.departure(ZERO) else [])]

    @property
    def explained(self) -> float:
        """Share of the torque's variance that the first fit explains, outliers aside."""
        return 1.0 - (self.fit.rms**2 / max(float(np.var(self.record.torque_Nm)), 1e-300))

    def at_scale(self, like: Fit) -> float:
        """Log evidence with the scale and inflation of another fit, so that laws can be compared."""
        fit = map_fit(self.m, self.hypothesis, self.fit.x, self.off_nominal, inflation=like.inflation, scale=like.scale)
        return self._log_evidence(fit, self.off_nominal)

    def choose_power(self) -> None:
        """Let the force grow with a power of the speed if that is clearly likelier."""
        like, best = self.fit, self.at_scale(self.fit) + _OTHER_SPEED_NATS
        powers: tuple[Literal[1, 2], ...] = (1, 2)
        for power in powers:
            before, self.model.power = self.model.power, power
            fit = map_fit(self.m, self.hypothesis, like.x, self.off_nominal, inflation=like.inflation, scale=like.scale)
            value = self._log_evidence(fit, self.off_nominal)
            if value > best:
                best, self.fit = value, fit
            else:
                self.model.power = before

    def finish(self, record: Record) -> CurvePosterior:
        """Fit all samples, with finer knots where the law bends between them, and choose the departures."""
        some = record if record.block_s else record.thinned(_WORKING_SAMPLES)
        self._renew(some)
        fit = self._held(self.fit.x, _SOME)
        before = math.inf
        for _ in range(_REFINED):
            missed, enough = self._missed(fit), record.time_s.size > 4.0 * _SAMPLES_A_KNOT * self.knots.size
            if _MISSED < missed < _HELPED * before and enough:
                before, (fit, _) = missed, self._tuned(self._refined(fit, some))
        # Samples beside an edge enter last: while the zero is off by more than their spread, they hold it there.
        self.model.spread_rad = _FINE_RAD
        self.model.expect_bends(fit.x[len(self.known) :])  # or departures would explain what the knots miss
        fit = self._held(fit.x, _SOME)
        for _ in range(_ROUNDS):
            fit, same = self._round(fit)
            if same:
                break
        usual = fit
        if some is not record:
            self._renew(record)
            # departures are chosen about a fit in which those of the sensors are found
            wide = self.off_nominal | (SENSORS | set(ECCENTRIC)) & set(self.m.names)
            usual = map_fit(self.m, self.hypothesis, fit.x, wide, iterations=_ITERATIONS)
            self.inflation = self._widest(usual)
            fit = map_fit(self.m, self.hypothesis, usual.x, wide, iterations=_LAST, inflation=self.inflation)
            fit = self._freed(fit, _SOME)
        value = self._log_evidence(fit, self.off_nominal)
        choice = Choice(self.off_nominal, value, self.rivals)
        posterior = Posterior(
            self.m.linearised(fit.x, self.off_nominal), self.plain.configured, fit, choice, value, self.plain.others
        )
        return CurvePosterior(posterior, learned(posterior), usual.inflation < _WHITE)

    def _held(self, x: FloatArray, iterations: int) -> Fit:
        """Fit with the edges held, which a wrong zero would carry along."""
        free = set(self.m.names).difference(EDGES)
        return map_fit(self.m, self.hypothesis, x, self.off_nominal, free=free, iterations=iterations)

    def _round(self, fit: Fit) -> tuple[Fit, bool]:
        """Tune the prior, choose the departures and fit again; return the fit, and whether these are as before."""
        fit, moved = self._tuned(fit)
        before = self.off_nominal
        return self._freed(fit, _ITERATIONS), before == self.off_nominal and not moved

    def _freed(self, fit: Fit, iterations: int) -> Fit:
        """Choose the departures from the file and fit again, without bodies unless they are clearly likelier.

        The quadratic form of a fit is not enough: gain times law is not linear, nor is an edge that an angle moves.
        """
        self.model.expect_bends(fit.x[len(self.known) :])
        plain, every = (self._departures(fit, nominal) for nominal in (OF_BODIES, ()))
        fits = list[tuple[float, Fit, Departures]]()
        for off_nominal in dict.fromkeys([plain.off_nominal, every.off_nominal]):
            x = fit.x.copy()
            moved = [self.m.place[p.name] for p in self.known if p.kind in OF_BODIES and p.name not in off_nominal]
            x[moved] = self.m.nominal[moved]
            found = fit_with_prior_update(
                self.m,
                self.hypothesis,
                x,
                off_nominal,
                iterations=iterations,
                inflation=fit.inflation,
                scale=fit.scale,
                relinearise=True,
            )
            margin = 0.0 if self._bodies.isdisjoint(off_nominal) else EQUIVALENT_NATS
            fits.append((self._log_evidence(found, off_nominal) - margin, found, off_nominal))
        _, found, self.off_nominal = max(fits, key=lambda each: each[0])
        self.rivals = (plain if self._bodies.isdisjoint(self.off_nominal) else every).rivals
        return map_fit(
            self.m,
            self.hypothesis,
            found.x,
            self.off_nominal,
            iterations=_LAST,
            inflation=self.inflation,
            relinearise=True,
        )

    def _widest(self, fit: Fit) -> float:
        """Largest inflation of the scores: the law takes in the errors of those parameters that look like a force."""
        near = self.m.linearised(fit.x, self.off_nominal)
        variance = prior_variance(self.m, self.off_nominal, fit.x)
        return float(np.max(inflations(self.m, weigh(near, self.hypothesis, fit.x, variance, 1.0, 0.0))))

    def _log_evidence(self, fit: Fit, off_nominal: Departures) -> float:
        return QuadraticEvidence(self.m, fit, fit.inflation)(off_nominal) + fit.log_likelihood

    def _missed(self, fit: Fit) -> float:
        """Return by how much a straight line between the knots misses the law at most, over its peak."""
        forces = self.model.spread @ fit.x[len(self.known) :]
        off = max(float(np.max(np.abs(np.diff(way, 2)))) for way in np.split(forces, 2)) / 8.0
        return off / max(float(np.max(np.abs(forces))), 1e-300)

    def _refined(self, fit: Fit, record: Record) -> Fit:
        """Fit again with twice as many knots, from the same forces."""
        ways = np.split(self.model.spread @ fit.x[len(self.known) :], 2)
        before, self.knots = self.knots, np.linspace(self.knots[0], self.knots[-1], 2 * self.knots.size - 1)
        self._renew(record)
        free = slice(0 if self.place.edge else 1, None)
        forces = np.concatenate([np.interp(self.knots, before, way)[free] for way in ways])
        x = np.concatenate([fit.x[: len(self.known)], np.linalg.solve(self._root(self.hyper), forces)])
        return self._held(x, _ITERATIONS)

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
        here = self._root(self.hyper)
        precision, side = self._of_forces(fit, here)

        @cache
        def value(hyper: tuple[float, float]) -> float:
            root = self._root(hyper)
            inner = root.T @ precision @ root
            lower = np.linalg.cholesky(inner + np.eye(inner.shape[0]))
            solved = np.linalg.solve(lower, root.T @ side)
            return 0.5 * float(solved @ solved) - float(np.sum(np.log(np.diag(lower))))

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
        turn = np.asarray(np.linalg.solve(here, self._root(best)), np.float64)
        return _in_root(fit, len(self.known), turn), moved

    def _of_forces(self, fit: Fit, root: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Precision (free, free) of the forces at the knots, times their mean too, with all else integrated out."""
        n, a = len(self.known), fit.information / fit.inflation
        side = fit.gradient / fit.inflation + a @ fit.x
        variance = prior_variance(self.m, self.off_nominal, fit.x)[:n]
        nominal = self.m.nominal[:n]
        inner = np.linalg.solve(
            a[:n, :n] + np.diag(1.0 / variance), np.column_stack([a[:n, n:], side[:n] + nominal / variance])
        )
        precision = a[n:, n:] - a[n:, :n] @ inner[:, :-1]
        back = np.linalg.inv(root)
        return back.T @ precision @ back, back.T @ (side[n:] - a[n:, :n] @ inner[:, -1])

    def _departures(self, fit: Fit, nominal: Collection[str]) -> Choice:
        """Choose the departures from the file but those of some kinds, with the law's coefficients integrated out."""
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
        known = tuple(replace(p, probability=0.0) if p.kind in nominal else p for p in self.known)
        m = Measurement(self.m.record, self.model, known, self.m.working_torque_Nm)
        possible = self.off_nominal & {p.name for p in known if p.may_depart}
        # from the sensors on alone: a gain beside a mass that makes up for it would stay
        starts = {frozenset[str](), *(() if is_one(m, possible) else (possible,))}
        return max((choose(m, reduced, fit.inflation, s) for s in starts), key=lambda each: each.log_evidence)


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
    return int(min(max(inside / (2.0 * _SAMPLES_A_KNOT), FEWEST_KNOTS), _MOST_KNOTS))
