"""Explain a record with as few differences from the configured settings as possible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.by_turn import scores_by_turn
from textile_twin_core.comparison.evidence import Evidence, Settings
from textile_twin_core.comparison.governed import torque_by_speed
from textile_twin_core.comparison.rest import rest_reading
from textile_twin_core.comparison.robust import huber_weights
from textile_twin_core.comparison.search import (
    AS_GOOD,
    RATIOS,
    BestFit,
    as_delay,
    search,
    what_can_vary,
    zero_beside,
    zero_departure,
)
from textile_twin_core.comparison.settings_fit import SettingsFit, fit_settings
from textile_twin_core.comparison.torque_units import nearest_gain
from textile_twin_core.comparison.uncertainty import Estimate

_WORTH = 0.01
"""A departure must lessen the mean square of the residual by this share to be kept,"""
_SIGMAS = 4.0
"""and lie this many standard deviations, taken over turns of the shaft, from the configured value."""
_LEAST = {"zero_rad": np.radians(0.3), "delay_s": 3e-4, "drift": 2e-5, "gain": 0.02, "load": 0.04}
ALL_SAMPLES = 60_000
"""Samples of which the last fit takes all; of longer records it takes so many."""
_SAME_EFFECT = 1e-9
"""Share of the mean square of its slopes that others may fail to make up when they can carry all that it carries."""
_FRICTION = ("constant_Nm", "viscous_Nms")
INERTIA = "inertia_kgm2"
_ROUNDING = 1e-6
"""Share of the torque below which an inertia explains the rounding of an exact record."""
_LEAST_TORQUE = 0.015  # of the measured torque's size, as torque


@dataclass(frozen=True)
class Explanation:
    """The record as these settings explain it.

    Attributes:
        configured: what the machine file says. settings: the likeliest, of what departs enough to be named.
        departing: the continuous settings that depart. sigma: their standard deviations, over turns of the shaft.
        fit: what is left when small departures are taken off too. others: discrete hypotheses that explain it as well.
        explained: share of the torque's mean square about its mean that is explained.
        one_speed: the shaft turns at one speed, so zero and delay are one.
        rest_tells: the record holds the shaft at rest, so that friction and the torque sensor's offset are two.
        apart: by setting, the factor by which the mean square rises when it alone is put back.
        governed_Nms: by how much the torque falls as the speed rises; not 0, delay and inertia are one.
        offset_at_rest: the torque sensor's offset where the shaft at rest tells it and friction apart from it.
        by_blocks: settled by means of blocks, which the errors of single accelerations do not reach.
    """

    configured: Settings
    settings: Settings
    departing: tuple[str, ...]
    sigma: dict[str, float]
    fit: SettingsFit
    others: tuple[BestFit, ...]
    explained: float
    one_speed: bool
    rest_tells: bool
    apart: dict[str, float]
    evidence: Evidence
    encoder_turn_rad: float
    offset_at_rest: Estimate | None
    governed_Nms: float = 0.0
    by_blocks: bool = False

    def departure(self, name: str) -> float:
        """By how much a setting departs from the configured one; a gain and a load as factor less one."""
        return departure(name, self.settings, self.configured, self.encoder_turn_rad)

    @property
    def weighed(self) -> Evidence:
        """The evidence by which it was settled."""
        return self.evidence.in_blocks(self.governed_Nms != 0.0) if self.by_blocks else self.evidence

    def is_better_than(self, other: Explanation) -> bool:
        """Whether it leaves clearly less by naming an inertia, or as little with fewer departures."""
        fine = self.weighed.thinned(ALL_SAMPLES)
        others = fit_settings(fine, other.fit.settings, other.fit.free)
        if AS_GOOD * self.fit.rms**2 < others.rms**2:
            return INERTIA in self.departing
        return self.fit.rms**2 < AS_GOOD * others.rms**2 and self.departures < other.departures

    @property
    def departures(self) -> int:
        """How many settings depart, discrete ones too; friction is one."""
        s, told = self.settings, self.configured
        near = nearest_gain(s.gain, told.gain)
        discrete = (s.direction != told.direction, s.ratio != told.ratio, near.sign < 0, bool(near.unit))
        friction = not set(_FRICTION).isdisjoint(self.departing)
        return sum(discrete) + friction + len(set(self.departing).difference(_FRICTION))


def explain(
    evidence: Evidence, configured: Settings, encoder_turn_rad: float, ratios: tuple[float, ...] = RATIOS
) -> Explanation | None:
    """The explanation of a record; None when the shaft does not turn or no sample can be used.

    Args:
        evidence: the record.
        configured: what the machine file says.
        encoder_turn_rad: shaft angle after which a wrapped encoder shows the same again, under the configured ratio.
        ratios: gear ratios to try, beside the configured one.
    """
    free = what_can_vary(evidence)
    found = _explained(evidence, configured, encoder_turn_rad, ratios, free)
    if found is None:
        return None
    turning, delays = evidence.in_blocks().thinned(ALL_SAMPLES), (found.settings.delay_s, configured.delay_s)
    rates = (torque_by_speed(turning, delay) for delay in delays)
    found = replace(found, governed_Nms=next((rate for rate in rates if rate), 0.0))
    if found.settings == configured:
        return found
    # A motor's rotor or a flywheel that the file does not have looks like a wrong sensor.
    same = "zero_rad" if found.one_speed else "delay_s"
    names = tuple(name for name in (*free, INERTIA) if not (found.governed_Nms and name == same))
    heavier = _explained(evidence.in_blocks(found.governed_Nms != 0.0), configured, encoder_turn_rad, ratios, names)
    if heavier is None:
        return found
    heavier = replace(heavier, governed_Nms=found.governed_Nms, evidence=evidence, by_blocks=True)
    return heavier if heavier.is_better_than(found) else found


def _explained(
    evidence: Evidence,
    configured: Settings,
    encoder_turn_rad: float,
    ratios: tuple[float, ...],
    free: tuple[str, ...],
) -> Explanation | None:
    """The explanation by the continuous settings named in `free`."""
    found = search(evidence, configured, encoder_turn_rad, ratios, free)
    if not found:
        return None
    fine = evidence.thinned()
    one_speed = evidence.track.at_one_speed
    fit = _spare(fine, found[0].fit, configured, encoder_turn_rad)
    if one_speed and "zero_rad" in fit.free:
        # At one speed a delay may be meant: what explains better what little tells them apart is taken for the rest.
        late = _spare(fine, as_delay(fine, found[0].fit, configured, free), configured, encoder_turn_rad)
        if late.rms < fit.rms:
            fit = late
    at_rest = rest_reading(evidence, fit.settings)
    if at_rest is None and "constant_Nm" in fit.free and fit.settings.constant_Nm < -evidence.terms.coulomb_Nm:
        # What helps the shaft on is no friction.
        fit = _as_offset(fine, fit, configured, encoder_turn_rad)
    elif at_rest is not None and _is_of_both(fit) and _is_shown(at_rest, evidence):
        fit = _with_offset_of_rest(fine, fit, configured, encoder_turn_rad, at_rest.value)
    # What departs is settled by every sample: what tells zero from delay are the few of run-ups and coast-downs.
    fine = evidence.thinned(ALL_SAMPLES)
    fit = fit_settings(fine, fit.settings, fit.free)
    torque = fit.measured[fit.good]
    unnamed = {name for name in fit.free if _is_small(name, fit.settings, configured, encoder_turn_rad, fine)}
    settings = fit.settings.changed(
        {name: _configured(name, fit.settings, configured, encoder_turn_rad) for name in unnamed}
    )
    departing, sigma, offset = tuple(name for name in fit.free if name not in unnamed), sigmas(fit), None
    if at_rest is not None and "offset_Nm" not in fit.free and fit.settings.offset_Nm != configured.offset_Nm:
        offset = at_rest.scaled(1.0, fit.settings.offset_Nm - at_rest.value)
        departing, sigma = (*departing, "offset_Nm"), sigma | {"offset_Nm": offset.sigma}
    alternatives = tuple(
        each
        for each in found[1:]
        if each.square < AS_GOOD * found[0].square
        and (each.fit.settings.direction, each.fit.settings.ratio, np.sign(each.fit.settings.gain))
        != (fit.settings.direction, fit.settings.ratio, np.sign(fit.settings.gain))
    )
    return Explanation(
        configured=configured,
        settings=settings,
        departing=departing,
        sigma=sigma,
        fit=fit,
        others=alternatives,
        explained=1.0 - fit.rms**2 / max(float(np.var(torque)), 1e-300),
        one_speed=one_speed,
        rest_tells=at_rest is not None,
        apart=_apart(fine, fit, configured, departing),
        evidence=evidence,
        encoder_turn_rad=encoder_turn_rad,
        offset_at_rest=offset,
    )


def departure(name: str, settings: Settings, configured: Settings, encoder_turn_rad: float) -> float:
    """By how much a setting departs from the configured one; gain and load as a factor less one."""
    if name == "zero_rad":
        return zero_departure(settings, configured, encoder_turn_rad)
    if name == "gain":
        return settings.gain / nearest_gain(settings.gain, configured.gain).gain - 1.0
    return float(getattr(settings, name) - getattr(configured, name))


def covariance_by_turns(fit: SettingsFit) -> FloatArray:
    """Covariance (k, k) of the freed settings that holds when residuals of a turn belong together.

    The sandwich estimator with turns of the shaft as clusters (Liang and Zeger 1986), which a bootstrap of whole turns
    comes to.
    """
    good = fit.good
    residual, jacobian = fit.residual[good], fit.jacobian[good]
    weight = huber_weights(residual, fit.scale)
    normal = (jacobian * weight[:, None]).T @ jacobian
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True) if normal.size else normal
    turns, place = np.unique(fit.turn[good], return_inverse=True)
    scores = scores_by_turn(jacobian, weight * residual, place)
    few = turns.size / max(turns.size - 1.0, 1.0)
    return np.asarray(few * inverse @ (scores.T @ scores) @ inverse)


def sigmas(fit: SettingsFit) -> dict[str, float]:
    """Standard deviations of the freed settings: the larger over turns of the shaft, or over samples on their own."""
    good = fit.good
    weighted = fit.jacobian[good] * huber_weights(fit.residual[good], fit.scale)[:, None]
    inverse = np.linalg.pinv(weighted.T @ fit.jacobian[good], rcond=1e-12, hermitian=True)
    alone = np.diag(inverse) * fit.rms**2
    return dict(zip(fit.free, np.sqrt(np.maximum(np.diag(covariance_by_turns(fit)), alone)).tolist(), strict=True))


def _spare(evidence: Evidence, fit: SettingsFit, configured: Settings, encoder_turn_rad: float) -> SettingsFit:
    """Put departures back to the configured values until every one that is left is needed.

    One that is needed stays, however small: without it the others would carry what it carries. Of several that can
    carry the same the one goes without which the fewest are needed.
    """
    while fit.free and fit.good.any():
        rise, together = _missed(fit, configured, encoder_turn_rad)
        delta = _deltas(fit, configured, encoder_turn_rad)
        sigma = np.array(list(sigmas(fit).values()))
        small = (np.abs(delta) < _SIGMAS * sigma) | (rise < _WORTH)
        if not small.any():
            break
        idle = np.flatnonzero(rise < 0.1 * _WORTH)
        if idle.size > 1 and together(idle) > _WORTH:
            # They share what is needed between them.
            tried = [_without(evidence, fit, [int(k)], configured, encoder_turn_rad) for k in idle]
            spared = [_spare(evidence, each, configured, encoder_turn_rad) for each in tried]
            return min(spared, key=lambda each: (each.rms**2 > AS_GOOD * fit.rms**2, len(each.free), each.rms))
        # The least missed goes first; the others may then carry what it carried.
        least = int(np.argmin(np.where(small, rise, np.inf)))
        fit = _without(evidence, fit, idle.tolist() or [least], configured, encoder_turn_rad)
    return fit


def _without(
    evidence: Evidence, fit: SettingsFit, gone: list[int], configured: Settings, encoder_turn_rad: float
) -> SettingsFit:
    """The fit with some of its departures, told by their places, put back."""
    names = [fit.free[k] for k in gone]
    back = {name: _configured(name, fit.settings, configured, encoder_turn_rad) for name in names}
    return fit_settings(evidence, fit.settings.changed(back), [name for name in fit.free if name not in names])


def _deltas(fit: SettingsFit, configured: Settings, encoder_turn_rad: float) -> FloatArray:
    """By how much each freed setting departs (k,)."""
    each = [_to_configured(name, fit.settings, configured, encoder_turn_rad) for name in fit.free]
    return np.array(each, dtype=np.float64)


def _missed(
    fit: SettingsFit, configured: Settings, encoder_turn_rad: float
) -> tuple[FloatArray, Callable[[IntArray], float]]:
    """By which share the mean square rises without each departure (k,) alone, and without several together.

    The others may carry what they can.
    """
    good = fit.good
    jacobian, residual = fit.jacobian[good], fit.residual[good]
    weight = huber_weights(residual, fit.scale)
    size = np.sqrt(np.mean(jacobian**2, axis=0)) + 1e-300
    scaled = jacobian / size
    normal = (scaled * weight[:, None]).T @ scaled
    normal[np.diag_indices_from(normal)] += _SAME_EFFECT * weight.sum()
    inverse = np.linalg.inv(normal)
    total = max(float(weight @ residual**2), 1e-300)
    delta = _deltas(fit, configured, encoder_turn_rad) * size

    def without(places: IntArray) -> float:
        back = delta[places]
        return float(back @ np.linalg.solve(inverse[np.ix_(places, places)], back)) / total

    return delta**2 / np.diag(inverse) / total, without


def _configured(name: str, settings: Settings, configured: Settings, encoder_turn_rad: float) -> float:
    """The value to which a setting goes back: of several that are as good the nearest."""
    if name == "zero_rad":
        return settings.zero_rad - zero_departure(settings, configured, encoder_turn_rad)
    if name == "gain":
        return nearest_gain(settings.gain, configured.gain).gain
    return float(getattr(configured, name))


def _to_configured(name: str, settings: Settings, configured: Settings, encoder_turn_rad: float) -> float:
    return float(getattr(settings, name)) - _configured(name, settings, configured, encoder_turn_rad)


def _is_small(name: str, settings: Settings, configured: Settings, encoder_turn_rad: float, evidence: Evidence) -> bool:
    """Whether a departure, of friction either part and both together, is too small to bother a person with."""
    away = abs(departure(name, settings, configured, encoder_turn_rad))
    if name in _LEAST:
        return bool(away < _LEAST[name])
    if name == INERTIA:  # less than declared is what errors of the acceleration look like
        torque = away * float(np.percentile(np.abs(evidence.track.alpha_rad_s2), 95.0))
        rounding = _ROUNDING * float(np.percentile(np.abs(evidence.torque_Nm), 95.0))
        return settings.inertia_kgm2 < configured.inertia_kgm2 or torque < rounding
    if name != "offset_Nm":
        constant, viscous = (departure(each, settings, configured, encoder_turn_rad) for each in _FRICTION)
        viscous *= abs(settings.ratio * evidence.working_speed())
        away = abs(settings.gain) * max(abs(constant), abs(viscous), abs(constant + viscous))
    return bool(away < _LEAST_TORQUE * float(np.percentile(np.abs(evidence.torque_Nm), 95.0)))


def _is_of_both(fit: SettingsFit) -> bool:
    """Whether a torque departs that friction and offset may share; a shaft held at rest alone accuses nobody."""
    return "offset_Nm" not in fit.free and not set(_FRICTION).isdisjoint(fit.free)


def _is_shown(at_rest: Estimate, evidence: Evidence) -> bool:
    """Whether what is shown at rest is enough to bother a person with."""
    size = float(np.percentile(np.abs(evidence.torque_Nm), 95.0))
    return abs(at_rest.value) >= max(_LEAST_TORQUE * size, _SIGMAS * at_rest.sigma)


def _with_offset_of_rest(
    evidence: Evidence, fit: SettingsFit, configured: Settings, encoder_turn_rad: float, offset_Nm: float
) -> SettingsFit:
    """What is shown at rest as the sensor's offset; what more there is while the shaft turns stays friction."""
    settings = fit.settings
    way = np.sign(settings.direction * evidence.working_speed())
    constant = settings.constant_Nm - offset_Nm * float(way) / settings.gain
    start = replace(settings, constant_Nm=constant, offset_Nm=settings.offset_Nm + offset_Nm)
    free = {*fit.free, "constant_Nm"}
    return _spare(evidence, fit_settings(evidence, start, free), configured, encoder_turn_rad)


def _as_offset(evidence: Evidence, fit: SettingsFit, configured: Settings, encoder_turn_rad: float) -> SettingsFit:
    """A constant torque as an offset of the sensor."""
    settings = fit.settings
    shown = settings.constant_Nm * settings.gain * np.sign(settings.direction * evidence.working_speed())
    start = replace(settings, constant_Nm=0.0, offset_Nm=settings.offset_Nm + float(shown))
    free = [name for name in fit.free if name != "constant_Nm"] + ["offset_Nm"]
    return _spare(evidence, fit_settings(evidence, start, free), configured, encoder_turn_rad)


def _apart(evidence: Evidence, fit: SettingsFit, configured: Settings, departing: tuple[str, ...]) -> dict[str, float]:
    """By setting, discrete ones too, the rise of the mean square when it alone goes back to what is configured."""
    rise: dict[str, float] = {}
    for name in (*departing, "direction", "ratio", "gain"):
        told = zero_beside(configured, fit.settings) if name == "zero_rad" else getattr(configured, name)
        if told == getattr(fit.settings, name):
            continue
        back = fit.settings.changed({name: told})
        left, good = evidence.left(back, evidence.states(back))
        rise[name] = float(np.mean(left[good] ** 2)) / max(fit.rms**2, 1e-300) if good.any() else np.inf
    return rise
