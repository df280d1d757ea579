"""Discrete hypotheses: direction, gear ratio, half turns of the zero, sign and unit of the torque, with their odds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.elastic_torque import OF_SHAFT
from textile_twin_core.inference.map_fit import CLUSTERED, Fit, fit_with_prior_update
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    BESIDE,
    BUTTERWORTH,
    DELAY,
    GAIN,
    HELD,
    HIGH_PASS,
    LOW_PASS,
    ROTOR,
    SENSORS,
    START,
    ZERO,
    gain_factor,
    gain_value,
)
from textile_twin_core.inference.torque_units import nearest_gain

TURN = 2.0 * math.pi
RATIOS = (1.0, 0.5, 2.0, 1.0 / 3.0, 3.0, 0.25, 4.0)
"""Gear ratios that are tried beside the configured one."""
LOG_ODDS = {"direction": -3.0, "ratio": -4.6, "sign": -3.0, "unit": -3.5, "zero": -3.0}
"""Log odds of discrete mistakes; `zero`: one of more than a few degrees, which every hypothesis may need."""
_ZEROS, _APART_RAD, _KEPT = 72, 0.2, 3
"""Number of zeros scanned, least distance of those chosen, and their number."""
_DELAYS, _LONGEST_S = 49, 0.06
_SCAN, _COARSE, _FITTED = 1200, 1500, 3000
"""Samples of the scans over zeros and delays, and of the fits that rank the hypotheses."""
_NEAR_SPEED = 0.15
_PENALTY = 0.3
"""Share added to the mean square of a start for each mistake that it needs."""
_EXPLAINED = 0.2
"""Unexplained share of the torque's variance below which no other gear ratio is tried."""
_HOPEFUL, _SCANNED, _RANKED = 25.0, 8, 5
_WIDE_RAD = 0.1
_BESIDE_ZERO = 0.8
"""Share of the residual below which a delay beside the zero counts: in few turns the changes of speed show it."""
GAINS = 0.2, 20.0
"""Gains of the torque sensor, beside its unit, from which a fit may start."""
BLOCKING_HZ = 0.3
"""Corner from which the fit of a high pass starts that the file does not have."""
GROUP_DELAY = {LOW_PASS: 1.0, BUTTERWORTH: math.sqrt(2.0)}
"""Delay of a low pass at low frequencies, over its time constant."""
_Scaled = tuple[float, float]
"""Gain of the torque sensor, and added inertia [kg m2]."""
_TELLING = 10.0
"""Least inflation in the ranking of hypotheses, since their residuals follow the angle."""


def hypotheses(measurement: Measurement, configured: Hypothesis, ratios: tuple[float, ...] = RATIOS) -> list[Fit]:
    """Fit sensors, friction, inertia and forces under the likeliest discrete hypotheses, likeliest first."""
    free = {
        p.name for p in measurement.parameters if p.name in (*SENSORS, *BESIDE, HELD, *OF_SHAFT) or p.kind == "force"
    }
    if measurement.record.one_speed and measurement.model.depends_on_angle():
        free -= {DELAY}  # which is a zero there
    free |= configured.filters
    free |= {name for name in measurement.names if name.startswith(START)}
    coarse = measurement
    if (
        not measurement.record.block_s
    ):  # block averages are free of the errors of the acceleration; thinned samples are not
        coarse = measurement.on(measurement.record.thinned(_FITTED))
    coarse = coarse.with_slopes_by({*free, *CLUSTERED})
    found: list[Fit] = []
    for (factor, inertia), zero, delay, hypothesis in _starts(measurement, configured, ratios):
        low, high = GAINS
        near = nearest_gain(factor or 1e-3, configured.gain)
        if (
            not low <= abs(factor / near.gain) <= high
        ):  # no plausible gain: another unit, although the scan's factor is rough
            near = nearest_gain(factor or 1e-3, configured.gain, near=math.inf)
        hypothesis = replace(hypothesis, gain=near.gain, unit=near.factor)
        x = measurement.start
        x[measurement.place[ZERO]] = np.remainder(zero + np.pi, TURN) - np.pi
        x[measurement.place[DELAY]] = delay
        if HIGH_PASS in configured.filters:
            x[measurement.place[HIGH_PASS]] = measurement.nominal[measurement.place[HIGH_PASS]] or BLOCKING_HZ
        x[measurement.place[GAIN]] = gain_value(min(max(abs(factor / near.gain), low), high))
        x[measurement.place[ROTOR]] = max(inertia, 0.0)
        if np.count_nonzero(coarse.expected(hypothesis, x).good) < len(free):
            continue  # a high pass settles in no stretch of a record with gaps
        fit = fit_with_prior_update(coarse, hypothesis, x, free, free=free)
        if measurement.record.one_speed and DELAY not in free:
            beside = fit_with_prior_update(coarse, hypothesis, fit.x, free | {DELAY}, free=free | {DELAY})
            fit = beside if beside.rms < _BESIDE_ZERO * fit.rms else fit
        found.append(_in_nearest_unit(coarse, fit, configured))
    if not found:
        return []
    # one inflation for all, that of the best fit: a bad fit's own would make its residuals count less
    inflation = max(min(found, key=lambda fit: fit.rms).inflation, _TELLING)

    def score(fit: Fit) -> float:
        likelihood = -0.5 * fit.count / inflation * math.log(max(fit.rms, 1e-300) ** 2)
        return likelihood + _odds(fit, configured, measurement)

    return sorted(found, key=score, reverse=True)


def _in_nearest_unit(measurement: Measurement, fit: Fit, configured: Hypothesis) -> Fit:
    """Return the fit with its gain as a departure from the nearest unit."""
    k = measurement.place[GAIN]
    near = nearest_gain(fit.hypothesis.gain * gain_factor(float(fit.x[k])), configured.gain)
    if near.gain == fit.hypothesis.gain or near.gain * fit.hypothesis.gain <= 0.0:
        return fit
    x = fit.x.copy()
    x[k] = gain_value(fit.hypothesis.gain * gain_factor(float(fit.x[k])) / near.gain)
    return replace(fit, x=x, hypothesis=replace(fit.hypothesis, gain=near.gain, unit=near.factor))


def _odds(fit: Fit, configured: Hypothesis, measurement: Measurement) -> float:
    near = nearest_gain(fit.hypothesis.gain, configured.gain)
    ratio = abs(fit.hypothesis.turn / configured.turn)
    zero = abs(float(fit.x[measurement.place[ZERO]])) > 0.05
    wrong = {
        "direction": fit.hypothesis.turn * configured.turn < 0.0,
        "ratio": abs(ratio - 1.0) > 1e-9,
        "sign": near.sign < 0,
        "unit": bool(near.unit),
        "zero": zero,
    }
    return sum(LOG_ODDS[what] for what, is_so in wrong.items() if is_so)


def _starts(
    measurement: Measurement, configured: Hypothesis, ratios: tuple[float, ...]
) -> list[tuple[_Scaled, float, float, Hypothesis]]:
    """Gain and inertia, zero, delay and hypothesis of the few best starts."""
    if measurement.record.predicted is not None:
        return [_predicted_start(measurement, configured)]
    has_zero = measurement.model.depends_on_angle()
    fast = measurement.on(measurement.record.near_speed(_NEAR_SPEED, _SCAN))
    zeros = np.append(TURN * np.arange(_ZEROS) / _ZEROS - np.pi, 0.0) if has_zero else np.zeros(1)
    found: list[tuple[float, tuple[_Scaled, _Scaled], float, Hypothesis]] = []
    power = float(np.var(fast.record.torque_Nm))
    for ratio in ratios:
        if found and min(found, key=lambda each: each[0])[0] < _EXPLAINED * power:
            break
        for way in (1.0, -1.0):
            hypothesis = configured.turned(way * ratio)
            scan = _Scan(fast, hypothesis, 0.0)
            rows = sorted(((*scan.square(float(zero)), float(zero)) for zero in zeros), key=lambda each: each[0])
            kept: list[float] = []
            for square, gains, zero in rows:
                if all(abs(math.remainder(zero - other, TURN)) > _APART_RAD for other in kept):
                    kept.append(zero)
                    found.append((square, gains, zero, hypothesis))
                if len(kept) == _KEPT:
                    break

    def rank(each: tuple[float, tuple[_Scaled, _Scaled], float, Hypothesis]) -> float:
        square, gains, zero, hypothesis = each
        reversed_sign = all(gain * configured.gain < 0.0 for gain, _ in gains)
        mistakes = (hypothesis.turn != configured.turn) + reversed_sign + (abs(zero) > _WIDE_RAD)
        return square * (1.0 + _PENALTY * mistakes)

    found.sort(key=rank)
    found = [each for each in found if each[0] < _HOPEFUL * found[0][0] + 1e-300][:_SCANNED]
    coarse = measurement.on(measurement.record.thinned(_COARSE))
    delays = [0.0] if measurement.record.one_speed else np.linspace(-_LONGEST_S, _LONGEST_S, _DELAYS).tolist()
    best = []
    for _, _, zero, hypothesis in found:
        speed = hypothesis.turn * measurement.record.speed_rad_s if has_zero else 0.0
        tried = [(*_Scan(coarse, hypothesis, d).square(zero - speed * d), zero - speed * d, d) for d in delays]
        best.append((*min(tried, key=lambda each: each[0]), hypothesis))
    best.sort(key=lambda each: each[0])
    out = []
    for _, gains, zero, delay, hypothesis in best[:_RANKED]:
        # force, inertia and gain with similar effects may compensate each other with the wrong sign
        differ = gains[0][0] * gains[1][0] < 0.0
        out += [(each, zero, delay, hypothesis) for each in (gains if differ else gains[:1])]
    return out


def _predicted_start(measurement: Measurement, configured: Hypothesis) -> tuple[_Scaled, float, float, Hypothesis]:
    """Start at the values about which the torque of an elastic shaft is predicted, in the configured direction."""
    x = measurement.start
    values = measurement.values(x)
    seen = measurement.expected(configured, x)
    expected = (seen.torque_Nm - configured.offset_Nm)[seen.good] / (configured.gain * gain_factor(values[GAIN]))
    gain = float(np.polyfit(expected, measurement.record.torque_Nm[seen.good], 1)[0]) if np.ptp(expected) else 0.0
    return (gain, values[ROTOR]), values[ZERO], values[DELAY], configured


def _scaled(gain: float, shown_inertia: float) -> _Scaled:
    return float(gain), float(shown_inertia / gain) if gain else 0.0


class _Scan:
    """Mean square of the residual with gain, dry friction, inertia and force in the backing solved for, by zero."""

    def __init__(self, measurement: Measurement, hypothesis: Hypothesis, delay_s: float) -> None:
        self._model, self._values = measurement.model, measurement.values(measurement.nominal)
        self._table = measurement.model.table(self._values, measurement.model.nominal)
        # low passes act as a delay here, a high pass as an unknown offset
        late = delay_s + sum(
            lag * self._values[name] for name, lag in GROUP_DELAY.items() if name in hypothesis.filters
        )
        self._offset = HIGH_PASS in hypothesis.filters
        plain = replace(hypothesis, filters=frozenset())
        theta, omega, alpha, good = measurement.states(plain, self._values, late_s=late)[0]
        self._state = theta[good], omega[good], alpha[good]
        self._shown = measurement.record.torque_Nm[good] - hypothesis.offset_Nm
        self._forces = [p.name for p in measurement.parameters if p.kind == "force"]

    def square(self, zero_rad: float) -> tuple[float, tuple[_Scaled, _Scaled]]:
        """Mean square [N^2 m^2], and gain and inertia beside all others, and the gain beside friction alone."""
        theta, omega, alpha = self._state
        found = self._model.torque(self._values, (theta - zero_rad, omega, alpha), self._table, self._forces)
        columns = [found.torque_Nm, np.sign(omega), alpha, *(found.slopes[name] for name in self._forces)]
        if self._offset:
            columns.append(np.ones_like(theta))
        matrix: FloatArray = np.stack(columns, 1)
        normal = matrix.T @ matrix
        normal[np.diag_indices_from(normal)] *= 1.0 + 1e-8
        normal[np.diag_indices_from(normal)] += 1e-300
        sides = matrix.T @ self._shown
        solved = np.linalg.solve(normal, sides)
        plain = np.linalg.solve(normal[:2, :2], sides[:2])
        gains = _scaled(solved[0], solved[2]), _scaled(plain[0], 0.0)
        return float(self._shown @ self._shown - sides @ solved) / max(self._shown.size, 1), gains
