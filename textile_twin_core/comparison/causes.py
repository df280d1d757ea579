"""The verdict: which causes are named, likeliest first, and the estimate of each quantity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from textile_twin_core.comparison.cause import NOT_JUDGED, Cause, Quantity
from textile_twin_core.comparison.departure_causes import (
    amplitude,
    at_one_speed,
    change_cause,
    departure_cause,
    friction_cause,
    friction_departure,
    is_offset_in_unit,
    known_with_offset,
    noise_cause,
    signed_speed,
    zero_departure,
)
from textile_twin_core.comparison.judged import Judged
from textile_twin_core.comparison.readings import AngleUnit, shown_turn
from textile_twin_core.comparison.stamp_timing import StampTiming
from textile_twin_core.comparison.uncertainty import Estimate, with_sigma
from textile_twin_core.inference.curved_torque import is_reached, load_name
from textile_twin_core.inference.elastic_torque import OF_SHAFT
from textile_twin_core.inference.parameter import (
    COULOMB,
    DELAY,
    DRIFT,
    ECCENTRIC,
    FILTERS,
    GAIN,
    HELD,
    HIGH_PASS,
    OFFSET,
    VISCOUS,
    ZERO,
    gain_factor,
)
from textile_twin_core.inference.posterior import IMPLAUSIBLE_NATS, Posterior
from textile_twin_core.inference.torque_units import nearest_gain

FEWEST_ANGLES = 16.0
"""Fewest angle samples a turn that resolve the orders with torque."""
NOT_THIS_MACHINE = 0.05
"""Share of the torque, unexplained by this machine, that another machine must be able to explain."""
_NOTHING_ELSE = 0.25
_MIRRORED = 1e-3
"""Largest difference, over the working torque, between a machine and its mirror image that no reading shows."""
_DIRECTION = ZERO.replace("zero_rad", "direction")
FOLLOWS_NOTHING = 0.5
"""Share of the torque, unexplained by the best function of the angle, above which it follows no machine."""
_OF_TIME = (DELAY, DRIFT, *FILTERS)
"""Departures that change no mean torque, so that an uncertain ripple of the motion can hide them."""
_HIDDEN = 2.0
"""Residuals within which an uncertain ripple of the motion can hide a departure of time."""
_TWO_SIGMA = 1.96
_LEAST_LINE = 1e-4
"""Share of the torque's variance that a line fixed in time explains, above which it is named."""
_CERTAIN = 4.0
"""Standard deviations above which friction, and a force within its everyday tolerance, are named."""


def causes(found: Judged, unit: AngleUnit, per_turn: float, periodic: float) -> list[Cause]:
    """List all faults, likeliest first.

    Args:
        found: the record and its posterior.
        unit: of the logged angle.
        per_turn: angle samples in a turn at working speed.
        periodic: share that any periodic torque could explain (see `best_periodic`).
    """
    named = [*_discrete(found), *_departures(found)]
    if unit.name != "radians":
        text = (
            f"the angle is logged in {unit.name}, {shown_turn(unit.turn)} a turn, and is read as radians: --angle-unit"
            f" {unit.option}; for nodes angle_unit_rad {unit.to_radians:.10g}"
        )
        named.insert(0, Cause("angle_unit", text, unit.name))
    unexplained = found.unexplained
    surprising = found.posterior.prior_cost > IMPLAUSIBLE_NATS
    if unexplained > _NOTHING_ELSE or surprising:
        named = []  # estimates are meaningless for another machine
    if (unexplained > NOT_THIS_MACHINE or surprising) and per_turn >= FEWEST_ANGLES:
        named.insert(0, _other_machine(found, unexplained, 1.0 - periodic, surprising))
    if per_turn < FEWEST_ANGLES:
        text = f"the angle comes {per_turn:.1f} times a turn; a torque needs it at least {FEWEST_ANGLES:g} times"
        named.insert(0, Cause("angle_rate", text, per_turn))
    return named


def _other_machine(found: Judged, unexplained: float, unexplained_by_any: float, surprising: bool) -> Cause:
    share = 100.0 * min(unexplained, 1.0)
    residual = f"{share:.0f} % of the torque's variance stays unexplained whatever the sensors' settings"
    if surprising and unexplained <= NOT_THIS_MACHINE:
        number = len(found.posterior.off_nominal)
        text = f"not this machine: {number} numbers of its file would have to be wrong at once to explain this torque"
    elif unexplained_by_any > FOLLOWS_NOTHING:
        text = (
            f"the torque does not follow this shaft: {residual}; another shaft's sensor, another clock, a dead sensor,"
            " or a gear other than 1, 2, 3, 4 or one to that: give the encoder's ratio in the machine file"
        )
    elif unexplained - unexplained_by_any > NOT_THIS_MACHINE:
        text = f"not this machine: {residual}, though the torque repeats with the shaft's angle"
    else:
        text = f"not this machine, or a sensor with much noise: {residual}"
    return Cause("other_machine", text + without_law(found.posterior), 1.0 - unexplained)


def without_law(p: Posterior) -> str:
    """Say which force laws were not tried, and which recording would show them; empty where they were."""
    elastic, machine = p.measurement.record.predicted is not None, p.measurement.model.machine
    names = [load_name(load) for load in machine.loads if is_reached(machine, load)]
    if not names or not (elastic or HIGH_PASS in p.hypothesis.filters):
        return ""
    beside, remedy = (
        ("the declared elastic shaft", "a slow recording, with a machine file without `shaft`,")
        if elastic
        else ("an amplifier that blocks the mean", "a recording with its DC coupling")
    )
    return (
        f"; whether the force of {' or '.join(names)} depends on its measure cannot be judged beside {beside}: {remedy}"
        " would show it"
    )


def _discrete(found: Judged) -> list[Cause]:
    """Faults of direction, gear ratio, sign and unit."""
    p, named = found.posterior, []
    near, against = nearest_gain(p.hypothesis.gain, p.configured.gain), p.hypothesis.turn * p.configured.turn < 0.0
    either = against != (near.sign < 0) and _is_own_mirror_image(p)
    if against:
        text = "the encoder counts against the direction that the machine file says"
        if either:
            text += ", or the torque's sign is reversed: by its torque this machine is its own mirror image"
        sense, other = math.copysign(1.0, p.hypothesis.turn), (GAIN,) if either else ()
        named.append(Cause("encoder_direction", text, sense, math.nan, _DIRECTION, other))
    if found.ratio != 1.0:
        text = f"the shaft turns {found.ratio:.4g} times as far as the machine file says: encoder ratio"
        named.append(Cause("encoder_ratio", text, found.ratio, math.nan, ZERO.replace("zero_rad", "ratio")))
    if near.sign < 0:
        text, other = "torque sign reversed: the gain is negative", ()
        if either:
            text, other = text + "; or the encoder's direction, as this machine is its own mirror image", (_DIRECTION,)
        named.append(Cause("torque_sign", text, -1.0, math.nan, GAIN, other))
    if near.unit:
        text = f"the torque looks like {near.unit} instead of N m: {near.factor:.4g} times as large"
        named.append(Cause("torque_unit", text, near.unit, math.nan, GAIN))
    return named


def _is_own_mirror_image(p: Posterior) -> bool:
    """Return true if the other direction with the other sign of the gain expects the same readings."""
    m, x = p.measurement, p.fit.x.copy()
    x[m.place[ZERO]] *= -1.0
    seen = m.expected(p.hypothesis, p.fit.x)
    other = m.expected(replace(p.hypothesis.turned(-1.0), gain=-p.hypothesis.gain), x)
    away = (seen.torque_Nm - other.torque_Nm)[seen.good & other.good]
    return bool(np.sqrt(np.mean(away**2)) < _MIRRORED * abs(p.hypothesis.gain) * m.working_torque_Nm)


def _departures(found: Judged) -> list[Cause]:
    """Reportable departures, in order of the torque that each explains."""
    p, named = found.posterior, list[tuple[float, Cause]]()
    effects = found.effects_Nm
    # errors of the motion stay in the residual, too, as far as the averages of a fit show them
    uncertain = min(abs(p.hypothesis.gain) * p.measurement.uncertain_Nm, _HIDDEN * p.fit.rms)
    for name in sorted(p.off_nominal):
        away = p.departure(name)
        if name in (ZERO, DELAY) and found.evidence.track.at_one_speed:
            if {ZERO, DELAY} <= p.off_nominal and name == DELAY:
                continue  # one cause for both
            away = dict(zip((ZERO, DELAY), at_one_speed(found), strict=True))[name]
        elif name == ZERO:
            away = zero_departure(found)
        elif name in ECCENTRIC:
            away = amplitude(found, name)
        known = p.parameter(name)
        beside = name in ECCENTRIC or (name in (ZERO, DELAY) and found.evidence.track.at_one_speed)
        least = known.threshold if beside else max(known.threshold, _TWO_SIGMA * p.sigma(name))
        if name in (COULOMB, VISCOUS, HELD) or abs(away) < least:  # the interval holds the file's value
            continue
        if name in _OF_TIME and effects.get(name, 0.0) < uncertain:
            continue
        if name == OFFSET and is_offset_in_unit(found):
            continue
        if found.changing is not None and name == found.changing.name:
            continue  # named with its values over time
        if name == ECCENTRIC[1] and ECCENTRIC[0] in p.off_nominal:
            continue  # one cause for both orders
        if name in OF_SHAFT and any(cause.cause == "elastic_shaft" for _, cause in named):
            continue  # one cause for all numbers of the shaft
        named.append((effects.get(name, 0.0), departure_cause(found, name)))
    # dry and viscous friction may each stay within tolerance where their sum does not
    friction, sigma = friction_departure(found, known_with_offset(found))
    blocked = HIGH_PASS in p.hypothesis.filters  # with the mean, dry friction
    if not blocked and abs(friction) > max(p.parameter(COULOMB).threshold, _CERTAIN * sigma):
        named.append((abs(friction), friction_cause(found)))
    if found.changing is not None:
        named.append((float(np.std(found.changing.torque_Nm)), change_cause(found, found.changing)))
    for known in p.measurement.parameters:
        # within the tolerance of a force, and still known better than that
        if known.kind == "force" and known.name not in (*p.off_nominal, found.changing and found.changing.name):
            away, sigma = p.departure(known.name), p.sigma(known.name)
            if abs(away) > max(known.threshold, _CERTAIN * sigma):
                named.append((effects.get(known.name, 0.0), departure_cause(found, known.name)))
    # of the measured torque: that of the file may be wrong, or in another unit
    least = math.sqrt(2.0 * _LEAST_LINE * float(np.var(found.evidence.torque_Nm)))
    lines = [line for line in found.lines if line.amplitude_Nm > least]
    if lines:
        named.append((lines[0].amplitude_Nm / math.sqrt(2.0), noise_cause(lines)))
    named.sort(key=lambda each: -each[0])
    return [cause for _, cause in named]


def burst_verdict(timings: Sequence[StampTiming], causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Return the verdict with stamps in bursts first, and without the causes that wrong times may imitate."""
    if not timings:
        return tuple(causes)
    text = "; ".join(timing.text for timing in timings)
    advice = "; stamp samples where they are taken. Direction, sign, zero, delay and machine are not judged"
    first = Cause("stamps_in_bursts", text + advice, max(timing.bursts.period_s for timing in timings))
    return (first, *(cause for cause in causes if cause.cause not in NOT_JUDGED))


def quantities(found: Judged, verdict: Sequence[Cause], delay: Estimate) -> tuple[Quantity, ...]:
    """Estimates of reportable quantities from the fit of the verdict, given the file's tolerances.

    Quantities named in the verdict are left out. `delay`: of the torque [s].
    """
    p, h = found.posterior, found.posterior.hypothesis
    one_speed, rests = found.evidence.track.at_one_speed, bool(p.measurement.record.standstills)
    both = "zero and delay are not distinguishable at one speed, a run-up would resolve it"
    apart = "known only together with friction, a standstill would resolve it"

    def row(names: tuple[str, ...], what: str, value: float, sigma: float, unit: str, file: float, digits: str) -> None:
        note = "as the file says" if abs(value - file) <= _TWO_SIGMA * sigma else f"{file:{digits}}{unit} in the file"
        if one_speed and names[0] in (ZERO, DELAY):
            note = both
        elif names == (OFFSET,) and not rests:
            note = apart
        shown = f"{value:{digits}} +- {sigma:.2g}" if unit != " N m" else with_sigma(value, sigma, "+z")
        rows.append((names, what, f"{shown}{unit}: {note}"))

    rows: list[tuple[tuple[str, ...], str, str]] = []
    beside = (ZERO, DELAY)
    away, sigma = math.degrees(math.remainder(p.departure(ZERO), 2.0 * math.pi)), math.degrees(p.sigma(ZERO))
    row(beside if one_speed else (ZERO,), "encoder zero beside the file", away, sigma, " deg", 0.0, "+.3f")
    delays = (DELAY, ZERO) if one_speed else (DELAY,)
    row(delays, "torque delay", delay.value * 1e3, delay.sigma * 1e3, " ms", p.configured.delay_s * 1e3, ".2f")
    factor = gain_factor(p.value(GAIN))
    row((GAIN,), "torque gain", h.gain * factor, abs(h.gain) * factor**2 * p.sigma(GAIN), "", p.configured.gain, ".4g")
    if HIGH_PASS not in h.filters:  # which blocks offset and dry friction
        offset, sigma = h.shown_offset(p.value(OFFSET)), h.unit * p.sigma(OFFSET)
        row((OFFSET,), "torque offset", offset, sigma, " N m", p.configured.offset_Nm, "+z.3f")
        file = p.parameter(COULOMB).nominal + abs(signed_speed(found)) * p.parameter(VISCOUS).nominal
        away, sigma = friction_departure(found)
        row((COULOMB, VISCOUS), "friction at working speed", file + away, sigma, " N m", file, ".3f")
    for known in p.measurement.parameters:
        if known.kind == "force" or known.name in OF_SHAFT:
            unit, name = f" {known.unit}", known.name
            row((name,), name, p.value(name), p.sigma(name), unit, known.nominal, ".4g")
    said = {cause.parameter for cause in verdict}
    return tuple(Quantity(what, text) for names, what, text in rows if said.isdisjoint(names))
