"""A family: Kalman filters with one ripple model and different memories, weighted by their likelihoods.

Static multiple models (Magill 1965), with a share of switching probability, and restarts of filters that diverged.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import lanes, ripple
from textile_twin_core.shaft.clock import copy_numbers, dot, set_basis_at, set_second
from textile_twin_core.shaft.kalman import ROBUST, innovate, measurement_update
from textile_twin_core.shaft.status import MANOEUVRE, Record
from textile_twin_core.shaft.turns import TURN

SWITCH_PROBABILITY = 1e-3  # from one memory to another at each sample: motions change a few times in 1000 samples
UNIFORM_PART = 0.01  # of it goes to all memories alike, the rest by their use
USAGE_SAMPLES = 300.0  # over which a memory's probability is averaged as its use
RESTART_RATIO = math.exp(-10.0)  # likelihood ratio to the family since its peak: less restarts a filter (Page 1954)
RESTART_PROBABILITY = 0.01  # below which a filter may restart
FIRST_SCALE_WEIGHT = 0.1  # of the first noise scale, in innovations: it may be hundreds of times too large
SCALE_SAMPLES = 500.0  # innovations over which all is averaged that is learnt of their size
KNOWN_SCALE = 100.0  # innovations after which the first noise scale is found
RECENT_SAMPLES = 50.0  # the latest of them, whose scale takes over ..
FALLEN = 0.1, 0.03  # .. where it is such a part of the whole average, among the first SCALE_SAMPLES and later
YOUNG_CYCLES = 5.0  # in which what is known of the ripple may be no ripple ..
UNEVEN = 0.3  # .. unless the speed changes by such a part ..
MANY_READINGS = 63.0  # .. or a turn has fewer readings, too few to be too sure
RIPPLE_SIZE = 0.05  # prior standard deviation of the speed's ripple in each order, relative to the speed


@compiled_in_place
def set_shaft_second(status: Record, f: int) -> None:
    """Take the sensor's part of g1 out of g2, and so out of the shaft's state."""
    for i in range(4 * status.waves[f]):
        status.shaft_second[f, i] = status.second[f, i] - (status.sensor_ripple[f, i] if i < lanes.WIDEST else 0.0)


@compiled_in_place
def update_second_order(status: Record, f: int) -> None:
    """Recompute g2 from the best filter's ripple; all states shift as they would by a change of the coefficients."""
    width, change, second = 2 * status.waves[f], status.change, status.second[f]
    copy_numbers(second[:width], change)
    set_second(status.ripple[:, status.best[f]], status.waves[f], status.lowest, second)
    set_shaft_second(status, f)
    for i in range(width):
        change[i] = second[i] - change[i]
    for m in range(lanes.FIRST[f], lanes.END[f]):
        for row in range(3):
            status.clock[row, m] += dot(status.sensitivity[row, :, m], change, width)


@compiled_in_place
def _weigh_evenly(status: Record, f: int) -> None:
    """Make all memories of family `f` equally probable."""
    first, end = lanes.FIRST[f], lanes.END[f]
    for m in range(first, lanes.STOP[f]):
        status.probability[m] = status.usage[m] = 1.0 / (end - first) if m < end else 0.0
    status.best[f] = first


@compiled_in_place
def doubt_ripple(status: Record, f: int, begin: int) -> None:
    """Give the orders of family `f` from `begin` on their prior covariance, RIPPLE_SIZE; their values stay."""
    for m in range(lanes.FIRST[f], lanes.STOP[f]):
        root = math.sqrt(status.scale[m])
        for i in range(2 * begin, 2 * status.waves[f]):
            for j in range(i):
                status.factor[j, i, m] = 0.0
            status.factor[i, i, m] = RIPPLE_SIZE / (status.lowest * (i // 2 + 1)) / root


@compiled_in_place
def resize(status: Record, f: int, waves: int) -> None:
    """Model so many orders: states lose what they owe to those that are dropped, and owe nothing yet to those added."""
    before = status.waves[f]
    for m in range(lanes.FIRST[f], lanes.STOP[f]):
        for i in range(2 * min(waves, before), 2 * max(waves, before)):
            for row in range(3):
                if i >= 2 * waves:
                    status.clock[row, m] -= status.sensitivity[row, i, m] * status.ripple[i, m]
                status.sensitivity[row, i, m] = 0.0
            status.ripple[i, m] = 0.0
    status.waves[f], status.sensor_ripple[f, 2 * waves :] = waves, 0.0
    doubt_ripple(status, f, before)
    update_second_order(status, f)


@compiled_in_place
def begin_family(status: Record, f: int, known: int, source: int, waves: int) -> None:
    """Begin all filters of family `f`, of so many orders, from lane `source` of family `known`, with its ripple.

    A plain filter follows the shaft's angle: the state depends on the ripple that is to be found.
    """
    first, stop = lanes.FIRST[f], lanes.STOP[f]
    status.waves[f] = status.waves[known]
    copy_numbers(status.second[known], status.second[f])
    status.sensor_ripple[f, :] = status.doubt[f, :] = 0.0
    for m in range(first, stop):
        _restart_from(status, source, m, 2 * status.waves[known])
    _weigh_evenly(status, f)
    resize(status, f, waves)
    if known == lanes.PLAIN:
        set_basis_at(status, status.clock[lanes.ANGLE, source], waves)
        rate = status.clock[lanes.RATE, source]
        ripple.set_sensitivity(status.sensitivity, status.basis, status.lowest, rate, 2 * waves, first, stop)


@compiled_in_place
def open_manoeuvre(
    status: Record, row: Record, angle: float, rate: float, by_angle: float, by_rate: float, by_acceleration: float
) -> None:
    """Shift angle and rate of all filters, add to their covariance factors' diagonal, and predict the reading again.

    How even a motion was says nothing of a manoeuvre: all memories are equally probable then.
    """
    clock = status.clock
    for f in range(lanes.FAMILIES):
        if status.active[f] == 0.0:
            continue
        for m in range(lanes.FIRST[f], lanes.END[f]):
            root = math.sqrt(status.scale[m])
            clock[lanes.ANGLE, m] += angle
            clock[lanes.RATE, m] += rate
            clock[lanes.L22, m] += by_angle / root
            clock[lanes.L11, m] += by_rate / root
            clock[lanes.L00, m] += by_acceleration / root
        if row.cut == MANOEUVRE:
            _weigh_evenly(status, f)
        predict_reading(status, f, 0.0, row.reading, row.reading, row.unit)


@compiled_in_place
def predict_reading(status: Record, f: int, step: float, reading: float, at: float, noise: float) -> None:
    """Innovations and likelihoods of a reading `step` [s] after the last one, with the ripple evaluated at angle `at`.

    Where an innovation is too large, the filter's measurement variance is widened. The family's `density` is the
    reading's predictive density, but for the constant of Student's t.
    """
    set_basis_at(status, at, status.waves[f])
    reading += dot(status.second[f], status.basis, 4 * status.waves[f])
    width, first, stop = 2 * status.waves[f], lanes.FIRST[f], lanes.STOP[f]
    ripple.predict_ripple(
        status.sensitivity, status.ripple, status.factor, status.basis, status.regressor, status.projected_ripple,
        status.ripple_reading, status.ripple_variance, step, width, first, stop,
    )  # fmt: skip
    innovate(status, reading, noise, first, stop)
    status.density[f] = dot(status.probability[first:stop], status.likelihood[first:stop], stop - first)


@compiled_in_place
def update_filters(status: Record, f: int, noise: float, least_scale: float) -> None:
    """Measurement update of all filters by the latest reading, and of what it tells of them."""
    first, end = lanes.FIRST[f], lanes.END[f]
    measurement_update(status, first, lanes.STOP[f])
    if status.waves[f] > 0:
        ripple.update_ripple(
            status.sensitivity, status.ripple, status.factor, status.regressor, status.projected_ripple,
            status.innovation, status.clock_variance, status.gain, status.clock, status.parts, status.ripple_change,
            2 * status.waves[f], first, lanes.STOP[f],
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


@lanes.vectorised
def _weigh_filters(status: Record, f: int, noise: float, least_scale: float) -> None:
    """Update mode probabilities, and noise scales by the normalised innovation squared."""
    first, end = lanes.FIRST[f], lanes.END[f]
    probability, usage, likelihood_ratio = status.probability, status.usage, status.likelihood_ratio
    innovation, scale, scale_samples = status.innovation, status.scale, status.scale_samples
    recent_scale = status.recent_scale
    uniform, inverse = UNIFORM_PART / (end - first), 1.0 / status.density[f]
    likelihood, prior_variance = status.likelihood, status.prior_variance
    for m in range(np.uint64(first), np.uint64(lanes.STOP[f])):
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
    """Whether filters of long memory may be too sure of the ripple, so that shorter ones do not restart from them."""
    even = abs(abs(status.speed) - status.began[f]) < UNEVEN * status.began[f] and status.move * MANY_READINGS < TURN
    return status.waves[f] > 0 and even and status.travelled[f] * status.lowest < YOUNG_CYCLES * TURN


@compiled_in_place
def rescale(status: Record, change: float) -> None:
    """Divide the unit of variance by `change`: scales and factors keep the covariances that they stand for.

    So they do where the noise is another than the last time: what was learnt beside much noise is not better known
    beside little. Only while a filter's first scale is found its covariance goes with it.
    """
    for f in range(lanes.FAMILIES):
        end = lanes.END[f] if status.active[f] > 0.0 else lanes.FIRST[f]
        for m in range(lanes.FIRST[f], end):
            root = 1.0 / math.sqrt(change)
            if status.scale_samples[m] >= KNOWN_SCALE:
                root *= math.sqrt(status.scale_before[m] / status.scale[m])
            status.scale[m] *= change
            status.recent_scale[m] *= change
            status.scale_before[m] = status.scale[m]
            for row in range(lanes.L00, lanes.L22 + 1):
                status.clock[row, m] *= root
            for j in range(2 * status.waves[f]):
                for i in range(j, 2 * status.waves[f]):
                    status.factor[j, i, m] *= root


@compiled_in_place
def _restart_from(status: Record, source: int, target: int, width: int) -> None:
    """Copy state, ripple and noise scale from one lane to another."""
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
