"""A family of Kalman filters with one clock and different memories, weighed by how well each foretold the readings.

Static multiple models (Magill 1965) with a fixed share of new probability (Herbster and Warmuth 1998), but without
mixing of states: where the states of the models are mixed at each step, as interacting multiple models do (Blom and
Bar-Shalom 1988), those of long memory are overwritten and never become sharp. Instead a filter that has fallen behind
begins again from the best one.
"""

from __future__ import annotations

import math
from functools import partial

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.clock import known_part, set_basis
from textile_twin_core.shaft.kinematics import correct, move_on
from textile_twin_core.shaft.ripple import absorb, feel, learn, shift
from textile_twin_core.shaft.status import END, FIRST, WAVES, Record

FREEDOM = 8.0
"""Of Student's t for the innovations: a reading far off changes the weights little."""
WIDE = 9.0
"""A normalised innovation squared above this widens its own reading until it is this."""
SHARE = 1e-3
"""Probability that passes from one memory to all others at each sample: motions change a few times in 1000 samples."""
BEHIND = math.exp(-5.0)
"""Likelihood ratio to the family, since it was best, at which a filter begins again from the best one (Page 1954)."""
FEW = 0.01
"""Probability of a filter that may begin again."""
SCALE_SAMPLES = 500.0
"""Innovations that a filter's scale of the noise is learnt from."""
FIRST_SCALE_WEIGHT = 0.5
"""What the first guess of the noise weighs beside them."""
RIPPLE_SIZE = 0.05
"""Prior of the speed's ripple in each order, relative to the speed."""
RATE, ANGLE = 1, 2
"""Rows of the clock's state that readings are of."""


@compiled
def stand_at(status: Record, theta: float, waves: int) -> None:
    """Let the basis be that of an angle."""
    if waves > 0 and (status.basis_at != theta or status.basis_waves < waves):
        set_basis(theta, status.lowest, 4 * waves, status.basis)
        status.basis_at, status.basis_waves = theta, float(waves)


@compiled
def begin(
    status: Record, f: int, angle: float, rate: float, acceleration: float, kinematic: FloatArray, scale: float
) -> None:
    """Let all filters of family `f` begin with an angle, rate, acceleration and a ripple of which nothing is known.

    `kinematic` (6,) is l00 .. l22 of the factor, in units of the root of `scale`.
    What the ripple may be makes the clock's angle, rate and acceleration uncertain along with it.
    """
    width = 2 * WAVES[f]
    stand_at(status, angle, WAVES[f])
    basis = status.basis
    for i in range(2 * width):
        status.second[f, i] = 0.0
    for m in range(FIRST[f], END[f]):
        status.clock_acceleration[m], status.clock_rate[m], status.clock_angle[m] = acceleration, rate, angle
        status.l00[m], status.l10[m], status.l20[m] = kinematic[0], kinematic[1], kinematic[2]
        status.l11[m], status.l21[m], status.l22[m] = kinematic[3], kinematic[4], kinematic[5]
        root = math.sqrt(scale)
        for i in range(width):
            status.ripple[m, i] = 0.0
            for j in range(i):
                status.factor[m, j, i] = 0.0
            status.factor[m, i, i] = RIPPLE_SIZE / (status.lowest * (i // 2 + 1)) / root
            turning = status.lowest * (i // 2 + 1) * rate
            status.sensitivity[m, 0, i] = -turning * turning * basis[i]
            status.sensitivity[m, 1, i] = turning * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
            status.sensitivity[m, 2, i] = basis[i]
        status.scale[m], status.learnt[m] = scale, FIRST_SCALE_WEIGHT
        status.probability[m], status.standing[m] = 1.0 / (END[f] - FIRST[f]), 1.0
    status.best[f] = FIRST[f]


@compiled
def open_motion(
    status: Record, f: int, angle: float, rate: float, by_angle: float, by_rate: float, by_acceleration: float
) -> None:
    """Shift angle and rate of all filters and make them less certain by so much [rad, rad/s, rad/s^2]."""
    for m in range(FIRST[f], END[f]):
        root = math.sqrt(status.scale[m])
        status.clock_angle[m] += angle
        status.clock_rate[m] += rate
        status.l22[m] += by_angle / root
        status.l11[m] += by_rate / root
        status.l00[m] += by_acceleration / root


@compiled
def predict(status: Record, f: int, step: float, noise: float, interval: float) -> None:
    """Move all filters on. White jerk of intensity q = r / (N^6 T^5) makes a filter of memory N (Kalata 1984)."""
    move_on(
        status.clock_acceleration, status.clock_rate, status.clock_angle, status.l00, status.l10, status.l20,
        status.l11, status.l21, status.l22, status.weakness, math.sqrt(noise * step / interval**5), step, FIRST[f],
        END[f],
    )  # fmt: skip


@compiled
def expect_angle(status: Record, f: int, step: float, reading: float, at: float, noise: float) -> None:
    """Foresee a reading of the angle, `step` after the one before, the ripple taken at the angle `at`.

    Sets innovations and likelihoods.
    """
    waves = WAVES[f]
    if waves > 0:
        stand_at(status, at, waves)
        basis = status.basis
        reading += known_part(status.second[f], 4 * waves, basis)
        _feel(status, f, step, ANGLE, basis)
    _foresee(
        reading, status.clock_angle, status.l20, status.l21, status.l22, status.told, status.common, status.scale,
        status.seen0, status.seen1, status.seen2, status.innovation, status.spread, status.own_noise, status.likelihood,
        noise, FIRST[f], END[f],
    )  # fmt: skip


@partial(compiled, apart=True)
def _foresee(
    reading: float, state: FloatArray, l0: FloatArray, l1: FloatArray, l2: FloatArray, told: FloatArray,
    common: FloatArray, scale: FloatArray, seen0: FloatArray, seen1: FloatArray, seen2: FloatArray,
    innovation: FloatArray, spread: FloatArray, own_noise: FloatArray, likelihood: FloatArray, noise: float, first: int,
    end: int,
) -> None:  # fmt: skip
    """Innovations of a reading of the state whose rows of the factor are given, and their likelihoods.

    A reading far off is widened in the filter that it surprises.
    """
    for m in range(first, end):
        p0, p1, p2 = l0[m], l1[m], l2[m]
        seen0[m], seen1[m], seen2[m] = p0, p1, p2
        off = reading + told[m] - state[m]
        by = common[m] + p0 * p0 + p1 * p1 + p2 * p2
        squared = off * off / scale[m]
        rest = 1.0 + squared / (FREEDOM * (noise + by))
        innovation[m], spread[m] = off, by
        own_noise[m] = max(noise, squared / WIDE - by)
        likelihood[m] = 1.0 / (rest * rest * rest * rest * math.sqrt(rest * scale[m] * (noise + by)))


@compiled
def _feel(status: Record, f: int, step: float, row: int, regressor: FloatArray) -> None:
    """What a reading feels of the ripple in each filter, and the variance that this gives it."""
    width = 2 * WAVES[f]
    for m in range(FIRST[f], END[f]):
        status.told[m], status.common[m] = feel(
            status.sensitivity[m], status.ripple[m], status.factor[m], step, row, regressor, status.felt[m], width
        )


@compiled
def nearest(status: Record, f: int, noise: float, least_probability: float) -> float:
    """The least normalised innovation squared of the filters whose probability counts."""
    least = math.inf
    for m in range(FIRST[f], END[f]):
        if status.probability[m] > least_probability:
            variance = status.scale[m] * (noise + status.spread[m])
            least = min(least, status.innovation[m] ** 2 / variance)
    return least


@compiled
def _correct(status: Record, f: int) -> None:
    """Correct all filters by what was foreseen last."""
    first, end, width = FIRST[f], END[f], 2 * WAVES[f]
    correct(
        status.clock_acceleration, status.clock_rate, status.clock_angle, status.l00, status.l10, status.l20,
        status.l11, status.l21, status.l22, status.seen0, status.seen1, status.seen2, status.innovation,
        status.own_noise, status.gain0, status.gain1, status.gain2, first, end,
    )  # fmt: skip
    for m in range(first, end if width > 0 else first):
        sensitivity, felt, change = status.sensitivity[m], status.felt[m], status.change
        absorb(sensitivity, felt, status.gain0[m], status.gain1[m], status.gain2[m], width)
        rest = status.own_noise[m] + status.spread[m] - status.common[m]
        learn(status.ripple[m], status.factor[m], felt, status.innovation[m], rest, change, width)
        acceleration, rate, angle = shift(sensitivity, change, width)
        status.clock_acceleration[m] += acceleration
        status.clock_rate[m] += rate
        status.clock_angle[m] += angle


@compiled
def take_angle(status: Record, f: int, noise: float, least_scale: float) -> float:
    """Correct all filters by the angle foreseen last; its likelihood under the family.

    Learns the probabilities and each filter's scale of the noise; filters that fell behind begin again from the best.
    """
    first, end = FIRST[f], END[f]
    together = 0.0
    for m in range(first, end):
        together += status.probability[m] * status.likelihood[m]
    _correct(status, f)
    _believe(
        status.likelihood, status.innovation, status.spread, status.probability, status.standing, status.scale,
        status.learnt, together, noise, least_scale, first, end,
    )  # fmt: skip
    best = first
    for m in range(first, end):
        if status.probability[m] > status.probability[best]:
            best = m
    status.best[f] = best
    for m in range(first, end):
        if status.standing[m] < BEHIND and status.probability[m] < FEW and m != best:
            _begin_again(status, best, m, 2 * WAVES[f])
    return together


@partial(compiled, apart=True)
def _believe(
    likelihood: FloatArray, innovation: FloatArray, spread: FloatArray, probability: FloatArray, standing: FloatArray,
    scale: FloatArray, learnt: FloatArray, together: float, noise: float, least_scale: float, first: int, end: int,
) -> None:  # fmt: skip
    """Learn probabilities and scales of the noise."""
    share, kept = SHARE / (end - first), 1.0 / together
    for m in range(first, end):
        ratio = likelihood[m] * kept
        probability[m] = (1.0 - SHARE) * probability[m] * ratio + share
        standing[m] = min(1.0, standing[m] * ratio)
        squared = min(innovation[m] * innovation[m] / (scale[m] * (noise + spread[m])), WIDE)
        count = min(learnt[m] + 1.0, SCALE_SAMPLES)
        learnt[m] = count
        scale[m] = max(scale[m] * (1.0 + (squared - 1.0) / count), least_scale)


@compiled
def log_memory(status: Record, f: int) -> float:
    """Mean logarithm of the memory."""
    total = 0.0
    for m in range(FIRST[f], END[f]):
        total += status.probability[m] * status.logarithm[m]
    return total


@compiled
def _begin_again(status: Record, source: int, target: int, width: int) -> None:
    status.clock_acceleration[target] = status.clock_acceleration[source]
    status.clock_rate[target] = status.clock_rate[source]
    status.clock_angle[target] = status.clock_angle[source]
    status.l00[target], status.l10[target] = status.l00[source], status.l10[source]
    status.l20[target], status.l11[target] = status.l20[source], status.l11[source]
    status.l21[target], status.l22[target] = status.l21[source], status.l22[source]
    for i in range(width):
        status.ripple[target, i] = status.ripple[source, i]
        for row in range(3):
            status.sensitivity[target, row, i] = status.sensitivity[source, row, i]
        for j in range(i + 1):
            status.factor[target, j, i] = status.factor[source, j, i]
    status.scale[target], status.learnt[target] = status.scale[source], status.learnt[source]
    status.standing[target] = 1.0


@compiled
def take_speed(status: Record, f: int, speed: float, theta: float, variance: float) -> None:
    """Correct all filters by a reading of the speed [rad/s] at an angle: the clock's rate is speed (1 + g')."""
    waves, rate = WAVES[f], speed
    if waves > 0:
        stand_at(status, theta, waves)
        basis, regressor, second = status.basis, status.regressor, status.second[f]
        for k in range(2 * waves):
            turning = speed * status.lowest * (k + 1)
            rate += turning * (second[2 * k + 1] * basis[2 * k] - second[2 * k] * basis[2 * k + 1])
            if k < waves:
                regressor[2 * k], regressor[2 * k + 1] = -turning * basis[2 * k + 1], turning * basis[2 * k]
        _feel(status, f, 0.0, RATE, regressor)
    _foresee(
        rate, status.clock_rate, status.l10, status.l11, status.none, status.told, status.common, status.scale,
        status.seen0, status.seen1, status.seen2, status.innovation, status.spread, status.own_noise, status.likelihood,
        variance / status.scale[status.best[f]], FIRST[f], END[f],
    )  # fmt: skip
    _correct(status, f)
