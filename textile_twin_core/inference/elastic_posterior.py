"""Posterior of a record whose machine has an elastic shaft: the shaft is fitted with sensors, loads and bodies.

The observer predicts the torque; Gauss-Newton's steps are linear about one prediction, which is made again at each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline.drive_bank import MEMORIES
from textile_twin_core.inference.elastic_torque import DAMPING, OF_SHAFT, STIFFNESS, ElasticTorque
from textile_twin_core.inference.map_fit import map_fit
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import BESIDE, DELAY, GAIN, OFFSET, ZERO
from textile_twin_core.inference.posterior import Posterior
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.record_posterior import infer, measurement_of
from textile_twin_core.inference.starts import hypotheses

TURN = 2.0 * math.pi
_FACTORS = np.exp(np.arange(-0.24, 0.241, 0.02))
"""Stiffnesses tried over the configured one: 2 % apart, since the minimum about the true one is narrow."""
_DAMPINGS = (0.5, 0.7, 1.4, 2.0)
"""Dampings tried over the configured one, at the best stiffness."""
_SCAN_READINGS, _SCAN_SAMPLES = 6000, 1000
"""Readings at the end, and torques among them, with which these are tried."""
_ZEROS_RAD = TURN * np.arange(-180, 180) / 360.0
_DELAYS_S = np.arange(-0.04, 0.0401, 5e-4)
_STEPS, _STILL = 8, 0.2
"""Most steps of the fit; largest change, in standard deviations, after the last one."""
_SHORTEST = 0.1
"""Share of a step from which it is not halved any more."""
_MEMORIES = 2
"""Times at which the filter of the observer's bank is chosen: far from the solution several are as good."""
_LONGEST = {STIFFNESS: 0.02, DAMPING: 0.3}
"""Longest step, over the value: the width of a resonance."""
_REFINED = 2
"""Most repetitions of the search for departures, with the slopes at its result."""


def infer_elastic(
    record: Record, torque: ElasticTorque, configured: Hypothesis, begin: Callable[[str, float], object] | None = None
) -> Posterior | None:
    """Infer shaft, sensors, machine and departures from the file from one record.

    Args:
        record: torque samples of the turning shaft and its motion.
        torque: of the machine, by its observer, over the same time.
        configured: sensor settings of the file.
        begin: called at each stage.

    Returns:
        The posterior, or None without enough settled predictions.
    """
    say = begin or (lambda what, until: None)
    say("trying stiffnesses", 0.2)
    start = _start(record, torque, configured)
    if start is None:
        return None
    say("fitting the shaft", 0.5)
    predicted = torque.linearised(start, ())
    measurement = measurement_of(replace(record, predicted=predicted), torque.machine, configured)
    few = (ZERO, *BESIDE, *OF_SHAFT, *(p.name for p in torque.parameters.values() if p.kind == "force"))
    few = tuple(name for name in torque.names if name in few)
    values: Mapping[str, float] = start
    for _ in range(_MEMORIES):
        before = torque.memory
        torque.memory = _memory(measurement, torque, configured, values)
        if np.array_equal(before, torque.memory):
            break
        values = _converged(measurement, torque, configured, values, few)
    say("judging", 0.9)
    names, posterior = torque.names, None
    for _ in range(1 + _REFINED):
        predicted = torque.linearised(values, names)
        posterior = infer(replace(record, predicted=predicted), torque.machine, configured, (1.0,))
        if posterior is None:
            return None
        found = posterior.measurement.values(posterior.fit.x)
        sigma = np.sqrt(np.diag(posterior.fit.covariance))
        moved = max(abs(found[n] - predicted.about[n]) / sigma[posterior.measurement.place[n]] for n in predicted.about)
        if moved < 1.0:
            break
        values, names = found, tuple({*few, *(n for n in posterior.off_nominal if n in torque.names)})
    return posterior


def _start(record: Record, torque: ElasticTorque, configured: Hypothesis) -> dict[str, float] | None:
    """Stiffness, damping, and zero or delay that explain the middle of the record best, at any gain and offset."""
    count = torque.time_s.size
    rows = slice(max(count - _SCAN_READINGS, 0), count)
    known = torque.time_s[rows]
    time = record.time_s - configured.delay_s
    inside = np.flatnonzero((time > known[0]) & (time < known[-1]))
    if inside.size < _SCAN_SAMPLES // 10:
        return None
    inside = inside[np.linspace(0, inside.size - 1, min(_SCAN_SAMPLES, inside.size)).astype(np.int64)]
    time, shown = time[inside], record.torque_Nm[inside]
    theta = record.motion.at(known)[0] * configured.turn
    forward = math.copysign(1.0, float(theta[-1] - theta[0]))
    along = np.maximum.accumulate(forward * theta)
    here = np.interp(time, known, along)
    by_zero = np.stack([np.interp(here - forward * zero, along, known) for zero in _ZEROS_RAD])
    times = np.concatenate([by_zero] if record.one_speed else [by_zero, time - _DELAYS_S[:, None]])
    configured_shaft = {p.name: p.nominal for p in torque.of_shaft}

    def tried(values: Mapping[str, float]) -> tuple[float, int]:
        """Share of the torque's variance left, and number of the best shift."""
        predicted, _, settled, _ = torque.run(values, rows, 1)
        nearest = np.clip(np.searchsorted(known, times), 0, known.size - 1)
        good = settled[nearest]
        expected = np.interp(times, known, predicted)
        enough = good.sum(axis=1) > 0.5 * max(int(good.sum(axis=1).max()), 1)
        if not good.any():
            return math.inf, 0
        weight = good / np.maximum(good.sum(axis=1), 1)[:, None]
        x = expected - (weight * expected).sum(axis=1)[:, None]
        y = shown - (weight * shown).sum(axis=1)[:, None]
        common, square, power = ((weight * each).sum(axis=1) for each in (x * y, x * x, y * y))
        left = np.where(enough & (square > 0.0), 1.0 - common**2 / np.maximum(square * power, 1e-300), math.inf)
        k = int(np.argmin(left))
        return float(left[k]), k

    stiffness = configured_shaft[STIFFNESS]
    candidates = [{STIFFNESS: stiffness * factor} for factor in _FACTORS]
    found = [(*tried(values), values) for values in candidates]
    best = min(found, key=lambda each: each[0])
    if not math.isfinite(best[0]):
        return None
    if DAMPING in configured_shaft:
        more = [{**best[2], DAMPING: configured_shaft[DAMPING] * factor} for factor in _DAMPINGS]
        best = min([best, *((*tried(values), values) for values in more)], key=lambda each: each[0])
    _, k, values = best
    if k < _ZEROS_RAD.size:
        return {**values, ZERO: float(_ZEROS_RAD[k])}
    return {**values, DELAY: float(_DELAYS_S[k - _ZEROS_RAD.size])}


def _converged(
    measurement: Measurement,
    torque: ElasticTorque,
    configured: Hypothesis,
    start: Mapping[str, float],
    few: tuple[str, ...],
) -> Mapping[str, float]:
    """Step from one prediction to the next by the fits about them, until they stay; back where the residual grows."""
    best = (math.inf, start, start)  # residual, values, and the values that the fit about them proposes
    values, share = start, 1.0
    for _ in range(_STEPS):
        tried = _fit(measurement, torque, configured, values, few)
        if tried is not None and tried.residual < best[0]:
            best, share = (tried.residual, values, tried.proposed), 1.0
        else:
            share *= 0.5
        if (tried is not None and tried.moved < _STILL) or share < _SHORTEST:
            break
        _, here, there = best
        values = {
            name: here.get(name, value) + share * (value - here.get(name, value)) for name, value in there.items()
        }
    return best[1]


def _memory(
    measurement: Measurement, torque: ElasticTorque, configured: Hypothesis, values: Mapping[str, float]
) -> FloatArray:
    """The filter of the observer's bank whose torque explains the record best."""

    def residual(memory: FloatArray) -> float:
        torque.memory = memory
        fit = _fit(measurement, torque, configured, values, ())
        return math.inf if fit is None else fit.residual

    return min((np.array([each]) for each in MEMORIES), key=residual)


@dataclass(frozen=True)
class _Fitted:
    """Root mean square residual of a prediction; values by the fit about it, and their largest change in sigmas."""

    residual: float
    proposed: dict[str, float]
    moved: float


def _fit(
    measurement: Measurement,
    torque: ElasticTorque,
    configured: Hypothesis,
    values: Mapping[str, float],
    names: tuple[str, ...],
) -> _Fitted | None:
    """Fit sensors, friction, forces and shaft about one prediction, which has slopes by the named parameters."""
    predicted = torque.linearised(values, names)
    m = measurement.on(replace(measurement.record, predicted=predicted))
    fits = hypotheses(m, configured)
    if not fits:
        return None
    fit, sensors = fits[0], {GAIN, OFFSET, DELAY} - ({DELAY} if m.record.one_speed else set())
    here = np.where(np.isin(m.names, list(predicted.about)), m.start, fit.x)
    residual = map_fit(m, fit.hypothesis, here, sensors, free=sensors, iterations=4).rms
    proposed, moved = m.values(fit.x), 0.0
    for name, about in predicted.about.items():
        k, longest = m.place[name], _LONGEST[name] * about if name in _LONGEST else math.inf
        proposed[name] = about + float(np.clip(fit.x[k] - about, -longest, longest))
        if name in names:
            moved = max(moved, abs(proposed[name] - about) / math.sqrt(fit.covariance[k, k]))
    return _Fitted(residual, proposed, moved)
