"""Causes of the verdict: one table of departures with their words, and the estimate of each quantity."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.comparison.change_in_time import ChangeInTime
from textile_twin_core.comparison.judged import Judged
from textile_twin_core.comparison.readings import AngleUnit, shown_turn
from textile_twin_core.comparison.stamp_timing import StampTiming
from textile_twin_core.comparison.torque_readings import TimeLine
from textile_twin_core.comparison.uncertainty import with_sigma
from textile_twin_core.driveline import elastic_shaft, find_resonances
from textile_twin_core.inference.elastic_torque import OF_SHAFT, STIFFNESS, with_shaft_values
from textile_twin_core.inference.parameter import (
    BUTTERWORTH,
    COULOMB,
    DELAY,
    DRIFT,
    ECCENTRIC,
    ECCENTRICITY,
    FILTERS,
    GAIN,
    HELD,
    HIGH_PASS,
    LOW_PASS,
    OFFSET,
    ROTOR,
    VISCOUS,
    ZERO,
    gain_factor,
)
from textile_twin_core.inference.posterior import IMPLAUSIBLE_NATS, Posterior
from textile_twin_core.inference.torque_units import nearest_gain

FEWEST_ANGLES = 16.0
"""Fewest angle samples a turn that resolve the orders with torque."""
WRONG_FIRST = ("encoder_direction", "encoder_ratio", "angle_unit", "angle_rate", "torque_sign", "torque_unit")
"""Causes to settle before anything else can be identified."""
NOT_THIS_MACHINE = 0.05
"""Share of the torque, unexplained by this machine, that another machine must be able to explain."""
_NOTHING_ELSE = 0.25
_MIRRORED = 1e-3
"""Largest difference, over the working torque, between a machine and its mirror image that no reading shows."""
_DIRECTION = ZERO.replace("zero_rad", "direction")
_SAME = 0.05
"""Relative difference within which an offset in another unit equals the configured one."""
FOLLOWS_NOTHING = 0.5
"""Share of the torque, unexplained by the best function of the angle, above which it follows no machine."""
NOT_JUDGED = frozenset(
    (
        "encoder_zero",
        "encoder_direction",
        "encoder_ratio",
        "angle_rate",
        "torque_sign",
        "delay",
        "zero_or_delay",
        "clocks_drift",
        "other_machine",
    )
)
"""Causes that wrong times may imitate."""
_OF_TIME = (DELAY, DRIFT, *FILTERS)
"""Departures that change no mean torque, so that an uncertain ripple of the motion can hide them."""
_TWO_SIGMA = 1.96
_LEAST_LINE = 0.005
"""Amplitude of a line fixed in time, over the working torque, above which it is named."""
_CERTAIN = 4.0
"""Standard deviations above which friction, and a force within its everyday tolerance, are named."""
_CAUSES = {
    "force": "load_force",
    "free_force": "load_force",
    "load": "load_force",
    "plane": "load_force",
    "spring": "spring",
    "preload": "spring",
    "mass": "mass",
    "inertia": "inertia",
    "centroid": "centroid",
    "length": "length",
    "ground": "length",
    "angle": "length",
}
"""Cause by kind of a parameter in the machine's declaration."""


@dataclass(frozen=True)
class Cause:
    """One fault of the verdict.

    Attributes:
        cause: its name. text: for a person, with the number.
        value: rad, s, N m, or a factor, by cause; a unit's name for units.
        sigma: standard deviation of the value given the tolerances of all other numbers, nan without one.
        parameter: dotted path into the machine file, empty if the file has no such number.
        equivalents: paths of parameters that this record does not distinguish from it.
        unit: of the value where the cause leaves it open: s or Hz of a low pass.

    Examples:
        >>> from textile_twin_core.comparison.causes import Cause
        >>> Cause("delay", "the torque lags by 2 ms", 0.002, 4e-5, "sensors.torque.delay_s").value  # [s]
        0.002
    """

    cause: str
    text: str
    value: float | str | dict[str, float]
    sigma: float = math.nan
    parameter: str = ""
    equivalents: tuple[str, ...] = ()
    unit: str = ""


@dataclass(frozen=True)
class Quantity:
    """An estimated quantity and its name for a person."""

    name: str
    text: str


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
    return Cause("other_machine", text, 1.0 - unexplained)


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
    effects, uncertain = found.effects_Nm, abs(p.hypothesis.gain) * p.measurement.uncertain_Nm
    for name in sorted(p.off_nominal):
        away = p.departure(name)
        if name in (ZERO, DELAY) and found.evidence.track.at_one_speed:
            if {ZERO, DELAY} <= p.off_nominal and name == DELAY:
                continue  # one cause for both
            away = dict(zip((ZERO, DELAY), _at_one_speed(found), strict=True))[name]
        elif name == ZERO:
            away = _zero_departure(found)
        elif name in ECCENTRIC:
            away = _amplitude(found, name)
        known = p.parameter(name)
        beside = name in ECCENTRIC or (name in (ZERO, DELAY) and found.evidence.track.at_one_speed)
        least = known.threshold if beside else max(known.threshold, _TWO_SIGMA * p.sigma(name))
        if name in (COULOMB, VISCOUS, HELD) or abs(away) < least:  # the interval holds the file's value
            continue
        if name in _OF_TIME and effects.get(name, 0.0) < uncertain:
            continue
        if name == OFFSET and _is_offset_in_unit(found):
            continue
        if found.changing is not None and name == found.changing.name:
            continue  # named with its values over time
        if name == ECCENTRIC[1] and ECCENTRIC[0] in p.off_nominal:
            continue  # one cause for both orders
        if name in OF_SHAFT and any(cause.cause == "elastic_shaft" for _, cause in named):
            continue  # one cause for all numbers of the shaft
        named.append((effects.get(name, 0.0), _ONE.get(name, _of_machine)(found, name)))
    # dry and viscous friction may each stay within tolerance where their sum does not
    friction, sigma = _friction_departure(found, _with_offset(found))
    blocked = HIGH_PASS in p.hypothesis.filters  # with the mean, dry friction
    if not blocked and abs(friction) > max(p.parameter(COULOMB).threshold, _CERTAIN * sigma):
        named.append((abs(friction), _friction(found)))
    if found.changing is not None:
        named.append((float(np.std(found.changing.torque_Nm)), _changing(found, found.changing)))
    for known in p.measurement.parameters:
        # within the tolerance of a force, and still known better than that
        if known.kind == "force" and known.name not in (*p.off_nominal, found.changing and found.changing.name):
            away, sigma = p.departure(known.name), p.sigma(known.name)
            if abs(away) > max(known.threshold, _CERTAIN * sigma):
                named.append((effects.get(known.name, 0.0), _of_machine(found, known.name)))
    lines = [line for line in found.lines if line.amplitude_Nm > _LEAST_LINE * p.measurement.working_torque_Nm]
    if lines:
        named.append((lines[0].amplitude_Nm / math.sqrt(2.0), _periodic_noise(lines)))
    named.sort(key=lambda each: -each[0])
    return [cause for _, cause in named]


def _amplitude(found: Judged, name: str) -> float:
    """Amplitude of the error of the angle in one order [rad]."""
    p = found.posterior
    return math.hypot(p.value(name), p.value(f"{name}.sine"))


def _eccentricity(found: Judged, name: str) -> Cause:
    p = found.posterior
    named = max((each for each in ECCENTRIC if each in p.off_nominal), key=lambda each: _amplitude(found, each))
    size = _amplitude(found, named)
    pair = named, f"{named}.sine"
    direction = np.array([p.value(each) for each in pair]) / max(size, 1e-300)
    sigma = math.sqrt(max(float(direction @ p.covariance(pair) @ direction), 0.0))
    often = "once" if named == ECCENTRIC[0] else "twice"
    values = ", ".join(f"[{p.value(each):.5f}, {p.value(f'{each}.sine'):.5f}]" for each in ECCENTRIC)
    text = (
        f"the encoder runs out: its angle is off by {math.degrees(size):.2f} +- {math.degrees(sigma):.2f} deg {often} a"
        f" turn, as by a coupling or a wheel off its centre; eccentricity_rad: [{values}] in the machine file"
    )
    return Cause("encoder_eccentricity", text, size, sigma, ECCENTRICITY, _equivalents(found, named)[0])


def _low_pass(found: Judged, name: str) -> Cause:
    p = found.posterior
    time, sigma = p.value(name), p.sigma(name)
    more = _equivalents(found, name)[0]
    if name == LOW_PASS:
        size = f"{time * 1e3:.2f} +- {sigma * 1e3:.2g} ms"
        text = f"the torque is filtered: low pass of the first order, time constant {size}"
        return Cause("torque_low_pass", text, time, sigma, LOW_PASS, more, "s")
    corner = 1.0 / (2.0 * math.pi * time)
    width = corner * sigma / time
    text = f"the torque is filtered: low pass of the second order (Butterworth) at {corner:.3g} +- {width:.2g} Hz"
    return Cause("torque_low_pass", text, corner, width, BUTTERWORTH, more, "Hz")


def _periodic_noise(lines: Sequence[TimeLine]) -> Cause:
    listed = ", ".join(f"{line.frequency_hz:.2f} Hz ({line.amplitude_Nm:.2g} N m)" for line in lines)
    text = f"the torque has noise that is periodic in time, not with the shaft, as mains hum: {listed}; it is left out"
    return Cause("periodic_noise", text, lines[0].frequency_hz)


def _high_pass(found: Judged, name: str) -> Cause:
    p = found.posterior
    corner, sigma = p.value(name), p.sigma(name)
    text = f"the torque's mean is blocked, as by AC coupling: high pass at {corner:.3g} +- {sigma:.2g} Hz"
    return Cause("torque_high_pass", text, corner, sigma, HIGH_PASS, _equivalents(found, name)[0])


def _speed(found: Judged) -> float:
    return found.posterior.hypothesis.turn * found.evidence.working_speed()


def _zero_departure(found: Judged) -> float:
    """Departure of the zero from the configured one [rad], without whole turns of an encoder of another ratio."""
    return _in_turn_of_encoder(found, found.posterior.departure(ZERO))


def _in_turn_of_encoder(found: Judged, away: float) -> float:
    period = 2.0 * math.pi
    if found.ratio != 1.0:
        period = min(period, found.encoder_turn_rad * found.ratio)
    return math.remainder(away, period)


def _is_turn_of_encoder(found: Judged, zero_rad: float) -> bool:
    """Return true if a zero is off by whole turns of a wrapped encoder that turns faster than the shaft."""
    turn = found.encoder_turn_rad
    near = abs(math.remainder(zero_rad, turn)) < 0.05 * turn
    return turn < 1.5 * math.pi and abs(zero_rad) > 0.5 * turn and near


def _equivalents(found: Judged, name: str) -> tuple[tuple[str, ...], str]:
    """Parameters that explain the record equally well, as paths and in words."""
    other = found.posterior.equivalents(name)[:4]
    text = f"; not distinguishable from {', '.join(other)} in this recording" if other else ""
    return other, text


def _zero(found: Judged, name: str) -> Cause:
    if found.evidence.track.at_one_speed:
        return _zero_or_delay(found, name)
    return _plain_zero(found)


def _plain_zero(found: Judged) -> Cause:
    away, sigma = _as_zero(found)
    text = f"encoder zero {math.degrees(away):+.2f} +- {math.degrees(sigma):.2f} deg off, as angle of the shaft"
    if _is_turn_of_encoder(found, away):
        text = (
            f"encoder zero off by {math.degrees(away):+.1f} deg, a whole turn of the wrapped encoder: which part of the"
            " shaft's turn its first reading stands for must be settled after each start"
        )
    return Cause("encoder_zero", text, away, sigma, ZERO, found.posterior.equivalents(ZERO))


def _as_zero(found: Judged) -> tuple[float, float]:
    """Departure of the zero and its standard deviation, or of the delay as a zero [rad]."""
    p, speed = found.posterior, _speed(found)
    if ZERO in p.off_nominal:
        return _zero_departure(found), p.sigma(ZERO)
    return math.remainder(p.departure(DELAY) * speed, 2.0 * math.pi), p.sigma(DELAY) * abs(speed)


def _delay(found: Judged, name: str) -> Cause:
    if found.evidence.track.at_one_speed:
        return _zero_or_delay(found, name)
    p = found.posterior
    away, sigma = p.departure(DELAY), p.sigma(DELAY)
    size = f"{abs(away) * 1e3:.2f} +- {sigma * 1e3:.2f} ms"
    text = f"the torque lags by {size} {'more' if away >= 0.0 else 'less'} than the machine file says"
    if found.settings.delay_s < 0.0:
        text += ", so it leads: stamped too early, or commanded and not measured"
    return Cause("delay", text + _or_inertia(found, away), away, sigma, DELAY, p.equivalents(DELAY))


def _or_inertia(found: Judged, delay_s: float) -> str:
    """Alternative to a delay under a speed-controlled drive, in words; empty without such a drive."""
    inertia = found.torque_by_speed_Nms * delay_s / found.settings.gain
    if not inertia > 0.0:
        return ""
    return f", or {inertia:.2g} kg m2 that turn with it are not in the model, since the torque follows the speed here"


def _at_one_speed(found: Judged) -> tuple[float, float]:
    """Zero [rad] and delay [s] of which each explains what both do, given the file exactly.

    At one speed only their sum is known; given its tolerances the file's lengths and phases would take a share of it.
    """
    late, ahead = found.settled.given_file(DELAY)[0], found.settled.given_file(ZERO)[0]
    speed = _speed(found)
    zero = _in_turn_of_encoder(found, ahead + late * speed)
    return zero, zero / speed if ahead else late


def _zero_or_delay(found: Judged, name: str) -> Cause:
    sigma = _as_zero(found)[1]
    zero, delay = _at_one_speed(found)
    if _is_turn_of_encoder(found, zero):
        return _plain_zero(found)
    text = (
        f"zero or delay: {math.degrees(zero):+.1f} deg or {delay * 1e3:.1f} ms{_or_inertia(found, delay)};"
        " the shaft turns at one speed here, a recording with a run-up would resolve it"
    )
    return Cause(
        "zero_or_delay", text, {"zero_rad": zero, "delay_s": delay}, sigma, name, tuple({ZERO, DELAY} - {name})
    )


def _drift(found: Judged, name: str) -> Cause:
    p = found.posterior
    away, sigma = p.departure(DRIFT), p.sigma(DRIFT)
    text = f"the clocks of angle and torque drift apart by {away * 1e6:.0f} +- {sigma * 1e6:.0f} us each second"
    return Cause("clocks_drift", text, away, sigma, "", p.equivalents(DRIFT))


def _gain(found: Judged, name: str) -> Cause:
    p = found.posterior
    factor = gain_factor(p.value(GAIN))
    sigma = factor**2 * p.sigma(GAIN)
    other, more = _equivalents(found, GAIN)
    text = f"torque gain {factor:.3f} +- {sigma:.3f} times the configured one{more}"
    return Cause("torque_gain", text, factor, sigma, GAIN, other)


def _offset(found: Judged, name: str) -> Cause:
    p = found.posterior
    unit = p.hypothesis.unit
    away, sigma = unit * p.departure(OFFSET), unit * p.sigma(OFFSET)
    text = f"torque offset {away:+.3g} +- {sigma:.2g} N m beside the configured one"
    return Cause("torque_offset", text, away, sigma, OFFSET, p.equivalents(OFFSET))


def _is_offset_in_unit(found: Judged) -> bool:
    """Return true if an offset is the configured one, expressed in the other unit of the logged torque."""
    p = found.posterior
    near = nearest_gain(p.hypothesis.gain, p.configured.gain)
    own = p.configured.offset_Nm * near.factor
    sigma = p.hypothesis.unit * p.sigma(OFFSET)
    return bool(near.unit) and abs(found.settings.offset_Nm - own) < max(_SAME * abs(own), 4.0 * sigma)


def _shaft(found: Judged, name: str) -> Cause:
    """Cause for an elastic shaft that is not as declared: all its numbers that depart."""
    p = found.posterior
    values = {known.name: p.value(known.name) for known in p.measurement.parameters if known.name in OF_SHAFT}
    wrong = [
        f"{what} {values[each]:.4g} +- {p.sigma(each):.2g} {p.parameter(each).unit} instead of"
        f" {p.parameter(each).nominal:.4g}"
        for each, what in zip(
            OF_SHAFT, ("stiffness", "damping", "inertia of the drive", "slip of the drive"), strict=True
        )
        if each in p.off_nominal
    ]
    machine = with_shaft_values(p.measurement.model.machine, values)
    speed = machine.nominal_speed_rad_s
    first_Hz = find_resonances(elastic_shaft(machine), (0.5 * speed, speed)).modes[0].damped_Hz
    text = (
        f"the elastic shaft of the machine file is wrong: {', '.join(wrong)}; first natural frequency"
        f" {first_Hz:.1f} Hz; `identify --out` writes it, and the rest is judged with it{_equivalents(found, name)[1]}"
    )
    value = {"first_mode_Hz": first_Hz, "stiffness_Nm_rad": values[STIFFNESS]}
    return Cause("elastic_shaft", text, value, p.sigma(STIFFNESS), STIFFNESS, _equivalents(found, name)[0])


def _rotor(found: Judged, name: str) -> Cause:
    p = found.posterior
    away, sigma = p.departure(ROTOR), p.sigma(ROTOR)
    text = (
        f"{away:.3g} +- {sigma:.2g} kg m2 turn with the shaft that are not in the model, as a motor's rotor or a"
        f" flywheel: add them under main_shaft of bodies in the machine file{_equivalents(found, ROTOR)[1]}"
    )
    if found.torque_by_speed_Nms:
        each = 1e-3 * found.torque_by_speed_Nms / found.settings.gain
        text += f"; the torque follows the speed here, and {each:.2g} kg m2 less for each ms that it is late look alike"
    return Cause("unmodelled_inertia", text, away, sigma, ROTOR, p.equivalents(ROTOR))


def _with_offset(found: Judged) -> bool:
    """True if the record determines only the sum of friction and the torque sensor's offset."""
    p = found.posterior
    return not (
        p.measurement.record.standstills or found.evidence.turns_in_both_directions() or OFFSET in p.off_nominal
    )


def _friction_departure(found: Judged, with_offset: bool = False) -> tuple[float, float]:
    """Departure of the friction at working speed from the configured one, and its standard deviation [N m].

    With the offset it is that of their sum, as if the offset were as configured.
    """
    p, speed = found.posterior, _speed(found)
    names, weights = [COULOMB, VISCOUS], [1.0, abs(speed)]
    if with_offset:
        names.append(OFFSET)
        gain = p.hypothesis.gain * gain_factor(p.value(GAIN))
        weights.append(math.copysign(1.0, speed) * p.hypothesis.unit / gain)
    w = np.array(weights)
    sigma = math.sqrt(max(float(w @ p.covariance(names) @ w), 0.0))
    return float(w @ np.array([p.departure(name) for name in names])), sigma


def _friction(found: Judged) -> Cause:
    p, summed = found.posterior, _with_offset(found)
    torque, sigma = _friction_departure(found, summed)
    if torque >= 0.0:
        text = f"friction of {torque:.2g} +- {sigma:.1g} N m at working speed is not in the model"
        if summed:
            text += " (or an offset of the torque sensor: a recording with a standstill would resolve it)"
    else:
        text = f"the model has {-torque:.2g} +- {sigma:.1g} N m more friction at working speed than the machine"
    name = VISCOUS if VISCOUS in p.off_nominal and COULOMB not in p.off_nominal else COULOMB
    return Cause("unmodelled_friction", text, torque, sigma, name, p.equivalents(name))


def _of_machine(found: Judged, name: str) -> Cause:
    """Cause for a wrong number of the machine file."""
    p = found.posterior
    known = p.parameter(name)
    value, sigma = found.posterior.value(name), found.posterior.sigma(name)
    other, more = _equivalents(found, name)
    away = f"{value:.4g} +- {sigma:.2g} {known.unit}".rstrip() + f" instead of {known.nominal:.4g}"
    text = f"{name} is wrong in the machine file: {away}{more}"
    relative = known.nominal != 0.0 and known.kind in ("force", "spring", "mass", "inertia", "length", "load")
    if relative:
        value, sigma = value / known.nominal, sigma / abs(known.nominal)
    return Cause(_CAUSES[known.kind], text, value, sigma, name, other)


def _changing(found: Judged, changing: ChangeInTime) -> Cause:
    """Cause for a force or a gain that changes within the record; its value is that at the end over the file's."""
    p = found.posterior
    known = p.parameter(changing.name)
    value, sigma, file = p.value(changing.name), p.sigma(changing.name), known.nominal
    if changing.name == GAIN:  # times the configured one
        value, file = p.hypothesis.gain / p.configured.gain * gain_factor(value), 1.0
        begin, end = (value * (1.0 + changing.away[k]) for k in (0, -1))
    else:
        begin, end = (value + changing.away[k] for k in (0, -1))
    unit = f" {known.unit}".rstrip()
    text = (
        f"{changing.name} changes within the recording, from {begin:.4g}{unit} at its beginning to"
        f" {end:.4g} +- {sigma:.2g}{unit} at its end, {'times the one' if changing.name == GAIN else f'{file:.4g}'}"
        " in the machine file"
    )
    text += f"; not distinguishable from {', '.join(changing.equivalents)}" if changing.equivalents else ""
    cause, scale = "torque_gain" if changing.name == GAIN else _CAUSES[known.kind], file or 1.0
    return Cause(cause, text, float(end) / scale, sigma / abs(scale), changing.name, changing.equivalents)


_ONE: dict[str, Callable[[Judged, str], Cause]] = {
    ZERO: _zero,
    DELAY: _delay,
    DRIFT: _drift,
    GAIN: _gain,
    OFFSET: _offset,
    ROTOR: _rotor,
    **dict.fromkeys(ECCENTRIC, _eccentricity),
    LOW_PASS: _low_pass,
    BUTTERWORTH: _low_pass,
    HIGH_PASS: _high_pass,
    **dict.fromkeys(OF_SHAFT, _shaft),
}
"""Words of each departure of sensors and friction; `_of_machine` has those of the machine's own numbers."""


def burst_verdict(timings: Sequence[StampTiming], causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Return the verdict with stamps in bursts first, and without the causes that wrong times may imitate."""
    if not timings:
        return tuple(causes)
    text = "; ".join(timing.text for timing in timings)
    advice = "; stamp samples where they are taken. Direction, sign, zero, delay and machine are not judged"
    first = Cause("stamps_in_bursts", text + advice, max(timing.bursts.period_s for timing in timings))
    return (first, *(cause for cause in causes if cause.cause not in NOT_JUDGED))


def quantities(found: Judged, verdict: Sequence[Cause]) -> tuple[Quantity, ...]:
    """Estimates of reportable quantities from the fit of the verdict, given the file's tolerances.

    Quantities named in the verdict are left out.
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
    late = h.delay_s + p.value(DELAY)
    delays = (DELAY, ZERO) if one_speed else (DELAY,)
    row(delays, "torque delay", late * 1e3, p.sigma(DELAY) * 1e3, " ms", p.configured.delay_s * 1e3, ".2f")
    factor = gain_factor(p.value(GAIN))
    row((GAIN,), "torque gain", h.gain * factor, abs(h.gain) * factor**2 * p.sigma(GAIN), "", p.configured.gain, ".4g")
    if HIGH_PASS not in h.filters:  # which blocks offset and dry friction
        offset, sigma = h.shown_offset(p.value(OFFSET)), h.unit * p.sigma(OFFSET)
        row((OFFSET,), "torque offset", offset, sigma, " N m", p.configured.offset_Nm, "+z.3f")
        file = p.parameter(COULOMB).nominal + abs(_speed(found)) * p.parameter(VISCOUS).nominal
        away, sigma = _friction_departure(found)
        row((COULOMB, VISCOUS), "friction at working speed", file + away, sigma, " N m", file, ".3f")
    for known in p.measurement.parameters:
        if known.kind == "force" or known.name in OF_SHAFT:
            unit, name = f" {known.unit}", known.name
            row((name,), name, p.value(name), p.sigma(name), unit, known.nominal, ".4g")
    said = {cause.parameter for cause in verdict}
    return tuple(Quantity(what, text) for names, what, text in rows if said.isdisjoint(names))
