"""Force laws learned from a recording: as a cause of the verdict, and as a load of the identified machine."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.comparison.causes import NOT_THIS_MACHINE
from textile_twin_core.comparison.judged import Judged, best_periodic
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.inference.evidence import QuadraticEvidence
from textile_twin_core.inference.force_law import (
    CurvedTorque,
    CurvePosterior,
    LearnedCurve,
    curve_and,
    learned,
    likely_curve,
    load_name,
    measure_of,
    place_of,
)
from textile_twin_core.inference.map_fit import Fit, map_fit
from textile_twin_core.inference.parameter import GAIN
from textile_twin_core.inference.posterior import IMPLAUSIBLE_NATS, Posterior
from textile_twin_core.machine import Machine

_TRIED = 0.002
"""Share of the torque's variance, unexplained by constant forces, from which a law over the measure is tried."""
_LEFT, _AT_FIRST = 0.02, 0.9
"""Share that the law may leave unexplained, and share that its first fit must explain."""
_PERIODIC = 0.8
"""Share of the torque that some function of the angle must explain before a law over a measure is tried."""
_SCALE = 0.02
"""Relative standard deviation of the whole curve from which its scale counts as not determined."""
_TIED = 0.9
"""Correlation of the gain with that scale above which the two are not distinguishable."""
_BETTER, _WHITE = 0.5, 1.5
"""Unexplained share of a law's first fit, over that of all departures together, and inflation of its last, that need no
search for departures."""
_LOG_ODDS = math.log(0.05)
"""Odds that a load's force depends on its measure: most do, and most hardly differ from a constant one."""


@dataclass(frozen=True)
class ForceLawCause:
    """A record explained by a force law: judged with it, the law, its name in the results, and the words."""

    judged: Judged
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


def explained_by_force_law(found: Judged, machine: Machine) -> ForceLawCause | None:
    """Explain a record by a force over a measure of the machine, where the forces of its file leave something.

    The law replaces a declared load, or is a new one on a measure without a load. It competes by evidence, at one
    scale of the residual. None if the file explains the record, or if no law does.
    """
    p = found.posterior
    if isinstance(p.measurement.model, CurvedTorque):
        return _cause(found, learned(p), machine)
    if machine.shaft is not None or (found.unexplained < _TRIED and p.prior_cost <= IMPLAUSIBLE_NATS):
        return None
    if found.unexplained > NOT_THIS_MACHINE and best_periodic(found) < _PERIODIC:
        return None
    best: tuple[float, CurvePosterior] | None = None
    for name in _names(machine):
        place, rest = place_of(machine, name)
        law = likely_curve(p, rest, place, max(_AT_FIRST, p.explained))
        if law is None:
            continue
        gain = _gain(p, law)
        if gain + _LOG_ODDS > 0.0 and (best is None or gain > best[0]):
            best = gain, law
    if best is None:
        return None
    posterior, curve = best[1].posterior, best[1].curve
    judged = replace(found, posterior=posterior, explained=posterior.explained)
    if judged.unexplained > _LEFT or posterior.prior_cost > IMPLAUSIBLE_NATS:
        return None
    return _cause(judged, curve, machine)


def law_at_once(unsearched: Judged, machine: Machine) -> Posterior | None:
    """Return the posterior of a force law where no departures from the file explain the record.

    The law must be likelier than the fit of all departures together, and leave noise alone: filters of the torque
    sensor are not searched beside it.

    Args:
        unsearched: the record, judged with all departures together. machine: of the file.
    """
    p = unsearched.posterior
    if machine.shaft is not None or p.measurement.record.block_s or not _names(machine):
        return None
    if unsearched.unexplained < _TRIED:
        return None
    least = max(_AT_FIRST, 1.0 - _BETTER * (1.0 - p.explained))
    for name in _names(machine):
        place, rest = place_of(machine, name)
        law = likely_curve(p, rest, place, least)
        if law is None:
            continue
        q, fit = law.posterior, law.posterior.fit
        m = p.measurement.on(q.measurement.record)
        bound = map_fit(m, p.hypothesis, p.fit.x, m.names, inflation=fit.inflation, scale=fit.scale)
        likelier = q.log_evidence + _LOG_ODDS > bound.log_likelihood
        judged = replace(unsearched, posterior=q, explained=q.explained)
        if likelier and fit.inflation < _WHITE and q.prior_cost <= IMPLAUSIBLE_NATS and judged.unexplained < _TRIED:
            return q
    return None


def _cause(judged: Judged, curve: LearnedCurve, machine: Machine) -> ForceLawCause:
    return ForceLawCause(judged, curve, key_of(curve, machine), _text(curve, machine))


def _names(machine: Machine) -> list[str]:
    """Names of the loads over a measure, and of the measures without a load."""
    taken = {measure_of(load) for load in machine.loads}
    free = [f"{each.name}{POSITION}" for each in machine.measures if f"{each.name}{POSITION}" not in taken]
    return [*(load_name(load) for load in machine.loads if measure_of(load)), *free]


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
