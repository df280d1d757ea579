"""The verdict: what is wrong with a record or its machine file, in words and numbers, likeliest first."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.comparison.explain import INERTIA, Explanation
from textile_twin_core.comparison.readings import AngleUnit, shown_turn
from textile_twin_core.comparison.torque_units import nearest_gain

FEWEST_ANGLES = 16.0
"""Angle samples a turn below which the orders that carry torque are not seen."""
NOT_THIS_MACHINE = 0.05
"""Share of the torque that the machine leaves unexplained and another machine could explain."""
_NOTHING_ELSE = 0.25
_SAME = 0.05
"""Part of an offset in another unit by which it may differ from the configured one."""
FOLLOWS_NOTHING = 0.5
"""Share of the torque that even the best function of the angle leaves unexplained."""


@dataclass(frozen=True)
class Cause:
    """One thing that is wrong.

    Attributes:
        cause: its name (see `causes` for the list). text: for a person, with the number.
        value: rad, s, N m, or a factor, by cause; a unit's name for units.
        sigma: standard deviation of the value, nan where there is none.
    """

    cause: str
    text: str
    value: float | str | dict[str, float]
    sigma: float = math.nan


def causes(explanation: Explanation, unit: AngleUnit, per_turn: float, periodic: float) -> list[Cause]:
    """Everything that is wrong, likeliest first.

    Args:
        explanation: the record explained.
        unit: of the logged angle.
        per_turn: angle samples in a turn at working speed.
        periodic: what any periodic torque could explain (see `best_periodic`).
    """
    found = [(rise, cause) for rise, cause in _departures(explanation)]
    found.sort(key=lambda each: -each[0])
    named = [cause for _, cause in found]
    if unit.name != "radians":
        text = (
            f"the angle is logged in {unit.name}, {shown_turn(unit.turn)} a turn, and is read as radians: --angle-unit"
            f" {unit.told}; for nodes angle_unit_rad {unit.to_radians:.10g}"
        )
        named.insert(0, Cause("angle_unit", text, unit.name))
    unexplained = 1.0 - explanation.explained
    if unexplained > _NOTHING_ELSE:
        named = []  # settings that were bent to fit another machine mean nothing
    if unexplained > NOT_THIS_MACHINE and per_turn >= FEWEST_ANGLES:
        named.insert(0, _other_machine(explanation, unexplained, 1.0 - periodic))
    if per_turn < FEWEST_ANGLES:
        text = f"the angle comes {per_turn:.1f} times a turn; a torque needs it at least {FEWEST_ANGLES:g} times"
        named.insert(0, Cause("angle_rate", text, per_turn))
    return named


def _other_machine(explanation: Explanation, unexplained: float, unexplained_by_any: float) -> Cause:
    share = 100.0 * min(unexplained, 1.0)
    left = f"{share:.0f} % of the torque's variance stays unexplained whatever the sensors' settings"
    if unexplained_by_any > FOLLOWS_NOTHING:
        text = (
            f"the torque does not follow this shaft: {left}; another shaft's sensor, another clock, a dead sensor, or a"
            " gear other than 1, 2, 3, 4 or one to that: give the encoder's ratio in the machine file"
        )
    elif unexplained - unexplained_by_any > NOT_THIS_MACHINE:
        text = f"not this machine: {left}, though the torque repeats with the shaft's angle"
    else:
        text = f"not this machine, or a sensor with much noise: {left}"
    return Cause("other_machine", text, 1.0 - unexplained)


def _departures(explanation: Explanation) -> list[tuple[float, Cause]]:
    """What departs from the machine file, each with the rise of the mean square when it is put back."""
    e, s, told = explanation, explanation.settings, explanation.configured
    rise = e.apart
    found: list[tuple[float, Cause]] = []
    if s.direction != told.direction:
        text = "the encoder counts against the direction that the machine file says"
        found.append((rise["direction"], Cause("encoder_direction", text, float(s.direction))))
    if s.ratio != told.ratio:
        text = f"the shaft turns {s.ratio / told.ratio:.4g} times as far as the machine file says: encoder ratio"
        found.append((rise["ratio"], Cause("encoder_ratio", text, s.ratio / told.ratio)))
    found += _gain(e)
    for name in e.departing:
        if name in ("zero_rad", "delay_s") and e.one_speed:
            found.append((rise[name], _zero_or_delay(e)))
        elif name in _ONE and not (name == "offset_Nm" and _is_offset_in_unit(e)):
            found.append((rise[name], _ONE[name](e)))
    if "constant_Nm" in e.departing or "viscous_Nms" in e.departing:
        found.append((max(rise.get(n, 0.0) for n in ("constant_Nm", "viscous_Nms")), _friction(e)))
    return found


def _gain(e: Explanation) -> list[tuple[float, Cause]]:
    told, found = e.configured.gain, []
    near = nearest_gain(e.settings.gain, told)
    rise = e.apart.get("gain", 1.0)
    if near.sign < 0:
        found.append((rise, Cause("torque_sign", "torque sign reversed: the gain is negative", -1.0)))
    if near.unit:
        text = f"the torque looks like {near.unit} instead of N m: {near.factor:.4g} times as large"
        found.append((rise, Cause("torque_unit", text, near.unit)))
    if "gain" in e.departing:
        factor = e.settings.gain / near.gain
        sigma = e.sigma["gain"] / abs(near.gain)
        text = f"torque gain {factor:.3f} +- {sigma:.3f} times the configured one"
        found.append((rise, Cause("torque_gain", text, factor, sigma)))
    return found


def _zero(e: Explanation) -> Cause:
    away, sigma = _as_zero(e)
    text = f"encoder zero {math.degrees(away):+.2f} +- {math.degrees(sigma):.2f} deg off, as angle of the shaft"
    if _is_turn_of_encoder(e, away):
        text = (
            f"encoder zero off by {math.degrees(away):+.1f} deg, a whole turn of the wrapped encoder: which part of the"
            " shaft's turn its first reading stands for must be settled after each start"
        )
    return Cause("encoder_zero", text, away, sigma)


def _as_zero(e: Explanation) -> tuple[float, float]:
    """The departure of the zero and its sigma, or of the delay as a zero [rad]."""
    if "zero_rad" in e.departing:
        return e.departure("zero_rad"), e.sigma["zero_rad"]
    speed = e.settings.direction * e.settings.ratio * e.evidence.working_speed()
    zero = float(np.remainder(e.departure("delay_s") * speed + np.pi, 2.0 * np.pi) - np.pi)
    return zero, e.sigma["delay_s"] * abs(speed)


def _is_turn_of_encoder(e: Explanation, zero_rad: float) -> bool:
    """Whether a zero is off by whole turns of a wrapped encoder that turns more often than the shaft."""
    turn = e.encoder_turn_rad
    near = abs(np.remainder(zero_rad + 0.5 * turn, turn) - 0.5 * turn) < 0.05 * turn
    return turn < 1.5 * math.pi and abs(zero_rad) > 0.5 * turn and bool(near)


def _delay(e: Explanation) -> Cause:
    away, sigma = e.departure("delay_s"), e.sigma["delay_s"]
    size = f"{abs(away) * 1e3:.2f} +- {sigma * 1e3:.2f} ms"
    text = f"the torque lags by {size} {'more' if away >= 0.0 else 'less'} than the machine file says"
    if e.settings.delay_s < 0.0:
        text += ", so it leads: stamped too early, or commanded and not measured"
    text += _or_inertia(e, away)
    return Cause("delay", text, away, sigma)


def _or_inertia(e: Explanation, delay_s: float) -> str:
    """What a delay may be instead under a controller of the speed; nothing where it is none."""
    inertia = e.governed_Nms * delay_s / e.settings.gain
    if not inertia > 0.0:
        return ""
    return f", or {inertia:.2g} kg m2 that turn with it are not in the model, since the torque follows the speed here"


def _zero_or_delay(e: Explanation) -> Cause:
    speed = e.settings.direction * e.settings.ratio * e.evidence.working_speed()
    zero, sigma = _as_zero(e)
    if _is_turn_of_encoder(e, zero):
        return _zero(e)
    delay = e.departure("delay_s") if "delay_s" in e.departing else zero / speed
    text = (
        f"zero or delay: {math.degrees(zero):+.1f} deg or {delay * 1e3:.1f} ms{_or_inertia(e, delay)};"
        " the shaft turns at one speed here, a recording with a run-up would tell"
    )
    return Cause("zero_or_delay", text, {"zero_rad": zero, "delay_s": delay}, sigma)


def _drift(e: Explanation) -> Cause:
    away, sigma = e.departure("drift"), e.sigma["drift"]
    text = f"the clocks of angle and torque drift apart by {away * 1e6:.0f} +- {sigma * 1e6:.0f} us each second"
    return Cause("clocks_drift", text, away, sigma)


def _offset(e: Explanation) -> Cause:
    away, sigma = e.departure("offset_Nm"), e.sigma["offset_Nm"]
    return Cause(
        "torque_offset", f"torque offset {away:+.3g} +- {sigma:.2g} N m beside the configured one", away, sigma
    )


def _is_offset_in_unit(e: Explanation) -> bool:
    """Whether an offset is the configured one in the other unit that the torque was logged in."""
    near = nearest_gain(e.settings.gain, e.configured.gain)
    own = e.configured.offset_Nm * near.factor
    return bool(near.unit) and abs(e.settings.offset_Nm - own) < max(_SAME * abs(own), 4.0 * e.sigma["offset_Nm"])


def _load(e: Explanation) -> Cause:
    factor, sigma = e.settings.load / e.configured.load, e.sigma["load"]
    text = f"the loads are {factor:.3f} +- {sigma:.3f} times those of the machine file"
    return Cause("load_force", text, factor, sigma)


def _inertia(e: Explanation) -> Cause:
    away, sigma = e.departure(INERTIA), e.sigma[INERTIA]
    text = (
        f"{away:.3g} +- {sigma:.2g} kg m2 turn with the shaft that are not in the model, as a motor's rotor or a"
        " flywheel: add them under main_shaft of bodies in the machine file"
    )
    if e.governed_Nms:
        each = 1e-3 * e.governed_Nms / e.settings.gain
        text += f"; the torque follows the speed here, and {each:.2g} kg m2 less for each ms that it is late look alike"
    return Cause("unmodelled_inertia", text, away, sigma)


_ONE = {
    "zero_rad": _zero,
    "delay_s": _delay,
    "drift": _drift,
    "offset_Nm": _offset,
    "load": _load,
    INERTIA: _inertia,
}


def _friction(e: Explanation) -> Cause:
    speed = abs(e.settings.ratio * e.evidence.working_speed())
    constant, rate = e.departure("constant_Nm"), e.departure("viscous_Nms")
    torque = constant + rate * speed
    sigma = math.hypot(e.sigma.get("constant_Nm", 0.0), speed * e.sigma.get("viscous_Nms", 0.0))
    if torque >= 0.0:
        text = f"friction of about {torque:.2g} N m at working speed is not in the model"
        if "viscous_Nms" not in e.departing and not e.rest_tells:
            text += " (or an offset of the torque sensor: a recording with the shaft at rest would tell)"
    else:
        text = f"the model has about {-torque:.2g} N m more friction at working speed than the machine"
    return Cause("unmodelled_friction", text, torque, sigma)
