"""Filter bank of one ripple model: Kalman filters with different memories, weighted by their likelihoods.

Static multiple models (Magill 1965) with a small probability of switching, and restarts of filters that diverged.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import layout, ripple
from textile_twin_core.shaft.constants import (
    FALLEN,
    KNOWN_SCALE,
    MANY_READINGS,
    MEMORY_SWITCH,
    RECENT_SAMPLES,
    RESTART_PROBABILITY,
    RESTART_RATIO,
    RIPPLE_SIZE,
    ROBUST,
    SCALE_SAMPLES,
    UNEVEN,
    UNIFORM_PART,
    USAGE_SAMPLES,
    YOUNG_CYCLES,
)
from textile_twin_core.shaft.kalman import innovate, measurement_update
from textile_twin_core.shaft.ripple import copy_numbers, dot, set_basis_at, set_second
from textile_twin_core.shaft.status import MANOEUVRE, Bank, FilterRow, Filters, Models
from textile_twin_core.shaft.turns import TURN


@compiled_in_place
def set_shaft_second(models: Models, f: int) -> None:
    """Remove the sensor's part of g1 from g2, and so from the shaft's state."""
    for i in range(4 * models.waves[f]):
        sensors = models.sensor_ripple[f, i] if i < layout.WIDEST else 0.0
        models.shaft_second[f, i] = models.second[f, i] - sensors


@compiled_in_place
def update_second_order(bank: Bank, f: int) -> None:
    """Recompute g2 from the best filter's ripple and shift all states by the change of its coefficients."""
    filters, models, change = bank.filters, bank.models, bank.wave.change
    width, second = 2 * models.waves[f], models.second[f]
    copy_numbers(second[:width], change)
    set_second(filters.ripple[:, models.best[f]], models.waves[f], bank.wave.lowest, second)
    set_shaft_second(bank.models, f)
    for i in range(width):
        change[i] = second[i] - change[i]
    for m in range(layout.FIRST[f], layout.END[f]):
        for row in range(3):
            filters.clock[row, m] += dot(filters.sensitivity[row, :, m], change, width)


@compiled_in_place
def _reset_probabilities(filters: Filters, models: Models, f: int) -> None:
    """Make all memories of model `f` equally probable."""
    first, end = layout.FIRST[f], layout.END[f]
    for m in range(first, layout.STOP[f]):
        filters.probability[m] = filters.usage[m] = 1.0 / (end - first) if m < end else 0.0
    models.best[f] = first


@compiled_in_place
def reset_ripple_covariance(bank: Bank, f: int, begin: int) -> None:
    """Reset the orders of model `f` from `begin` on to their prior covariance, RIPPLE_SIZE; keep their values."""
    for m in range(layout.FIRST[f], layout.STOP[f]):
        root = math.sqrt(bank.filters.scale[m])
        for i in range(2 * begin, 2 * bank.models.waves[f]):
            for j in range(i):
                bank.filters.factor[j, i, m] = 0.0
            bank.filters.factor[i, i, m] = RIPPLE_SIZE / (bank.wave.lowest * (i // 2 + 1)) / root


@compiled_in_place
def resize(bank: Bank, f: int, waves: int) -> None:
    """Set the number of modelled orders.

    Remove the contribution of dropped orders from the states; new orders start at zero.
    """
    before = bank.models.waves[f]
    for m in range(layout.FIRST[f], layout.STOP[f]):
        for i in range(2 * min(waves, before), 2 * max(waves, before)):
            for row in range(3):
                if i >= 2 * waves:
                    bank.filters.clock[row, m] -= bank.filters.sensitivity[row, i, m] * bank.filters.ripple[i, m]
                bank.filters.sensitivity[row, i, m] = 0.0
            bank.filters.ripple[i, m] = 0.0
    bank.models.waves[f], bank.models.sensor_ripple[f, 2 * waves :] = waves, 0.0
    reset_ripple_covariance(bank, f, before)
    update_second_order(bank, f)


@compiled_in_place
def begin_model(bank: Bank, f: int, known: int, source: int, waves: int) -> None:
    """Start all filters of model `f`, with `waves` orders, from filter `source` of model `known`, with its ripple.

    A plain filter follows the shaft's angle, so its state depends on the new ripple.
    """
    filters, first, stop = bank.filters, layout.FIRST[f], layout.STOP[f]
    bank.models.waves[f] = bank.models.waves[known]
    copy_numbers(bank.models.second[known], bank.models.second[f])
    bank.models.sensor_ripple[f, :] = bank.models.uncertain_power[f, :] = 0.0
    for m in range(first, stop):
        _restart_from(filters, source, m, 2 * bank.models.waves[known])
    _reset_probabilities(bank.filters, bank.models, f)
    resize(bank, f, waves)
    if known == layout.PLAIN:
        set_basis_at(bank.wave, filters.clock[layout.ANGLE, source], waves)
        rate = filters.clock[layout.RATE, source]
        ripple.set_sensitivity(filters.sensitivity, bank.wave.basis, bank.wave.lowest, rate, 2 * waves, first, stop)


@compiled_in_place
def open_manoeuvre(
    bank: Bank, row: FilterRow, angle: float, rate: float, by_angle: float, by_rate: float, by_acceleration: float
) -> None:
    """Shift angle and rate of all filters, inflate their covariance factors, and predict the reading again.

    The evenness of the motion before a manoeuvre predicts nothing, so all memories become equally probable.
    """
    filters, models, clock = bank.filters, bank.models, bank.filters.clock
    for f in range(layout.MODELS):
        if models.active[f] == 0.0:
            continue
        for m in range(layout.FIRST[f], layout.END[f]):
            root = math.sqrt(filters.scale[m])
            clock[layout.ANGLE, m] += angle
            clock[layout.RATE, m] += rate
            clock[layout.L22, m] += by_angle / root
            clock[layout.L11, m] += by_rate / root
            clock[layout.L00, m] += by_acceleration / root
        if row.cut == MANOEUVRE:
            _reset_probabilities(filters, models, f)
        predict_reading(bank, f, 0.0, row.reading, row.reading, row.unit)


@compiled_in_place
def predict_reading(bank: Bank, f: int, step: float, reading: float, at: float, noise: float) -> None:
    """Set innovations and likelihoods of a reading `step` [s] after the last one, the ripple evaluated at angle `at`.

    A filter whose innovation is too large gets a larger measurement variance. The model's `density` is the predictive
    density of the reading, up to the constant of Student's t.
    """
    filters, models, wave = bank.filters, bank.models, bank.wave
    set_basis_at(wave, at, models.waves[f])
    reading += dot(models.second[f], wave.basis, 4 * models.waves[f])
    width, first, stop = 2 * models.waves[f], layout.FIRST[f], layout.STOP[f]
    ripple.predict_ripple(
        filters.sensitivity, filters.ripple, filters.factor, wave.basis, filters.regressor, filters.projected_ripple,
        filters.ripple_reading, filters.ripple_variance, step, width, first, stop,
    )  # fmt: skip
    innovate(filters, reading, noise, first, stop)
    models.density[f] = dot(filters.probability[first:stop], filters.likelihood[first:stop], stop - first)


@compiled_in_place
def update_filters(bank: Bank, f: int, noise: float, least_scale: float, speed: float, move: float) -> None:
    """Update all filters of a model with the latest reading: states, ripple, probabilities, noise scales, restarts.

    `speed` [rad/s] is the shaft's, `move` [rad] its mean move between readings.
    """
    filters, models, first, end = bank.filters, bank.models, layout.FIRST[f], layout.END[f]
    measurement_update(filters, first, layout.STOP[f])
    if models.waves[f] > 0:
        ripple.update_ripple(
            filters.sensitivity, filters.ripple, filters.factor, filters.regressor, filters.projected_ripple,
            filters.innovation, filters.clock_variance, filters.gain, filters.clock, filters.parts,
            filters.ripple_change, 2 * models.waves[f], first, layout.STOP[f],
        )  # fmt: skip
    _weigh_filters(filters, f, models.density[f], noise, least_scale)
    probability, likelihood_ratio, best = filters.probability, filters.likelihood_ratio, first
    for m in range(first, end):
        if probability[m] > probability[best]:
            best = m
    models.best[f] = best
    for m in range(best if _is_young(bank, f, speed, move) else first, end):
        if likelihood_ratio[m] < RESTART_RATIO and probability[m] < RESTART_PROBABILITY and m != best:
            _restart_from(filters, best, m, 2 * models.waves[f])


@layout.vectorised
def _weigh_filters(filters: Filters, f: int, density: float, noise: float, least_scale: float) -> None:
    """Update filter probabilities, and noise scales by the normalised innovation squared."""
    first, end = layout.FIRST[f], layout.END[f]
    probability, usage, likelihood_ratio = filters.probability, filters.usage, filters.likelihood_ratio
    innovation, scale, scale_samples = filters.innovation, filters.scale, filters.scale_samples
    recent_scale = filters.recent_scale
    uniform, inverse = UNIFORM_PART / (end - first), 1.0 / density
    likelihood, prior_variance = filters.likelihood, filters.prior_variance
    for m in range(np.uint64(first), np.uint64(layout.STOP[f])):
        ratio = likelihood[m] * inverse
        share = uniform + (1.0 - UNIFORM_PART) * usage[m] if m < np.uint64(end) else 0.0
        probability[m] = (1.0 - MEMORY_SWITCH) * probability[m] * ratio + MEMORY_SWITCH * share
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
def _is_young(bank: Bank, f: int, speed: float, move: float) -> bool:
    """Return whether filters of long memory may be too certain of the ripple, which then seed no shorter filter."""
    models = bank.models
    even = abs(abs(speed) - models.start_speed[f]) < UNEVEN * models.start_speed[f] and move * MANY_READINGS < TURN
    return models.waves[f] > 0 and even and models.travelled[f] * bank.wave.lowest < YOUNG_CYCLES * TURN


@compiled_in_place
def rescale(bank: Bank, change: float) -> None:
    """Divide the unit of variance by `change`; scales and factors keep the covariances that they represent.

    A change of the noise leaves covariances as they are: large noise in the past makes nothing better known when the
    noise becomes small. The covariance follows the noise only while a filter's first scale is being estimated.
    """
    filters, models = bank.filters, bank.models
    for f in range(layout.MODELS):
        end = layout.END[f] if models.active[f] > 0.0 else layout.FIRST[f]
        for m in range(layout.FIRST[f], end):
            root = 1.0 / math.sqrt(change)
            if filters.scale_samples[m] >= KNOWN_SCALE:
                root *= math.sqrt(filters.scale_before[m] / filters.scale[m])
            filters.scale[m] *= change
            filters.recent_scale[m] *= change
            filters.scale_before[m] = filters.scale[m]
            for row in range(layout.L00, layout.L22 + 1):
                filters.clock[row, m] *= root
            for j in range(2 * models.waves[f]):
                for i in range(j, 2 * models.waves[f]):
                    filters.factor[j, i, m] *= root


@compiled_in_place
def _restart_from(filters: Filters, source: int, target: int, width: int) -> None:
    """Copy state, ripple and noise scale from one filter to another."""
    copy_numbers(filters.clock[:, source], filters.clock[:, target])
    for i in range(width):
        filters.ripple[i, target] = filters.ripple[i, source]
        for row in range(3):
            filters.sensitivity[row, i, target] = filters.sensitivity[row, i, source]
        for j in range(i + 1):
            filters.factor[j, i, target] = filters.factor[j, i, source]
    filters.scale[target], filters.scale_samples[target] = filters.scale[source], filters.scale_samples[source]
    filters.recent_scale[target] = filters.recent_scale[source]
    filters.scale_before[target] = filters.scale_before[source]
    filters.likelihood_ratio[target] = 1.0
