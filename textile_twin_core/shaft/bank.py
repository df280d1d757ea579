"""A family of Kalman filters with one clock and different memories, weighed by how well each foretold the readings.

Static multiple models (Magill 1965) with a fixed share of new probability (Herbster and Warmuth 1998), which goes to
the memories that had it of late (Bousquet and Warmuth 2002): where no blow ever came, two late stamps in a row are
none. But states are not mixed: where the states of the models are mixed at each step, as interacting multiple models
do (Blom and Bar-Shalom 1988), those of long memory are overwritten and never become sharp. Instead a filter that has
fallen behind begins again from the best one.
"""

from __future__ import annotations

import math

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.clock import known_part, set_basis, set_second
from textile_twin_core.shaft.kalman import ROBUST, innovate, measurement_update, time_update
from textile_twin_core.shaft.ripple import (
    correct_sensitivity,
    dot,
    predict_ripple,
    propagate_sensitivity,
    set_sensitivity,
    update_coefficients,
)
from textile_twin_core.shaft.status import Record

SHARE, TO_ALL = 1e-3, 0.01
"""Probability that passes between memories at each sample, as motions change a few times in 1000 samples; and the part
of it that goes to all alike."""
USAGE_SAMPLES = 300.0
"""Samples over which a memory's use is averaged."""
RESTART_RATIO = math.exp(-10.0)
"""Likelihood ratio to the family, since it was best, at which a filter begins again from the best one (Page 1954)."""
RESTART_PROBABILITY = 0.01
"""Probability of a filter that may begin again."""
FIRST_SCALE_WEIGHT = 0.1
"""What the first guess of the noise weighs beside the innovations that a filter's scale of it is learnt from: it may be
hundreds of times too large, and while it lasts filters of short memory fall behind."""
SCALE_SAMPLES = 500.0
"""Innovations that a filter's scale of the noise is learnt from."""
RIPPLE_SIZE = 0.05
"""Prior of the speed's ripple in each order, relative to the speed."""


@compiled
def set_basis_at(status: Record, theta: float, waves: int) -> None:
    """Let the basis be that of an angle."""
    if waves > 0 and (status.basis_at != theta or status.basis_waves < waves):
        set_basis(theta, status.lowest, 4 * waves, status.basis)
        status.basis_at, status.basis_waves = theta, float(waves)


@compiled
def update_second_order(status: Record, f: int) -> None:
    """Make g2 that of the best filter's ripple; the states follow, as they would a change of the ripple itself."""
    waves, change = lanes.WAVES[f], status.change
    change[:] = 0.0
    set_second(status.ripple[status.best[f]], waves, status.lowest, status.second[f], change)
    for m in range(lanes.FIRST[f], lanes.END[f]):
        for row in range(3):
            status.clock[row, m] += dot(status.sensitivity[m, row], change, 2 * waves)


@compiled
def initialise(status: Record, f: int, scale: float) -> None:
    """Let all filters of family `f` begin with an angle, rate, acceleration and a ripple of which nothing is known.

    `status.start` (9,) are state and factor, in units of the root of `scale`.
    What the ripple may be makes the clock's angle, rate and acceleration uncertain along with it.
    """
    width, start, root = 2 * lanes.WAVES[f], status.start, math.sqrt(scale)
    set_basis_at(status, start[lanes.ANGLE], lanes.WAVES[f])
    for i in range(2 * width):
        status.second[f, i] = 0.0
    for m in range(lanes.FIRST[f], lanes.END[f]):
        for row in range(9):
            status.clock[row, m] = start[row]
        set_sensitivity(status.sensitivity[m], status.basis, status.lowest, start[lanes.RATE], width)
        for i in range(width):
            status.ripple[m, i] = 0.0
            for j in range(i):
                status.factor[m, j, i] = 0.0
            status.factor[m, i, i] = RIPPLE_SIZE / (status.lowest * (i // 2 + 1)) / root
        status.scale[m], status.scale_samples[m] = scale, FIRST_SCALE_WEIGHT
        status.probability[m] = status.usage[m] = 1.0 / (lanes.END[f] - lanes.FIRST[f])
        status.likelihood_ratio[m] = 1.0
    status.best[f] = lanes.FIRST[f]


@compiled
def open_manoeuvre(
    status: Record, f: int, angle: float, rate: float, by_angle: float, by_rate: float, by_acceleration: float
) -> None:
    """Shift angle and rate of all filters and make them less certain by so much [rad, rad/s, rad/s^2]."""
    for m in range(lanes.FIRST[f], lanes.END[f]):
        root = math.sqrt(status.scale[m])
        status.clock[lanes.ANGLE, m] += angle
        status.clock[lanes.RATE, m] += rate
        status.clock[lanes.L22, m] += by_angle / root
        status.clock[lanes.L11, m] += by_rate / root
        status.clock[lanes.L00, m] += by_acceleration / root


@compiled
def predict(status: Record, f: int, step: float, noise: float, interval: float) -> None:
    """Move all filters on. White jerk of intensity q = r / (N^6 T^5) makes a filter of memory N (Kalata 1984)."""
    time_update(status, math.sqrt(noise * step / interval**5), step, lanes.FIRST[f], lanes.END[f])


@compiled
def predict_reading(status: Record, f: int, step: float, reading: float, at: float, noise: float) -> None:
    """Foresee a reading of the angle, `step` after the one before, the ripple taken at the angle `at`.

    Sets innovations and their likelihoods. A reading far off is widened in the filter that it surprises.
    """
    if lanes.WAVES[f] > 0:
        set_basis_at(status, at, lanes.WAVES[f])
        reading += known_part(status.second[f], 4 * lanes.WAVES[f], status.basis)
    width, first, end = 2 * lanes.WAVES[f], lanes.FIRST[f], lanes.END[f]
    ripple_reading, ripple_variance = status.ripple_reading, status.ripple_variance
    for m in range(first, end):
        ripple_reading[m] = ripple_variance[m] = 0.0
    for m in range(first, end if width > 0 else first):
        propagate_sensitivity(status.sensitivity[m], step, status.basis, status.regressor[m], width)
        ripple, factor, regressor = status.ripple[m], status.factor[m], status.regressor[m]
        ripple_reading[m], ripple_variance[m] = predict_ripple(
            ripple, factor, status.basis, regressor, status.projected_ripple[m], width
        )
    innovate(status, reading, noise, first, end)


@compiled
def predictive_density(status: Record, f: int) -> float:
    """The probability density that the family gives to what was foreseen last, but for the constant of Student's t."""
    total = 0.0
    for m in range(lanes.FIRST[f], lanes.END[f]):
        total += status.probability[m] * status.likelihood[m]
    return total


@compiled
def _correct_filters(status: Record, f: int) -> None:
    """Correct all filters by what was foreseen last."""
    first, end, width = lanes.FIRST[f], lanes.END[f], 2 * lanes.WAVES[f]
    measurement_update(status, first, end)
    for m in range(first, end if width > 0 else first):
        sensitivity, gain, clock = status.sensitivity[m], status.gain, status.clock
        correct_sensitivity(sensitivity, status.regressor[m], gain[0, m], gain[1, m], gain[2, m], width)
        rest = status.noise_variance[m] + status.prior_variance[m] - status.ripple_variance[m]
        by0, by1, by2 = update_coefficients(
            status.ripple[m], status.factor[m], status.projected_ripple[m], status.innovation[m], rest, sensitivity,
            status.part, status.change, width,
        )  # fmt: skip
        clock[lanes.ACCELERATION, m] += by0
        clock[lanes.RATE, m] += by1
        clock[lanes.ANGLE, m] += by2


@compiled
def update_filters(status: Record, f: int, noise: float, least_scale: float) -> float:
    """Correct all filters by the angle foreseen last; its likelihood under the family.

    Learns the probabilities and each filter's scale of the noise; filters that fell behind begin again from the best.
    """
    first, end = lanes.FIRST[f], lanes.END[f]
    likelihood, probability, likelihood_ratio = status.likelihood, status.probability, status.likelihood_ratio
    innovation, prior_variance, scale, scale_samples = (
        status.innovation,
        status.prior_variance,
        status.scale,
        status.scale_samples,
    )
    usage, together = status.usage, predictive_density(status, f)
    _correct_filters(status, f)
    correlated, kept = TO_ALL / (end - first), 1.0 / together
    for m in range(first, end):
        ratio = likelihood[m] * kept
        share = correlated + (1.0 - TO_ALL) * usage[m]
        probability[m] = (1.0 - SHARE) * probability[m] * ratio + SHARE * share
        usage[m] += (probability[m] - usage[m]) / USAGE_SAMPLES
        likelihood_ratio[m] = min(1.0, likelihood_ratio[m] * ratio)
        squared = min(innovation[m] * innovation[m] / (scale[m] * (noise + prior_variance[m])), ROBUST)
        scale_samples[m] = min(scale_samples[m] + 1.0, SCALE_SAMPLES)
        scale[m] = max(scale[m] * (1.0 + (squared - 1.0) / scale_samples[m]), least_scale)
    best = first
    for m in range(first, end):
        if probability[m] > probability[best]:
            best = m
    status.best[f] = best
    for m in range(first, end):
        if likelihood_ratio[m] < RESTART_RATIO and probability[m] < RESTART_PROBABILITY and m != best:
            _restart_from(status, best, m, 2 * lanes.WAVES[f])
    return together


@compiled
def log_memory(status: Record, f: int) -> float:
    """Mean logarithm of the memory."""
    total = 0.0
    for m in range(lanes.FIRST[f], lanes.END[f]):
        total += status.probability[m] * status.logarithm[m]
    return total


@compiled
def _restart_from(status: Record, source: int, target: int, width: int) -> None:
    for row in range(9):
        status.clock[row, target] = status.clock[row, source]
    for i in range(width):
        status.ripple[target, i] = status.ripple[source, i]
        for row in range(3):
            status.sensitivity[target, row, i] = status.sensitivity[source, row, i]
        for j in range(i + 1):
            status.factor[target, j, i] = status.factor[source, j, i]
    status.scale[target], status.scale_samples[target] = status.scale[source], status.scale_samples[source]
    status.likelihood_ratio[target] = 1.0
