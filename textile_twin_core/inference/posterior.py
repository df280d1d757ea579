"""Posterior of a record: discrete settings, values with standard deviations, and departures from the file.

Sets of departures compete by their evidence (Laplace's approximation, see `evidence`) about robust fits (`map_fit`).
All values are in the unit of their `ModelParameter`. `comparison/assessment.py` calls `infer` for whole recordings,
never live; its time goes into fits of at most `MOST_SAMPLES` samples, or of block averages.
tests/comparison/test_verdict.py compares with mistakes of known size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.evidence import (
    OF_BODIES,
    Choice,
    Departures,
    QuadraticEvidence,
    choose,
    is_one,
    undeclared_filters,
)
from textile_twin_core.inference.filter_scan import HOPEFUL, likely_filters
from textile_twin_core.inference.map_fit import Fit, fit_with_prior_update, map_fit
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    COULOMB,
    DELAY,
    DRIFT,
    FILTERS,
    GAIN,
    HIGH_PASS,
    OFFSET,
    ROTOR,
    SENSORS,
    ZERO,
    ModelParameter,
    gain_factor,
    gain_value,
)
from textile_twin_core.inference.priors import WorkingPoint, parameters, uncertain_ripple
from textile_twin_core.inference.record import MOST_SAMPLES, Record
from textile_twin_core.inference.starts import GAINS, LOG_ODDS, RATIOS, TURN, hypotheses
from textile_twin_core.inference.torque_model import TabulatedTorque
from textile_twin_core.machine import Machine

_ROUNDS = 5
"""Rounds of refits in which the set of departures may change."""
IMPLAUSIBLE_NATS = 30.0
"""Prior cost of the departures above which another machine is likelier."""
_MOST_FILTERS, _FITTED_FILTERS = 2, 2
"""Most filters in a chain, and number of candidates that are fitted for each."""
_BLOCKED_MEAN = 0.8
"""Share of the torque's variance below which a sensor that blocks the mean is a hypothesis."""
_CLEARLY = 0.8
"""Unexplained share, over that without a high pass, below which its departures are searched."""
_HYPOTHESES, _AS_GOOD = 3, 0.01
"""Number of discrete hypotheses to search while all are implausible; share of variance that a later one may lack."""
_BESIDE_ZERO = (GAIN, DRIFT, COULOMB, OFFSET)
"""Departures that stay when zero and delay are exchanged."""


@dataclass(frozen=True)
class Posterior:
    """Posterior of a machine and its sensors, given a record.

    Attributes:
        measurement: record, model and parameters, linear about the fit.
        configured: discrete settings and sensor of the machine file.
        fit: values and their covariance; the prior is wide for a departure and the tolerance for any other parameter.
        choice: the parameters that depart, and sets of departures that explain the record equally well.
        log_evidence: of the choice at its own fit.
        others: other discrete hypotheses, likeliest first.
    """

    measurement: Measurement
    configured: Hypothesis
    fit: Fit
    choice: Choice
    log_evidence: float
    others: tuple[Fit, ...]

    @property
    def off_nominal(self) -> Departures:
        """Names of the parameters that depart from the file."""
        return self.choice.off_nominal

    @property
    def plain(self) -> Departures:
        """Departures but those of bodies and links, which could imitate a filter of the torque."""
        return frozenset(name for name in self.off_nominal if self.parameter(name).kind not in OF_BODIES)

    @property
    def hypothesis(self) -> Hypothesis:
        """The likeliest discrete settings."""
        return self.fit.hypothesis

    def parameter(self, name: str) -> ModelParameter:
        """Return a parameter by name."""
        return self.measurement.parameters[self.measurement.place[name]]

    def value(self, name: str) -> float:
        """Value of a parameter. For a sensor it is the departure from `hypothesis`; for the gain see `gain_factor`."""
        return float(self.fit.x[self.measurement.place[name]])

    def departure(self, name: str) -> float:
        """Value less nominal value."""
        return self.value(name) - self.parameter(name).nominal

    def sigma(self, name: str) -> float:
        """Standard deviation of a value, given the tolerances of all others."""
        k = self.measurement.place[name]
        return math.sqrt(float(self.fit.covariance[k, k]))

    def covariance(self, names: Collection[str]) -> FloatArray:
        """Covariance (n, n) of some values."""
        k = [self.measurement.place[name] for name in names]
        return self.fit.covariance[np.ix_(k, k)]

    def equivalents(self, name: str) -> tuple[str, ...]:
        """Parameters whose departure, in place of this one, explains the record equally well, likeliest first."""
        others = self.off_nominal - {name}
        swapped = [
            s - others for _, s in self.choice.rivals if others <= s and name not in s and len(s) == len(others) + 1
        ]
        return tuple(dict.fromkeys(next(iter(each)) for each in swapped))

    @property
    def explained(self) -> float:
        """Share of the torque's variance that the values explain, sample by sample."""
        residual, good = self.measurement.residual(self.hypothesis, self.fit.x)
        torque = self.measurement.record.torque_Nm[good]
        return 1.0 - float(np.mean(residual[good] ** 2)) / max(float(np.var(torque)), 1e-300) if torque.size else 0.0

    @property
    def is_motion_uncertain(self) -> bool:
        """True if the motion's uncertainty makes more torque than the values leave unexplained."""
        return self.fit.rms < abs(self.hypothesis.gain) * self.measurement.uncertain_Nm

    @property
    def prior_cost(self) -> float:
        """Prior cost of the departures in nats: large if this machine explains the torque only by many mistakes."""
        cost = 0.0
        for name in sorted(self.off_nominal):
            p = self.parameter(name)
            cost += min(0.5 * (self.departure(name) / p.spread(self.value(name))) ** 2, 6.0) - p.log_odds
        return cost


def infer(
    record: Record,
    machine: Machine,
    configured: Hypothesis,
    ratios: tuple[float, ...] = RATIOS,
    dense: Record | None = None,
    instead: Callable[[Posterior, Fit], Posterior | Fit | None] | None = None,
) -> Posterior | None:
    """Infer sensors, machine and departures from the file from one record.

    Args:
        record: torque samples of the turning shaft and its motion.
        machine: the machine of the file.
        configured: sensor settings of the file.
        ratios: gear ratios to try, beside the configured one; the default has those of small whole numbers.
        dense: samples of the same recording in runs short enough to filter the torque over time; None: the record.
        instead: posterior of another model that makes the search needless, or a fit to search from first, or None. It
            is asked with the fit of all parameters under the likeliest hypothesis, which no set of its departures
            surpasses, and with that of the sensors.

    Returns:
        The posterior, or None when no hypothesis gives a fit.
    """
    measurement = measurement_of(record, machine, configured)
    dense = dense or measurement.record
    moved, plain = _with_motion(measurement, hypotheses(measurement, configured, ratios))
    if not plain:
        return None
    unsearched, fits = _unsearched(moved, configured, plain), plain
    if instead is not None and record.predicted is None:
        other = instead(unsearched, plain[0])
        if isinstance(other, Posterior):
            return other
        fits = fits if other is None else [other, *fits]
    # means over whole turns show no filter; beside an elastic shaft none is searched
    filtered = measurement.model.depends_on_angle() and record.predicted is None
    chain: list[Posterior] | None = None
    # a motion that is uncertain may itself read as a filter
    if filtered and not unsearched.is_motion_uncertain and _is_surprising(_likeliest(unsearched)):
        chain = _chains(moved.on(dense).with_starts(), configured, plain)
        if chain and chain[0].log_evidence > _bound(unsearched, chain[0]):
            return chain[0]
    found = _searched(moved, configured, fits, unsearched.fit if fits is plain else None)
    if not filtered or found.is_motion_uncertain:
        return found  # the uncertain motion explains more torque than is left for a filter
    if _is_surprising(found):
        if chain is None:
            chain = _chains(moved.on(dense).with_starts(), configured, plain)
        for other in chain:
            found = _likelier(found, other)
    if _is_surprising(found):
        # without the mean of the torque no hypothesis of the others need be near
        blocked = replace(configured, filters=configured.filters | {HIGH_PASS})
        dense_measurement = measurement.on(dense).with_starts()
        dense_measurement, fits = _with_motion(dense_measurement, hypotheses(dense_measurement, blocked, ratios))
        # like with like: both without departures of bodies
        if fits and 1.0 - fits[0].explained < _CLEARLY * (1.0 - plain[0].explained):
            found = _likelier(found, _searched(dense_measurement, blocked, fits))
    return _with_filters(found, found.measurement.on(dense))


def _likeliest(unsearched: Posterior) -> Posterior:
    """Return the likeliest departures about the fit of all parameters, before any is fitted by itself."""
    fit = unsearched.fit
    choice = choose(unsearched.measurement, fit, fit.inflation)
    return replace(unsearched, choice=choice, log_evidence=choice.log_evidence)


def _chains(measurement: Measurement, configured: Hypothesis, fits: list[Fit]) -> list[Posterior]:
    """Return the posterior under the configured direction, ratio and sign with the filters that it needs, if any.

    Of all discrete hypotheses without a filter another one may fit best.
    """
    for fit in fits:
        h = fit.hypothesis
        if (h.turn, h.gain) == (configured.turn, configured.gain):
            fit = replace(fit, x=np.append(fit.x, np.zeros(len(measurement.names) - fit.x.size)))
            sensors = frozenset(p.name for p in measurement.parameters if p.name in SENSORS or p.kind == "force")
            begun = Posterior(measurement, configured, fit, Choice(sensors, -math.inf, ()), -math.inf, tuple(fits))
            found = _with_filters(begun, measurement)
            return [] if found is begun else [found]
    return []


def _bound(unsearched: Posterior, like: Posterior) -> float:
    """Log likelihood, at the scale of another posterior, of all parameters: no set of departures surpasses it."""
    m = unsearched.measurement.on(like.measurement.record)
    h, fit = unsearched.hypothesis, like.fit
    return map_fit(m, h, unsearched.fit.x, m.names, inflation=fit.inflation, scale=fit.scale).log_likelihood


def _unsearched(measurement: Measurement, configured: Hypothesis, fits: list[Fit]) -> Posterior:
    """Fit all parameters with the priors of departures under the likeliest hypothesis."""
    fit = map_fit(measurement, fits[0].hypothesis, fits[0].x, measurement.names)
    choice = Choice(frozenset(measurement.names), fit.log_likelihood, ())
    return Posterior(measurement, configured, fit, choice, fit.log_likelihood, tuple(fits[1:]))


def _is_surprising(found: Posterior) -> bool:
    """Return true where a filter may have been read as an offset, another direction, ratio, sign or unit, or a body."""
    differs = (found.hypothesis.turn, found.hypothesis.gain) != (found.configured.turn, found.configured.gain)
    few = found.prior_cost <= IMPLAUSIBLE_NATS and found.explained >= _BLOCKED_MEAN
    return differs or OFFSET in found.off_nominal or not few


def _searched(measurement: Measurement, configured: Hypothesis, fits: list[Fit], full: Fit | None = None) -> Posterior:
    """Search the departures under the likeliest discrete hypotheses; `full`: fit of all parameters under the first."""
    first: Posterior | None = None
    for fit in _distinct(fits)[:_HYPOTHESES]:
        others = [fit, *(other for other in fits if other is not fit)]
        found = _Search(measurement, configured, others, full=full if fit is fits[0] else None).run()
        if found.hypothesis.unit != 1.0:
            found = _likelier_without_unit(found, others)
        # implausible values may come from wrong discrete settings
        if found.prior_cost <= IMPLAUSIBLE_NATS and (first is None or found.explained > first.explained - _AS_GOOD):
            return found
        first = first or found
    assert first is not None
    return first


def _with_filters(found: Posterior, measurement: Measurement) -> Posterior:
    """Return the posterior with those filters of the torque sensor that are likelier than none.

    They are searched in the residual without departures of bodies and links, which could imitate a filter.
    """
    for _ in range(_MOST_FILTERS):
        best, log_evidence = None, -math.inf
        plain, fit = found.plain, found.fit
        if plain != found.off_nominal:
            x = fit.x.copy()
            moved = [measurement.place[name] for name in found.off_nominal - plain]
            x[moved] = measurement.nominal[moved]
            fit = fit_with_prior_update(measurement, found.hypothesis, x, plain, relinearise=True)
        # departures of bodies can be the rest of a filter
        hopeful, most = (HOPEFUL, _FITTED_FILTERS) if plain == found.off_nominal else (math.inf, len(FILTERS))
        likely = likely_filters(measurement.linearised(fit.x, plain), fit, hopeful)
        start = fit.x
        for name, value, late in likely[:most]:
            x = start.copy()
            x[measurement.place[name]] = value
            x[measurement.place[DELAY]] += late
            hypothesis = replace(found.hypothesis, filters=found.hypothesis.filters | {name})
            off_nominal = plain | {name, DELAY}
            fit = fit_with_prior_update(measurement, hypothesis, x, off_nominal, relinearise=True)
            if best is not None:
                fit = fit_with_prior_update(
                    measurement,
                    hypothesis,
                    fit.x,
                    off_nominal,
                    inflation=best.inflation,
                    scale=best.scale,
                    relinearise=True,
                )
            value = QuadraticEvidence(measurement, fit, fit.inflation)(off_nominal) + fit.log_likelihood
            if best is None or value > log_evidence:
                best, log_evidence = fit, value
        if best is None or log_evidence <= _log_evidence(measurement, found, best):
            break
        other = _Search(measurement, found.configured, [best]).run()
        likelier = _likelier(found, other)
        if likelier is found:
            break
        found = likelier
    return found


def _log_evidence(measurement: Measurement, found: Posterior, like: Fit) -> float:
    """Log evidence of a posterior on other samples, with the scale and inflation of another fit."""
    scale, inflation = like.scale, like.inflation
    x = measurement.nominal.copy()
    for name in found.measurement.names:  # the uncertain motion may have other orders
        if name in measurement.place:
            x[measurement.place[name]] = found.value(name)
    same = map_fit(
        measurement,
        found.hypothesis,
        x,
        found.off_nominal,
        iterations=0,
        inflation=inflation,
        scale=scale,
        relinearise=True,
    )
    return QuadraticEvidence(measurement, same, inflation)(found.off_nominal) + same.log_likelihood


def _likelier(one: Posterior, other: Posterior) -> Posterior:
    """Return the likelier of two posteriors, compared on the other's samples with its scale and inflation."""
    return one if _log_evidence(other.measurement, one, other.fit) >= other.log_evidence else other


def _likelier_without_unit(found: Posterior, fits: list[Fit]) -> Posterior:
    """Return the posterior in the configured unit instead of another one, if that is likelier.

    A wrong mass of the file, say, can scale the torque as another unit does; the ranking of hypotheses frees no mass.
    """
    m, h = found.measurement, found.hypothesis
    gain = math.copysign(found.configured.gain, h.gain)
    k = m.place[GAIN]
    factor = h.gain / gain * gain_factor(float(found.fit.x[k]))
    if not GAINS[0] <= factor <= GAINS[1]:
        return found
    x = fits[0].x.copy()
    x[k] = gain_value(factor)
    start = replace(fits[0], x=x, hypothesis=replace(h, gain=gain, unit=1.0))
    other = _Search(m, found.configured, [start, *fits[1:]], like=found.fit).run()
    return other if other.log_evidence > found.log_evidence + LOG_ODDS["unit"] else found


def _distinct(fits: list[Fit]) -> list[Fit]:
    """Likeliest fit of each direction, ratio and gain."""
    first: dict[tuple[float, float], Fit] = {}
    for fit in fits:
        first.setdefault((fit.hypothesis.turn, fit.hypothesis.gain), fit)
    return list(first.values())


def measurement_of(record: Record, machine: Machine, configured: Hypothesis) -> Measurement:
    """Return the measurement; priors scale with the working torque, which a model with unscaled priors predicts."""
    speed = abs(record.speed_rad_s * configured.turn)
    unscaled, held = parameters(machine, WorkingPoint(1.0, speed, 1.0))
    model = TabulatedTorque(machine, unscaled, held)
    measurement = Measurement(record.thinned(MOST_SAMPLES) if not record.block_s else record, model, unscaled, 1.0)
    rigid = measurement.on(replace(measurement.record, predicted=None))
    seen = rigid.expected(configured, measurement.nominal)
    torque = np.abs(seen.torque_Nm[seen.good] - configured.offset_Nm) / abs(configured.gain)
    scale = max(float(np.percentile(torque, 95.0)) if torque.size else 0.0, 1e-9)
    inertia = max(model.mean_inertia + sum(b.inertia_kgm2 for b in machine.bodies if b.is_flywheel), 1e-12)
    scaled, _ = parameters(machine, WorkingPoint(scale, speed, inertia))
    if not model.depends_on_angle():
        scaled = tuple(p for p in scaled if p.kind != "eccentricity")
    if record.predicted is not None:
        # the observer of an elastic shaft hardly follows a run-out of the encoder, so its torque shows none
        known = (*(p for p in scaled if p.kind != "eccentricity"), *record.predicted.parameters)
        return Measurement(measurement.record, model, known, scale, record.predicted.uncertain_Nm)
    return Measurement(measurement.record, model, scaled, scale)


def _with_motion(measurement: Measurement, fits: list[Fit]) -> tuple[Measurement, list[Fit]]:
    """Return the measurement with what is uncertain of the motion, and the fits with these parameters at zero.

    Its torque grows with the inertia of the likeliest fit: a flywheel that the file lacks may be most of it.
    """
    model, record, scale = measurement.model, measurement.record, measurement.working_torque_Nm
    if not fits or not model.depends_on_angle() or record.predicted is not None:
        return measurement, fits
    speed = abs(record.speed_rad_s * fits[0].hypothesis.turn)
    inertia = model.mean_inertia + float(fits[0].x[measurement.place[ROTOR]])
    ripple, felt = uncertain_ripple(record.ripple, model.torque_orders(speed), inertia, speed, scale)
    wider = Measurement(record, model, (*measurement.parameters, *ripple), scale, felt)
    return wider, [replace(fit, x=np.append(fit.x, np.zeros(len(ripple)))) for fit in fits]


class _Search:
    """Search for departures under the likeliest discrete hypothesis; every winner is fitted again.

    `like`: another fit whose scale and inflation are used, so that the evidence of both can be compared. `full`: the
    fit of all parameters, if it is known.
    """

    def __init__(
        self,
        measurement: Measurement,
        configured: Hypothesis,
        fits: list[Fit],
        like: Fit | None = None,
        full: Fit | None = None,
    ) -> None:
        self.measurement, self.configured, self.fits, self.top = measurement, configured, fits, fits[0]
        self.speed = self.top.hypothesis.turn * measurement.record.speed_rad_s
        inflation, scale = (0.0, 0.0) if like is None else (like.inflation, like.scale)
        self.full = full or map_fit(
            measurement, self.top.hypothesis, self.top.x, measurement.names, inflation=inflation, scale=scale
        )

    def run(self) -> Posterior:
        """Return the posterior."""
        m, full = self.measurement, self.full
        first = choose(m, full, full.inflation).off_nominal
        best = self._refit(full.x, first)
        tried = {first}
        always = undeclared_filters(m, full)
        if m.record.one_speed:
            for off_nominal, x in self._ends(first):
                best = max(best, self._refit(x, off_nominal), key=lambda each: each[0])
                tried.add(off_nominal)
        for _ in range(_ROUNDS):
            value, fit, off_nominal = best
            choice = choose(m, fit, full.inflation, off_nominal)
            queue = [(choice.off_nominal, fit.x), *((s, fit.x) for _, s in choice.rivals[:2])]
            for name in sorted(off_nominal - always):
                queue += self._without(fit, off_nominal, name)
            queue = [(s, x) for s, x in queue if s not in tried and not is_one(m, s)]
            tried |= {s for s, _ in queue}
            if not queue:
                break
            new = max((self._refit(x, s) for s, x in queue), key=lambda each: each[0])
            if new[0] <= value:
                break
            best = new
        value, fit, off_nominal = best
        near = choose(m, fit, full.inflation, off_nominal)
        rivals = tuple(each for each in near.rivals if each[1] != off_nominal)
        if near.off_nominal != off_nominal:
            rivals = ((near.log_evidence, near.off_nominal), *rivals)
        choice = Choice(off_nominal, value, rivals)
        return Posterior(m.linearised(fit.x, off_nominal), self.configured, fit, choice, value, tuple(self.fits[1:]))

    def _refit(self, x: FloatArray, off_nominal: Departures) -> tuple[float, Fit, Departures]:
        full = self.full
        m, hypothesis = self.measurement, self.top.hypothesis
        fit = fit_with_prior_update(
            m, hypothesis, x, off_nominal, inflation=full.inflation, scale=full.scale, relinearise=True
        )
        value = QuadraticEvidence(m, fit, full.inflation)(off_nominal) + fit.log_likelihood
        return value, fit, off_nominal

    def _ends(self, first: Departures) -> list[tuple[Departures, FloatArray]]:
        """Return two starts, delay alone and zero alone: at one speed only zero + speed * delay is identifiable."""
        m = self.measurement
        zero, delay = float(self.top.x[m.place[ZERO]]), float(self.top.x[m.place[DELAY]])
        ends = (DELAY, delay + zero / self.speed), (ZERO, math.remainder(zero + delay * self.speed, TURN))
        filters, out = undeclared_filters(m, self.full) - {DELAY}, []
        for name, value in ends:
            x = m.nominal.copy()
            x[m.place[name]] = value
            for each in (GAIN, *filters):
                x[m.place[each]] = self.top.x[m.place[each]]
            out.append((frozenset((first & set(_BESIDE_ZERO)) | filters | {name}), x))
        return out

    def _without(self, fit: Fit, off_nominal: Departures, name: str) -> list[tuple[Departures, FloatArray]]:
        """Return starts without the departure `name`; for zero or delay also with the other in its place."""
        m = self.measurement
        k = m.place[name]
        x = fit.x.copy()
        away = float(x[k] - m.nominal[k])
        x[k] = m.nominal[k]
        out = [(off_nominal - {name}, x)]
        if name in (ZERO, DELAY):
            other, value = (DELAY, away / self.speed) if name == ZERO else (ZERO, away * self.speed)
            moved = x.copy()
            moved[m.place[other]] += value
            out.append((off_nominal - {name} | {other}, moved))
        return out
