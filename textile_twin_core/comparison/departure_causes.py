"""The cause for each departure of sensors, friction, shaft and machine, with its words and numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from textile_twin_core.comparison.cause import Cause
from textile_twin_core.comparison.change_in_time import ChangeInTime
from textile_twin_core.comparison.judged import Judged
from textile_twin_core.comparison.torque_readings import TimeLine
from textile_twin_core.driveline import elastic_shaft, find_resonances
from textile_twin_core.inference.elastic_torque import OF_SHAFT, STIFFNESS, with_shaft_values
from textile_twin_core.inference.parameter import (
    BUTTERWORTH,
    COULOMB,
    DELAY,
    DRIFT,
    ECCENTRIC,
    ECCENTRICITY,
    GAIN,
    HIGH_PASS,
    LOW_PASS,
    OFFSET,
    ROTOR,
    VISCOUS,
    ZERO,
    gain_factor,
)
from textile_twin_core.inference.torque_units import nearest_gain

_SAME = 0.05
"""Relative difference within which an offset in another unit equals the configured one."""
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


def departure_cause(found: Judged, name: str) -> Cause:
    """Return the cause for a departure of one parameter."""
    return _ONE.get(name, _of_machine)(found, name)


def amplitude(found: Judged, name: str) -> float:
    """Amplitude of the error of the angle in one order [rad]."""
    p = found.posterior
    return math.hypot(p.value(name), p.value(f"{name}.sine"))


def _eccentricity(found: Judged, name: str) -> Cause:
    p = found.posterior
    named = max((each for each in ECCENTRIC if each in p.off_nominal), key=lambda each: amplitude(found, each))
    size = amplitude(found, named)
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


def noise_cause(lines: Sequence[TimeLine]) -> Cause:
    """Return the cause for lines fixed in time, of which the first is the largest."""
    listed = ", ".join(f"{line.frequency_hz:.2f} Hz ({line.amplitude_Nm:.2g} N m)" for line in lines)
    text = f"the torque has noise that is periodic in time, not with the shaft, as mains hum: {listed}; it is left out"
    return Cause("periodic_noise", text, lines[0].frequency_hz)


def _high_pass(found: Judged, name: str) -> Cause:
    p = found.posterior
    corner, sigma = p.value(name), p.sigma(name)
    text = f"the torque's mean is blocked, as by AC coupling: high pass at {corner:.3g} +- {sigma:.2g} Hz"
    return Cause("torque_high_pass", text, corner, sigma, HIGH_PASS, _equivalents(found, name)[0])


def signed_speed(found: Judged) -> float:
    """Return the working speed in the direction of the machine [rad/s]."""
    return found.posterior.hypothesis.turn * found.evidence.working_speed()


def zero_departure(found: Judged) -> float:
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
    p, speed = found.posterior, signed_speed(found)
    if ZERO in p.off_nominal:
        return zero_departure(found), p.sigma(ZERO)
    return math.remainder(p.departure(DELAY) * speed, 2.0 * math.pi), p.sigma(DELAY) * abs(speed)


def _delay(found: Judged, name: str) -> Cause:
    if found.evidence.track.at_one_speed:
        return _zero_or_delay(found, name)
    p = found.posterior
    away, sigma = p.departure(DELAY), p.sigma(DELAY)
    size = f"{abs(away) * 1e3:.2f} +- {sigma * 1e3:.2f} ms"
    text = f"the torque lags by {size} {'more' if away >= 0.0 else 'less'} than the machine file says"
    if found.sensors.delay_s < 0.0:
        text += ", so it leads: stamped too early, or commanded and not measured"
    other, more = _equivalents(found, DELAY)
    return Cause("delay", text + _or_inertia(found, away) + more, away, sigma, DELAY, other)


def _or_inertia(found: Judged, delay_s: float) -> str:
    """Alternative to a delay under a speed-controlled drive, in words; empty without such a drive."""
    inertia = found.torque_by_speed_Nms * delay_s / found.sensors.gain
    if not inertia > 0.0:
        return ""
    return f", or {inertia:.2g} kg m2 that turn with it are not in the model, since the torque follows the speed here"


def at_one_speed(found: Judged) -> tuple[float, float]:
    """Zero [rad] and delay [s] of which each explains what both do, given the file exactly.

    At one speed only their sum is known; given its tolerances the file's lengths and phases would take a share of it.
    """
    late, ahead = found.settled.given_file(DELAY)[0], found.settled.given_file(ZERO)[0]
    speed = signed_speed(found)
    zero = _in_turn_of_encoder(found, ahead + late * speed)
    return zero, zero / speed if ahead else late


def _zero_or_delay(found: Judged, name: str) -> Cause:
    sigma = _as_zero(found)[1]
    zero, delay = at_one_speed(found)
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


def is_offset_in_unit(found: Judged) -> bool:
    """Return true if an offset is the configured one, expressed in the other unit of the logged torque."""
    p = found.posterior
    near = nearest_gain(p.hypothesis.gain, p.configured.gain)
    own = p.configured.offset_Nm * near.factor
    sigma = p.hypothesis.unit * p.sigma(OFFSET)
    return bool(near.unit) and abs(found.sensors.offset_Nm - own) < max(_SAME * abs(own), 4.0 * sigma)


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
        each = 1e-3 * found.torque_by_speed_Nms / found.sensors.gain
        text += f"; the torque follows the speed here, and {each:.2g} kg m2 less for each ms that it is late look alike"
    return Cause("unmodelled_inertia", text, away, sigma, ROTOR, p.equivalents(ROTOR))


def known_with_offset(found: Judged) -> bool:
    """True if the record determines only the sum of friction and the torque sensor's offset."""
    p = found.posterior
    return not (
        p.measurement.record.standstills or found.evidence.turns_in_both_directions() or OFFSET in p.off_nominal
    )


def friction_departure(found: Judged, with_offset: bool = False) -> tuple[float, float]:
    """Departure of the friction at working speed from the configured one, and its standard deviation [N m].

    With the offset it is that of their sum, as if the offset were as configured.
    """
    p, speed = found.posterior, signed_speed(found)
    names, weights = [COULOMB, VISCOUS], [1.0, abs(speed)]
    if with_offset:
        names.append(OFFSET)
        gain = p.hypothesis.gain * gain_factor(p.value(GAIN))
        weights.append(math.copysign(1.0, speed) * p.hypothesis.unit / gain)
    w = np.array(weights)
    sigma = math.sqrt(max(float(w @ p.covariance(names) @ w), 0.0))
    return float(w @ np.array([p.departure(name) for name in names])), sigma


def friction_cause(found: Judged) -> Cause:
    """Return the cause for friction at working speed."""
    p, summed = found.posterior, known_with_offset(found)
    torque, sigma = friction_departure(found, summed)
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


def change_cause(found: Judged, changing: ChangeInTime) -> Cause:
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
