"""Force laws learned from a recording: as a cause of the verdict, and as a load of the identified machine."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.comparison.causes import NOT_THIS_MACHINE
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.judged import Judged, best_periodic
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.inference.curved_torque import CurvedTorque, is_reached, load_name, measure_of, place_of
from textile_twin_core.inference.evidence import QuadraticEvidence
from textile_twin_core.inference.filter_scan import likely_filters
from textile_twin_core.inference.force_law import SENSORS as LAW_SENSORS
from textile_twin_core.inference.force_law import CurvePosterior, likely_curve
from textile_twin_core.inference.learned_curve import LearnedCurve, curve_and, learned
from textile_twin_core.inference.map_fit import Fit, map_fit
from textile_twin_core.inference.measurement import Hypothesis
from textile_twin_core.inference.parameter import GAIN
from textile_twin_core.inference.posterior import IMPLAUSIBLE_NATS, Posterior
from textile_twin_core.inference.record import Record
from textile_twin_core.machine import Machine

_TRIED = 0.002
"""Share of the torque's variance, unexplained by constant forces, from which a law over the measure is tried."""
_BOUND = 2
"""Iterations of the fit of all departures together at the scale of a law's residual."""
_LEFT, _AT_FIRST = 0.02, 0.9
"""Share that the law may leave unexplained, and share that its first fit must explain."""
_PERIODIC = 0.8
"""Share of the torque that some function of the angle must explain before a law over a measure is tried."""
_SCALE = 0.02
"""Relative standard deviation of the whole curve from which its scale counts as not determined."""
_TIED = 0.9
"""Correlation of the gain with that scale above which the two are not distinguishable."""
_BETTER = 0.5
"""Mean square of the residual of a law's first fit, over that of all departures together, that needs no search for
departures; of a filter of the torque sensor, over that without, that makes a law needless."""
_LOG_ODDS = math.log(0.05)
"""Odds that a load's force depends on its measure: most do, and most hardly differ from a constant one."""


@dataclass(frozen=True)
class ForceLawCause:
    """A force law that explains a record, its name in the results, and the words."""

    curve: LearnedCurve
    key: str
    text: str

    @property
    def peak(self) -> tuple[float, float]:
        """Largest force and its standard deviation [N]."""
        curve = self.curve
        force, sigma = np.concatenate([curve.in_N, curve.out_N]), np.sqrt(np.diag(curve.covariance))
        k = int(np.argmax(np.abs(force)))
        return float(force[k]), float(sigma[k])


class ForceLaws:
    """Forces over the measures of a machine that compete with departures from its file to explain a record.

    A law replaces a declared load, or is a new one on a measure without a load.

    Args:
        evidence: the record. machine: of the file. encoder_turn_rad: shaft angle of a turn of the encoder.
        runs: samples of the record in which the torque is filtered over time.
    """

    def __init__(self, evidence: Evidence, machine: Machine, encoder_turn_rad: float, runs: Record) -> None:
        self._runs = runs
        self._evidence, self._machine, self._turn_rad = evidence, machine, encoder_turn_rad
        self._learned: dict[tuple[str, Hypothesis], CurvePosterior | None] = {}

    def at_once(self, unsearched: Posterior, sensors: Fit) -> Posterior | Fit | None:
        """Return the posterior of a law that makes the search for departures needless.

        No filter of the torque sensor may explain much of what the sensors leave. The law must be likelier than all
        departures together, about its sensors too, and leave noise alone. Where departures about its sensors are
        likelier, return their fit.

        Args:
            unsearched: fit of all departures together. sensors: fit of the sensors, friction, inertia and forces alone.
        """
        if unsearched.measurement.record.block_s or self._judged(unsearched).unexplained < _TRIED:
            return None
        if likely_filters(unsearched.measurement.on(self._runs), sensors, _BETTER):
            return None
        for law in self._learn(unsearched, 1.0 - _BETTER * (1.0 - unsearched.explained)):
            p, fit = law.posterior, law.posterior.fit
            m = unsearched.measurement.on(p.measurement.record)
            x = m.nominal.copy()
            for name in (LAW_SENSORS | p.hypothesis.filters) & set(m.names):
                x[m.place[name]] = p.value(name)
            nested = map_fit(m, p.hypothesis, x, m.names, inflation=fit.inflation, scale=fit.scale)
            bound = map_fit(
                m,
                unsearched.hypothesis,
                unsearched.fit.x,
                m.names,
                iterations=_BOUND,
                inflation=fit.inflation,
                scale=fit.scale,
            )
            if p.log_evidence + _LOG_ODDS < nested.log_likelihood:
                # a filter is searched after the departures, on samples at an even rate
                return nested if p.hypothesis.filters == unsearched.hypothesis.filters else None
            likelier = p.log_evidence + _LOG_ODDS > bound.log_likelihood
            if likelier and law.is_white and self._holds(p, _TRIED):
                return p
        return None

    def likelier(self, found: Posterior) -> Posterior:
        """Return the posterior of the likeliest law that explains the record better than a posterior without one."""
        if isinstance(found.measurement.model, CurvedTorque):
            return found
        if self._judged(found).unexplained < _TRIED and found.prior_cost <= IMPLAUSIBLE_NATS:
            return found
        gains = [(_gain(found, law), law.posterior) for law in self._learn(found, found.explained)]
        gain, law = max(gains, key=lambda each: each[0], default=(-math.inf, found))
        return law if gain + _LOG_ODDS > 0.0 and self._holds(law, _LEFT) else found

    def _learn(self, p: Posterior, least: float) -> list[CurvePosterior]:
        """Learn the laws whose first fit explains a least share, each once under a hypothesis of the sensors."""
        machine, judged = self._machine, self._judged(p)
        if machine.shaft is not None:
            return []
        if judged.unexplained > NOT_THIS_MACHINE and best_periodic(judged) < _PERIODIC:
            return []
        for name in _names(machine):
            if (name, p.hypothesis) not in self._learned:
                place, rest = place_of(machine, name)
                self._learned[name, p.hypothesis] = likely_curve(p, rest, place, max(_AT_FIRST, least), self._runs)
        laws = (self._learned[name, p.hypothesis] for name in _names(machine))
        return [law for law in laws if law is not None and law.curve.varies]

    def _judged(self, p: Posterior) -> Judged:
        return Judged(self._evidence, p, 1.0, self._turn_rad, p.explained, 0.0)

    def _holds(self, p: Posterior, most: float) -> bool:
        """Return whether a posterior is plausible and leaves at most a share of the torque unexplained."""
        return p.prior_cost <= IMPLAUSIBLE_NATS and self._judged(p).unexplained <= most


def cause_of(judged: Judged, machine: Machine) -> ForceLawCause | None:
    """Return the force law of a judged record as a cause; None without one."""
    if not isinstance(judged.posterior.measurement.model, CurvedTorque):
        return None
    curve = learned(judged.posterior)
    return ForceLawCause(curve, key_of(curve, machine), _text(curve, machine))


def _names(machine: Machine) -> list[str]:
    """Names of the loads over a measure that reaches them, and of the measures without a load."""
    taken = {measure_of(load) for load in machine.loads}
    free = [f"{each.name}{POSITION}" for each in machine.measures if f"{each.name}{POSITION}" not in taken]
    return [*(load_name(load) for load in machine.loads if is_reached(machine, load)), *free]


def _gain(p: Posterior, law: CurvePosterior) -> float:
    """Log evidence of the law over that of the posterior without it, at the scale and inflation of the law's fit."""
    fit, value = law.posterior.fit, law.posterior.log_evidence
    m = p.measurement.on(law.posterior.measurement.record)
    without = map_fit(
        m, p.hypothesis, p.fit.x, p.off_nominal, inflation=fit.inflation, scale=fit.scale, relinearise=True
    )
    return value - QuadraticEvidence(m, without, fit.inflation)(p.off_nominal) - without.log_likelihood


def key_of(curve: LearnedCurve, machine: Machine) -> str:
    """Return the name of a law in results: that of its load, or else of its measure."""
    return curve.name if curve.name in {load_name(each) for each in machine.loads} else curve.measure


def _text(curve: LearnedCurve, machine: Machine) -> str:
    ways = []
    for way, force in (("in", curve.in_N), ("out", curve.out_N)):
        known = force[~curve.undetermined(way == "in")]
        known = known if known.size else force
        ways.append(f"{float(known.min()):.0f} to {float(known.max()):.0f} N on the way {way}")
    grows = ", growing with the speed" if curve.speed_power else ""
    needles = ", the mean of all linkages," if len(machine.linkages) > 1 else ""
    return (
        f"the force of {curve.name}{needles} depends on {curve.measure}: {', '.join(ways)}{grows}; identify --curve"
        f" {key_of(curve, machine)} writes it into the machine file"
    )


def notes_of(curve: LearnedCurve, posterior: Posterior, fit: Fit, machine: Machine) -> tuple[str, ...]:
    """Say where a law is not determined, and which recording would resolve it."""
    notes = []
    for way, growing in (("in", True), ("out", False)):
        lost = np.flatnonzero(curve.undetermined(growing))
        for run in np.split(lost, np.flatnonzero(np.diff(lost) > 1) + 1) if lost.size else ():
            low, high = curve.knots[run[0]], curve.knots[run[-1]]
            notes.append(
                f"{curve.name}: the force on the way {way} is not determined from {low:.5g} to {high:.5g} m of"
                f" {curve.measure}, where it hardly moves with the shaft or steps: a longer recording would resolve it"
            )
    m = posterior.measurement
    force = np.concatenate([curve.in_N, curve.out_N])
    square = max(float(force @ force), 1e-300)
    scale = math.sqrt(max(float(force @ curve.covariance @ force), 0.0)) / square
    along = float(force @ curve_and(GAIN, posterior, fit)) / square
    gain_sigma = math.sqrt(fit.covariance[m.place[GAIN], m.place[GAIN]])
    if scale > _SCALE and abs(along) > _TIED * scale * gain_sigma:
        notes.append(
            f"{curve.name}: gain of the torque sensor and a scale of the whole curve are not distinguishable beyond"
            f" {100.0 * scale:.0f} %: a recording at another speed, whose inertia torque is known, or of the machine"
            " without cloth would resolve it"
        )
    if m.record.one_speed:
        notes.append(
            f"{curve.name}: at one speed zero and delay are not distinguishable, nor a force that grows with the speed:"
            " a recording with a run-up would resolve it"
        )
    if len(machine.linkages) > 1:
        notes.append(
            f"{curve.name}: the {len(machine.linkages)} linkages act on one shaft together; the curve is their mean"
        )
    return tuple(notes)


def with_law(machine: Machine, curve: LearnedCurve) -> Machine:
    """Return the machine with a law in place of the load of its name, or beside its loads."""
    law, loads = curve.load(), list(machine.loads)
    names = [load_name(load) for load in machine.loads]
    if curve.name in names:
        loads[names.index(curve.name)] = law
    else:
        loads.append(law)
    return replace(machine, loads=tuple(loads))
