"""Inference from a record: discrete settings, filters of the torque sensor, and departures from the file.

Sets of departures compete by their evidence (Laplace's approximation, see `evidence`) about robust fits (`map_fit`).
`comparison/assessment.py` calls `infer` for whole recordings, never live; its time goes into fits of at most
`MOST_SAMPLES` samples, or of block averages. tests/comparison/test_verdict.py compares with mistakes of known size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from textile_twin_core.inference.departure_search import DepartureSearch, searched
from textile_twin_core.inference.evidence import (
    EQUIVALENT_NATS,
    Choice,
    choose,
    undeclared_filters,
)
from textile_twin_core.inference.filter_scan import HOPEFUL, likely_filters
from textile_twin_core.inference.map_fit import Fit, fit_with_prior_update, map_fit
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    DELAY,
    FILTERS,
    HIGH_PASS,
    OFFSET,
    ROTOR,
    SENSORS,
    ZERO,
)
from textile_twin_core.inference.posterior import (
    IMPLAUSIBLE_NATS,
    Posterior,
    evidence_of,
    evidence_on,
    fit_like,
    likelier,
)
from textile_twin_core.inference.priors import WorkingPoint, parameters, uncertain_ripple
from textile_twin_core.inference.record import MOST_SAMPLES, Record
from textile_twin_core.inference.starts import GROUP_DELAY, RATIOS, hypotheses
from textile_twin_core.inference.torque_model import TabulatedTorque
from textile_twin_core.machine import Machine

_MOST_FILTERS, _FITTED_FILTERS = 2, 2
"""Most filters in a chain, and number of candidates that are fitted for each."""
_BLOCKED_MEAN = 0.8
"""Share of the torque's variance below which a sensor that blocks the mean is a hypothesis."""
_CLEARLY = 0.8
"""Unexplained share, over that without a high pass, below which its departures are searched."""


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
    found = searched(moved, configured, fits, unsearched.fit if fits is plain else None)
    if not filtered or found.is_motion_uncertain:
        return found  # the uncertain motion explains more torque than is left for a filter
    if _is_surprising(found):
        if chain is None:
            chain = _chains(moved.on(dense).with_starts(), configured, plain)
        for other in chain:
            found = likelier(found, other)
    if _is_surprising(found):
        # without the mean of the torque no hypothesis of the others need be near
        blocked = replace(configured, filters=configured.filters | {HIGH_PASS})
        dense_measurement = measurement.on(dense).with_starts()
        dense_measurement, fits = _with_motion(dense_measurement, hypotheses(dense_measurement, blocked, ratios))
        # like with like: both without departures of bodies
        if fits and 1.0 - fits[0].explained < _CLEARLY * (1.0 - plain[0].explained):
            found = likelier(found, searched(dense_measurement, blocked, fits))
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
            # without the filter gain, friction and forces are far off
            x, k = measurement.nominal.copy(), [measurement.place[name] for name in (ZERO, DELAY)]
            x[k] = fit.x[k]
            fit = replace(fit, x=x)
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
        hopeful, most = math.inf, len(FILTERS)
        if plain == found.off_nominal:
            hopeful, most = math.exp(-2.0 * EQUIVALENT_NATS * fit.inflation / max(fit.count, 1)), _FITTED_FILTERS
        likely = likely_filters(measurement.linearised(fit.x, plain), fit, hopeful)
        starts = [(name, value, late, fit.x) for name, value, late in likely[:most]]
        for name, value, late, start in starts:
            x = start.copy()
            x[[measurement.place[each] for each in GROUP_DELAY if name in GROUP_DELAY]] = 0.0
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
            tried = evidence_of(measurement, fit, off_nominal)
            if best is not None and tried <= log_evidence:
                continue
            first = likely[0][0]
            if name != first and {name, first} == set(GROUP_DELAY):  # the other order, about the values of this one
                same = fit.x[measurement.place[name]] * GROUP_DELAY[name] / GROUP_DELAY[first]
                starts.append((first, same, 0.0, fit.x))
            best, log_evidence = fit, tried
        if best is None:
            break
        without = fit_like(measurement, found, best)
        less = evidence_of(measurement, without, found.off_nominal) - log_evidence
        # errors of the estimated motion, as of a shaft that rocks, may look like a filter of little effect
        clear = plain != found.off_nominal or best.rms**2 < HOPEFUL * without.rms**2
        if less >= 0.0 or not clear:
            return found.beside(plain | undeclared_filters(measurement, best), max(less, 0.0))
        other = DepartureSearch(measurement, found.configured, [best]).run()
        less = other.log_evidence - evidence_on(other.measurement, found, other.fit)
        if less <= 0.0:
            return found.beside(other.off_nominal, -less)
        found = other.beside(found.off_nominal, less)
    return found


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
