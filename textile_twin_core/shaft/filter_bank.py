"""Filter bank of one ripple model: Kalman filters with different memories, weighted by their likelihoods.

Static multiple models (Magill 1965) with a small probability of switching, and restarts of filters that diverged.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import layout, ripple
from textile_twin_core.shaft.clock import copy_numbers, dot, set_basis_at, set_second
from textile_twin_core.shaft.kalman import ROBUST, innovate, measurement_update
from textile_twin_core.shaft.status import MANOEUVRE, Record
from textile_twin_core.shaft.turns import TURN

SWITCH_PROBABILITY = 1e-3  # from one memory to another at each sample: motions change a few times in 1000 samples
UNIFORM_PART = 0.01  # part of it for all memories alike; the remainder follows their use
USAGE_SAMPLES = 300.0  # samples over which a memory's probability is averaged as its use
# likelihood ratio to the model since its peak, below which a filter restarts (Page 1954)
RESTART_RATIO = math.exp(-10.0)
RESTART_PROBABILITY = 0.01  # probability below which a filter may restart
FIRST_SCALE_WEIGHT = 0.1  # weight of the first noise scale, in innovations: it may be hundreds of times too large
SCALE_SAMPLES = 500.0  # innovations over which noise scales and orders are averaged
KNOWN_SCALE = 100.0  # innovations after which the first noise scale counts as known
RECENT_SAMPLES = 50.0  # latest innovations, whose scale replaces the average ..
FALLEN = 0.1, 0.03  # .. where it is this part of the average: among the first SCALE_SAMPLES, and later
YOUNG_CYCLES = 5.0  # cycles in which an estimated ripple may still be no ripple ..
UNEVEN = 0.3  # .. unless the speed changes by this part ..
MANY_READINGS = 63.0  # .. or a turn has fewer readings than this, too few to be too certain
RIPPLE_SIZE = 0.05  # prior standard deviation of the speed's ripple in each order, relative to the speed


@compiled_in_place
def set_shaft_second(status: Record, f: int) -> None:
    """Remove the sensor's part of g1 from g2, and so from the shaft's state."""
    for i in range(4 * status.waves[f]):
        status.shaft_second[f, i] = status.second[f, i] - (status.sensor_ripple[f, i] if i < layout.WIDEST else 0.0)


@compiled_in_place
def update_second_order(status: Record, f: int) -> None:
    """Recompute g2 from the best filter's ripple and shift all states by the change of its coefficients."""
    width, change, second = 2 * status.waves[f], status.change, status.second[f]
    copy_numbers(second[:width], change)
    set_second(status.ripple[:, status.best[f]], status.waves[f], status.lowest, second)
    set_shaft_second(status, f)
    for i in range(width):
        change[i] = second[i] - change[i]
    for m in range(layout.FIRST[f], layout.END[f]):
        for row in range(3):
            status.clock[row, m] += dot(status.sensitivity[row, :, m], change, width)


@compiled_in_place
def _reset_probabilities(status: Record, f: int) -> None:
    """Make all memories of model `f` equally probable."""
    first, end = layout.FIRST[f], layout.END[f]
    for m in range(first, layout.STOP[f]):
        status.probability[m] = status.usage[m] = 1.0 / (end - first) if m < end else 0.0
    status.best[f] = first


@compiled_in_place
def reset_ripple_covariance(status: Record, f: int, begin: int) -> None:
    """Reset the orders of model `f` from `begin` on to their prior covariance, RIPPLE_SIZE; keep their values."""
    for m in range(layout.FIRST[f], layout.STOP[f]):
        root = math.sqrt(status.scale[m])
        for i in range(2 * begin, 2 * status.waves[f]):
            for j in range(i):
                status.factor[j, i, m] = 0.0
            status.factor[i, i, m] = RIPPLE_SIZE / (status.lowest * (i // 2 + 1)) / root


@compiled_in_place
def resize(status: Record, f: int, waves: int) -> None:
    """Set the number of modelled orders.

    Remove the contribution of dropped orders from the states; new orders start at zero.
    """
    before = status.waves[f]
    for m in range(layout.FIRST[f], layout.STOP[f]):
        for i in range(2 * min(waves, before), 2 * max(waves, before)):
            for row in range(3):
                if i >= 2 * waves:
                    status.clock[row, m] -= status.sensitivity[row, i, m] * status.ripple[i, m]
                status.sensitivity[row, i, m] = 0.0
            status.ripple[i, m] = 0.0
    status.waves[f], status.sensor_ripple[f, 2 * waves :] = waves, 0.0
    reset_ripple_covariance(status, f, before)
    update_second_order(status, f)


@compiled_in_place
def begin_model(status: Record, f: int, known: int, source: int, waves: int) -> None:
    """Start all filters of model `f`, with `waves` orders, from filter `source` of model `known`, with its ripple.

    A plain filter follows the shaft's angle, so its state depends on the new ripple.
    """
    first, stop = layout.FIRST[f], layout.STOP[f]
    status.waves[f] = status.waves[known]
    copy_numbers(status.second[known], status.second[f])
    status.sensor_ripple[f, :] = status.uncertain_power[f, :] = 0.0
    for m in range(first, stop):
        _restart_from(status, source, m, 2 * status.waves[known])
    _reset_probabilities(status, f)
    resize(status, f, waves)
    if known == layout.PLAIN:
        set_basis_at(status, status.clock[layout.ANGLE, source], waves)
        rate = status.clock[layout.RATE, source]
        ripple.set_sensitivity(status.sensitivity, status.basis, status.lowest, rate, 2 * waves, first, stop)


@compiled_in_place
def open_manoeuvre(
    status: Record, row: Record, angle: float, rate: float, by_angle: float, by_rate: float, by_acceleration: float
) -> None:
    """Shift angle and rate of all filters, inflate their covariance factors, and predict the reading again.

    The evenness of the motion before a manoeuvre predicts nothing, so all memories become equally probable.
    """
    clock = status.clock
    for f in range(layout.MODELS):
        if status.active[f] == 0.0:
            continue
        for m in range(layout.FIRST[f], layout.END[f]):
            root = math.sqrt(status.scale[m])
            clock[layout.ANGLE, m] += angle
            clock[layout.RATE, m] += rate
            clock[layout.L22, m] += by_angle / root
            clock[layout.L11, m] += by_rate / root
            clock[layout.L00, m] += by_acceleration / root
        if row.cut == MANOEUVRE:
            _reset_probabilities(status, f)
        predict_reading(status, f, 0.0, row.reading, row.reading, row.unit)


@compiled_in_place
def predict_reading(status: Record, f: int, step: float, reading: float, at: float, noise: float) -> None:
    """Set innovations and likelihoods of a reading `step` [s] after the last one, the ripple evaluated at angle `at`.

    A filter whose innovation is too large gets a larger measurement variance. The model's `density` is the predictive
    density of the reading, up to the constant of Student's t.
    """
    set_basis_at(status, at, status.waves[f])
    reading += dot(status.second[f], status.basis, 4 * status.waves[f])
    width, first, stop = 2 * status.waves[f], layout.FIRST[f], layout.STOP[f]
    ripple.predict_ripple(
        status.sensitivity, status.ripple, status.factor, status.basis, status.regressor, status.projected_ripple,
        status.ripple_reading, status.ripple_variance, step, width, first, stop,
    )  # fmt: skip
    innovate(status, reading, noise, first, stop)
    status.density[f] = dot(status.probability[first:stop], status.likelihood[first:stop], stop - first)


@compiled_in_place
def update_filters(status: Record, f: int, noise: float, least_scale: float) -> None:
    """Update all filters of a model with the latest reading: states, ripple, probabilities, noise scales, restarts."""
    first, end = layout.FIRST[f], layout.END[f]
    measurement_update(status, first, layout.STOP[f])
    if status.waves[f] > 0:
        ripple.update_ripple(
            status.sensitivity, status.ripple, status.factor, status.regressor, status.projected_ripple,
            status.innovation, status.clock_variance, status.gain, status.clock, status.parts, status.ripple_change,
            2 * status.waves[f], first, layout.STOP[f],
        )  # fmt: skip
    _weigh_filters(status, f, noise, least_scale)
    probability, likelihood_ratio, best = status.probability, status.likelihood_ratio, first
    for m in range(first, end):
        if probability[m] > probability[best]:
            best = m
    status.best[f] = best
    for m in range(best if _is_young(status, f) else first, end):
        if likelihood_ratio[m] < RESTART_RATIO and probability[m] < RESTART_PROBABILITY and m != best:
            _restart_from(status, best, m, 2 * status.waves[f])


@layout.vectorised
def _weigh_filters(status: Record, f: int, noise: float, least_scale: float) -> None:
    """Update filter probabilities, and noise scales by the normalised innovation squared."""
    first, end = layout.FIRST[f], layout.END[f]
    probability, usage, likelihood_ratio = status.probability, status.usage, status.likelihood_ratio
    innovation, scale, scale_samples = status.innovation, status.scale, status.scale_samples
    recent_scale = status.recent_scale
    uniform, inverse = UNIFORM_PART / (end - first), 1.0 / status.density[f]
    likelihood, prior_variance = status.likelihood, status.prior_variance
    for m in range(np.uint64(first), np.uint64(layout.STOP[f])):
        ratio = likelihood[m] * inverse
        share = uniform + (1.0 - UNIFORM_PART) * usage[m] if m < np.uint64(end) else 0.0
        probability[m] = (1.0 - SWITCH_PROBABILITY) * probability[m] * ratio + SWITCH_PROBABILITY * share
        usage[m] += (probability[m] - usage[m]) * (1.0 / USAGE_SAMPLES)
        ratio *= likelihood_ratio[m]
        likelihood_ratio[m] = ratio if ratio < 1.0 else 1.0
        squared = innovation[m] * innovation[m] / (scale[m] * (noise + prior_variance[m]))
        squared = squared if squared < ROBUST else ROBUST
        samples = scale_samples[m] + 1.0
        samples = samples if samples < SCALE_SAMPLES else SCALE_SAMPLES
        found = scale[m] * (1.0 + (squared - 1.0) / samples)
        recent = recent_scale[m] + (scale[m] * squared - recent_scale[m]) * (1.0 / RECENT_SAMPLES)
        if recent < (FALLEN[0] if samples < SCALE_SAMPLES else FALLEN[1]) * found:
            found = recent
        recent_scale[m] = recent if recent > least_scale else least_scale
        scale_samples[m], scale[m] = samples, found if found > least_scale else least_scale


@compiled_in_place
def _is_young(status: Record, f: int) -> bool:
    """Return whether filters of long memory may be too certain of the ripple, which then seed no shorter filter."""
    even = (
        abs(abs(status.speed) - status.start_speed[f]) < UNEVEN * status.start_speed[f]
        and status.move * MANY_READINGS < TURN
    )
    return status.waves[f] > 0 and even and status.travelled[f] * status.lowest < YOUNG_CYCLES * TURN


@compiled_in_place
def rescale(status: Record, change: float) -> None:
    """Divide the unit of variance by `change`; scales and factors keep the covariances that they represent.

    A change of the noise leaves covariances as they are: large noise in the past makes nothing better known when the
    noise becomes small. The covariance follows the noise only while a filter's first scale is being estimated.
    """
    for f in range(layout.MODELS):
        end = layout.END[f] if status.active[f] > 0.0 else layout.FIRST[f]
        for m in range(layout.FIRST[f], end):
            root = 1.0 / math.sqrt(change)
            if status.scale_samples[m] >= KNOWN_SCALE:
                root *= math.sqrt(status.scale_before[m] / status.scale[m])
            status.scale[m] *= change
            status.recent_scale[m] *= change
            status.scale_before[m] = status.scale[m]
            for row in range(layout.L00, layout.L22 + 1):
                status.clock[row, m] *= root
            for j in range(2 * status.waves[f]):
                for i in range(j, 2 * status.waves[f]):
                    status.factor[j, i, m] *= root


@compiled_in_place
def _restart_from(status: Record, source: int, target: int, width: int) -> None:
    """Copy state, ripple and noise scale from one filter to another."""
    copy_numbers(status.clock[:, source], status.clock[:, target])
    for i in range(width):
        status.ripple[i, target] = status.ripple[i, source]
        for row in range(3):
            status.sensitivity[row, i, target] = status.sensitivity[row, i, source]
        for j in range(i + 1):
            status.factor[j, i, target] = status.factor[j, i, source]
    status.scale[target], status.scale_samples[target] = status.scale[source], status.scale_samples[source]
    status.recent_scale[target] = status.recent_scale[source]
    status.scale_before[target] = status.scale_before[source]
    status.likelihood_ratio[target] = 1.0
