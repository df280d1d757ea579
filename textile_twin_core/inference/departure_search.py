"""Search for departures from the machine file under the likeliest discrete hypotheses."""

from __future__ import annotations

import math
from dataclasses import replace

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.evidence import (
    Choice,
    Departures,
    choose,
    is_one,
    undeclared_filters,
)
from textile_twin_core.inference.map_fit import Fit, fit_with_prior_update, map_fit
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    COULOMB,
    DELAY,
    DRIFT,
    GAIN,
    OFFSET,
    ZERO,
    gain_factor,
    gain_value,
)
from textile_twin_core.inference.posterior import IMPLAUSIBLE_NATS, Posterior, evidence_of
from textile_twin_core.inference.starts import GAINS, LOG_ODDS, TURN

_ROUNDS = 5
"""Rounds of refits in which the set of departures may change."""
_HYPOTHESES, _AS_GOOD = 3, 0.01
"""Number of discrete hypotheses to search while all are implausible; share of variance that a later one may lack."""
_BESIDE_ZERO = (GAIN, DRIFT, COULOMB, OFFSET)
"""Departures that stay when zero and delay are exchanged."""


def searched(measurement: Measurement, configured: Hypothesis, fits: list[Fit], full: Fit | None = None) -> Posterior:
    """Search the departures under the likeliest discrete hypotheses; `full`: fit of all parameters under the first."""
    first: Posterior | None = None
    for fit in _distinct(fits)[:_HYPOTHESES]:
        others = [fit, *(other for other in fits if other is not fit)]
        found = DepartureSearch(measurement, configured, others, full=full if fit is fits[0] else None).run()
        if found.hypothesis.unit != 1.0:
            found = _likelier_without_unit(found, others)
        # implausible values may come from wrong discrete settings
        if found.prior_cost <= IMPLAUSIBLE_NATS and (first is None or found.explained > first.explained - _AS_GOOD):
            return found
        first = first or found
    assert first is not None
    return first


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
    other = DepartureSearch(m, found.configured, [start, *fits[1:]], like=found.fit).run()
    return other if other.log_evidence > found.log_evidence + LOG_ODDS["unit"] else found


def _distinct(fits: list[Fit]) -> list[Fit]:
    """Likeliest fit of each direction, ratio and gain."""
    first: dict[tuple[float, float], Fit] = {}
    for fit in fits:
        first.setdefault((fit.hypothesis.turn, fit.hypothesis.gain), fit)
    return list(first.values())


class DepartureSearch:
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
        return evidence_of(m, fit, off_nominal), fit, off_nominal

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
