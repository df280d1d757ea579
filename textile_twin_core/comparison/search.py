"""Search the settings under which a record is likeliest: discrete hypotheses tried, continuous settings fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.comparison.evidence import Evidence, Settings
from textile_twin_core.comparison.settings_fit import SettingsFit, fit_settings, linear_start
from textile_twin_core.comparison.shaft_track import TURN

RATIOS = (1.0, 0.5, 2.0, 1.0 / 3.0, 3.0, 0.25, 4.0)
"""Gear ratios that are tried beside the configured one."""
_ZEROS = 72
_DELAYS = 48
_COARSE_SAMPLES = 2000
_KEPT_ZEROS = 3
LONGEST_DELAY_S = 1.0
AS_GOOD = 1.15
"""Discrete hypotheses whose mean square lies within this factor cannot be told apart by the record."""
_HOPEFUL = 25.0
_SOLVED = ("gain", "constant_Nm", "load", "inertia_kgm2")
"""Settings that are solved for at each zero that is tried,"""
_PHASE = ("zero_rad", "gain", "constant_Nm", "inertia_kgm2")
"""and with the zero of the few that are kept."""
_MOST_STARTS = 8


@dataclass(frozen=True)
class BestFit:
    """The likeliest settings of one discrete hypothesis; `late` those with its phase as a delay, where that is one.

    At one speed the two are as good, but for a run-up too steep to count as another speed.
    """

    fit: SettingsFit
    late: SettingsFit | None = None

    @property
    def square(self) -> float:
        """Mean square of the residual [N^2 m^2]."""
        return min(self.fit.rms, np.inf if self.late is None else self.late.rms) ** 2


def what_can_vary(evidence: Evidence) -> tuple[str, ...]:
    """The continuous settings that this record can weigh at all, zero and delay as one where the speed is one."""
    names = ["drift", "gain", "constant_Nm"]
    if evidence.terms.has_zero:
        names.insert(0, "zero_rad")
    if not evidence.track.at_one_speed:
        names += ["delay_s", "viscous_Nms"]
    if evidence.turns_both_ways():
        names.append("offset_Nm")
    if evidence.terms.has_load:
        names.append("load")
    return tuple(names)


def search(
    evidence: Evidence, configured: Settings, encoder_turn_rad: float, ratios: tuple[float, ...], free: tuple[str, ...]
) -> list[BestFit]:
    """Hypotheses of direction and ratio with their likeliest settings, those first that explain the record best.

    `free` are the continuous settings that may vary (see `what_can_vary`).

    Of hypotheses that are equally good, within `AS_GOOD`, the one with the fewest departures comes first.
    """
    coarse = evidence.thinned(_COARSE_SAMPLES)
    varied = not evidence.track.at_one_speed
    # At one speed a delay is a zero: so the zeros are scanned there, and then told from delays by the whole record.
    fast = evidence.thinned(_COARSE_SAMPLES, at_one_speed=True) if varied else coarse
    starts: list[tuple[float, Settings]] = []
    solved = tuple(name for name in free if name in _SOLVED)
    for ratio in ratios:
        for direction in (1, -1):
            base = replace(
                configured, direction=direction * configured.direction, ratio=ratio * configured.ratio, zero_rad=0.0
            )
            starts += _zeros(fast, base, zero_beside(configured, base), solved)
    hopeful = _hopeful(starts, configured, encoder_turn_rad)
    phase = [name for name in free if name in _PHASE]
    hopeful = [fit_settings(fast, settings, phase, iterations=5).settings for settings in hopeful]
    if "delay_s" in free:
        late = [_with_delay(coarse, settings, solved) for settings in hopeful]
        hopeful = _hopeful(late, configured, encoder_turn_rad)
    found = [BestFit(fit_settings(coarse, settings, free, iterations=12)) for settings in hopeful]
    found = _likeliest([each for each in found if np.isfinite(each.square)], configured, encoder_turn_rad)
    if not found:
        return []
    fine = evidence.thinned()
    best = [BestFit(fit_settings(fine, each.fit.settings, free)) for each in _distinct(found)[:4]]
    if not varied:
        best = [replace(each, late=as_delay(fine, each.fit, configured, free)) for each in best]
    return _likeliest(best, configured, encoder_turn_rad)


def as_delay(evidence: Evidence, fit: SettingsFit, configured: Settings, free: tuple[str, ...]) -> SettingsFit:
    """The same phase as a delay instead of a zero."""
    settings = fit.settings
    zero = zero_beside(configured, settings)
    away = np.remainder(settings.zero_rad - zero + np.pi, TURN) - np.pi
    speed = settings.direction * settings.ratio * evidence.working_speed()
    start = replace(settings, zero_rad=zero, delay_s=configured.delay_s + float(away) / speed)
    return fit_settings(evidence, start, ["delay_s" if name == "zero_rad" else name for name in free])


def _likeliest(found: list[BestFit], configured: Settings, encoder_turn_rad: float) -> list[BestFit]:
    """Those first that explain the record best, of those that are as good those with the fewest departures."""
    each = [(one.square, one.fit.settings) for one in found]
    return [found[k] for k in _order(each, configured, encoder_turn_rad)]


def _hopeful(starts: list[tuple[float, Settings]], configured: Settings, encoder_turn_rad: float) -> list[Settings]:
    """The settings of the few best starts, the likeliest first."""
    ranked = [starts[k] for k in _order(starts, configured, encoder_turn_rad)]
    most = _HOPEFUL * min(square for square, _ in starts) + 1e-300
    return [settings for square, settings in ranked[:_MOST_STARTS] if square <= most]


def _order(tried: list[tuple[float, Settings]], configured: Settings, encoder_turn_rad: float) -> list[int]:
    """Places of mean squares and their settings, the likeliest first: where nothing tells them apart, as configured."""
    least = min((square for square, _ in tried), default=0.0)

    def rank(place: int) -> tuple[bool, int, float]:
        square, settings = tried[place]
        return square > AS_GOOD * least, _departures(settings, configured, encoder_turn_rad), square

    return sorted(range(len(tried)), key=rank)


def _zeros(
    coarse: Evidence, base: Settings, configured_zero: float, solved: tuple[str, ...]
) -> list[tuple[float, Settings]]:
    """The best zeros of a hypothesis, and their mean squares."""
    others = TURN * np.arange(_ZEROS) / _ZEROS if coarse.terms.has_zero else np.empty(0)
    zeros = np.append(others, configured_zero)
    found = (_square(coarse, replace(base, zero_rad=float(zero)), solved) for zero in zeros)
    kept: list[tuple[float, Settings]] = []
    for square, settings in sorted(found, key=lambda each: each[0]):
        apart = [abs(np.remainder(settings.zero_rad - k.zero_rad + np.pi, TURN) - np.pi) for _, k in kept]
        if np.isfinite(square) and all(d > 2.5 * TURN / _ZEROS for d in apart):
            kept.append((square, settings))
        if len(kept) == _KEPT_ZEROS:
            break
    return kept


def _with_delay(coarse: Evidence, settings: Settings, solved: tuple[str, ...]) -> tuple[float, Settings]:
    """The best of delays within half a turn, the zero going along so that the phase at working speed stays."""
    speed = settings.direction * settings.ratio * coarse.working_speed()
    longest = min(LONGEST_DELAY_S, 0.5 * TURN / abs(speed))
    best = (np.inf, settings)
    for late in np.linspace(-longest, longest, 2 * _DELAYS + 1):
        delay = settings.delay_s + float(late)
        zero = settings.zero_rad - speed * float(late) if coarse.terms.has_zero else settings.zero_rad
        trial = replace(settings, delay_s=delay, zero_rad=zero)
        best = min(best, _square(coarse, trial, solved), key=lambda each: each[0])
    return best


def _square(coarse: Evidence, settings: Settings, solved: tuple[str, ...]) -> tuple[float, Settings]:
    """Mean square left when the settings named are solved for, and all settings with them."""
    start = linear_start(coarse, settings, solved)
    states = coarse.states(start)
    residual, good = coarse.left(start, states)
    if np.count_nonzero(good) < 0.3 * good.size:
        return np.inf, settings
    return float(np.mean(residual[good] ** 2)), start


def _distinct(found: list[BestFit]) -> list[BestFit]:
    """Without those that came to the same settings from another start."""
    kept: list[BestFit] = []
    for each in found:
        s = each.fit.settings
        if not any(_alike(s, other.fit.settings) for other in kept):
            kept.append(each)
    return kept


def _alike(a: Settings, b: Settings) -> bool:
    apart = abs(np.remainder(a.zero_rad - b.zero_rad + np.pi, TURN) - np.pi)
    same = a.direction == b.direction and a.ratio == b.ratio and a.gain * b.gain > 0.0
    return same and apart < 0.02


def zero_beside(configured: Settings, other: Settings) -> float:
    """The configured zero of the encoder, as shaft angle under another direction and ratio [rad]."""
    return configured.zero_rad * other.direction * other.ratio / (configured.direction * configured.ratio)


def zero_departure(settings: Settings, configured: Settings, encoder_turn_rad: float) -> float:
    """How far the zero is from the configured one, in shaft angle within half a turn [rad].

    Under another gear ratio a wrapped encoder's first reading does not tell its turn, so whole turns of the encoder
    (`encoder_turn_rad` of the shaft under the configured ratio) are no departure.
    """
    apart = settings.zero_rad - zero_beside(configured, settings)
    period = TURN
    if settings.ratio != configured.ratio:
        period = min(TURN, encoder_turn_rad * settings.ratio / configured.ratio)
    return float(np.remainder(apart + 0.5 * period, period) - 0.5 * period)


def _departures(s: Settings, configured: Settings, encoder_turn_rad: float) -> int:
    apart = abs(zero_departure(s, configured, encoder_turn_rad))
    return sum((s.direction != configured.direction, s.ratio != configured.ratio, s.gain < 0.0, apart > 0.05))
