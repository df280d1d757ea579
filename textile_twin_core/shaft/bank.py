"""A bank of Kalman filters with one clock and different memories, weighed by how well each foretold the readings.

Static multiple models (Magill 1965) with a fixed share of new probability (Herbster and Warmuth 1998), but without
mixing of states: where the states of the models are mixed at each step, as interacting multiple models do (Blom and
Bar-Shalom 1988), those of long memory are overwritten and never become sharp. Instead a model that has fallen behind
begins again from the best one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.clock import angle_of, known_part, observe, set_basis, set_second
from textile_twin_core.shaft.factor import correct, foresee, move_on

FREEDOM = 8.0
"""Of Student's t for the innovations: a reading far off changes the weights little."""
WIDE = 9.0
"""A normalised innovation squared above this widens its own reading until it is this."""
SHARE = 1e-3
"""Probability that passes from one memory to all others at each sample: motions change a few times in 1000 samples."""
BEHIND = math.exp(-5.0)
"""Likelihood ratio to the bank, since it was best, at which a model begins again from the best one (Page 1954)."""
FEW = 0.01
"""Probability of a model that may begin again."""
SCALE_SAMPLES = 500.0
"""Innovations that a model's scale of the noise is learnt from."""
FIRST_SCALE_WEIGHT = 0.5
"""What the first guess of the noise weighs beside them."""
RIPPLE_SIZE = 0.05
"""Prior of the speed's ripple in each order, relative to the speed."""
MINOR = 0.05
"""Models of less than this part of the heaviest one's weight do not enter the mixture."""


HEADER = 8
LOWEST, BEST, LOG_MEMORY = 3, 4, 5
"""Places of a bank's head: lowest order of the ripple, whose multiples up to K times the others are; model of the
highest probability; mean
logarithm of the memory. Before them stand K, M and n."""
MEAN, PROJECTED, GAIN = range(3)
"""Of `states`: means of the models, and room for `factor`."""
(
    MEMORY, LOG, SCALE, LEARNT, PROBABILITY, STANDING, INTENSITY, INNOVATION, SPREAD, LIKELIHOOD, OWN_NOISE, TOTAL,
    KEEP,
    MIX,
) = range(14)  # fmt: skip
"""Of `models`: samples that a model looks back, the inverse of its bandwidth, and their
logarithm; variance of the readings relative to what is expected, and
the innovations it was learnt from; probability; likelihood ratio to the bank since it was best; then room to work
in."""


class Bank(NamedTuple):
    """M models of n = 2 K + 3 states: coefficients of ripple; acceleration, rate and angle of the clock.

    Attributes:
        head: (8,) see `LOWEST`.
        models: (14, M) see `MEMORY`.
        states: (3, n, M) see `MEAN`.
        factor: (n, n, M) see `factor`, in units of the root of the scale.
        second, basis, regressor: (4 K,), (4 K,), (2 K,) see `clock`.
        gradient: (3, n), wave: (4,), state: (3,) room for `clock.observe`.
    """

    head: FloatArray
    models: FloatArray
    states: FloatArray
    factor: FloatArray
    second: FloatArray
    basis: FloatArray
    regressor: FloatArray
    gradient: FloatArray
    wave: FloatArray
    state: FloatArray


def bank_room(waves: int, cycle_turns: float, memory: FloatArray) -> FloatArray:
    """Room for a bank with so many orders of ripple, multiples of 1 / cycle_turns, and models of the given memories.

    One array: compiled code takes a bank apart (`open_bank`) faster than Python hands over its parts.
    """
    n, models = 2 * waves + 3, memory.size
    room = np.zeros(HEADER + models * (14 + 3 * n + n * n) + 10 * waves + 3 * n + 7)
    room[:4] = waves, models, n, 1.0 / cycle_turns
    room[HEADER : HEADER + models] = memory
    room[HEADER + models : HEADER + 2 * models] = np.log(memory)
    return room


@compiled
def open_bank(room: FloatArray) -> Bank:
    """The bank that lives in a room."""
    waves, models, n = int(room[0]), int(room[1]), int(room[2])
    a = HEADER + 14 * models
    b = a + 3 * n * models
    c = b + n * n * models
    d = c + 4 * waves
    e = d + 4 * waves
    f = e + 2 * waves
    g = f + 3 * n
    return Bank(
        room[:HEADER], room[HEADER:a].reshape((14, models)), room[a:b].reshape((3, n, models)),
        room[b:c].reshape((n, n, models)), room[c:d], room[d:e], room[e:f], room[f:g].reshape((3, n)),
        room[g : g + 4], room[g + 4 : g + 7],
    )  # fmt: skip


@compiled
def begin(bank: Bank, angle: float, rate: float, acceleration: float, kinematic: FloatArray, scale: float) -> None:
    """Let all models begin with an angle, rate, acceleration and a ripple of which nothing is known.

    `kinematic` (3, 3) is the lower factor of acceleration, rate, angle in that order, in units of the root of `scale`.
    What the ripple may be makes the clock's angle, rate and acceleration uncertain along with it.
    """
    n, models = bank.states[MEAN].shape
    lowest = bank.head[LOWEST]
    bank.states[MEAN] = 0.0
    bank.factor[:, :, :] = 0.0
    bank.second[:] = 0.0
    set_basis(angle, lowest, bank.basis)
    for m in range(models):
        bank.states[MEAN, n - 3, m], bank.states[MEAN, n - 2, m], bank.states[MEAN, n - 1, m] = (
            acceleration,
            rate,
            angle,
        )
        for i in range(n - 3):
            order = lowest * (i // 2 + 1)
            sigma = RIPPLE_SIZE / order / math.sqrt(scale)
            value = bank.basis[i]
            slope = -bank.basis[i + 1] if i % 2 == 0 else bank.basis[i - 1]
            bank.factor[i, i, m] = sigma
            bank.factor[i, n - 1, m] = sigma * value
            bank.factor[i, n - 2, m] = sigma * slope * order * rate
            bank.factor[i, n - 3, m] = -sigma * value * (order * rate) ** 2
        for j in range(3):
            for i in range(j, 3):
                bank.factor[n - 3 + j, n - 3 + i, m] = kinematic[i, j]
        bank.models[SCALE, m] = scale
        bank.models[LEARNT, m] = FIRST_SCALE_WEIGHT
        bank.models[PROBABILITY, m] = 1.0 / models
        bank.models[STANDING, m] = 1.0
    bank.head[BEST] = 0.0


@compiled
def open_motion(bank: Bank, angle: float, rate: float, by_angle: float, by_rate: float, by_acceleration: float) -> None:
    """Shift angle and rate of all models and make them less certain by so much [rad, rad/s, rad/s^2]."""
    n = bank.states[MEAN].shape[0]
    for m in range(bank.models.shape[1]):
        root = math.sqrt(bank.models[SCALE, m])
        bank.states[MEAN, n - 1, m] += angle
        bank.states[MEAN, n - 2, m] += rate
        bank.factor[n - 1, n - 1, m] += by_angle / root
        bank.factor[n - 2, n - 2, m] += by_rate / root
        bank.factor[n - 3, n - 3, m] += by_acceleration / root


@compiled
def predict(bank: Bank, step: float, noise: float, interval: float) -> None:
    """Move all models on. White jerk of intensity q = r / (N^6 T^5) makes a filter of memory N (Kalata 1984)."""
    for m in range(bank.models.shape[1]):
        bank.models[INTENSITY, m] = noise / (bank.models[MEMORY, m] ** 6 * interval**5)
    move_on(bank.states[MEAN], bank.factor, step, bank.models[INTENSITY])


@compiled
def expect_angle(bank: Bank, reading: float, at: float, noise: float) -> None:
    """Foresee a reading of the angle, the ripple taken at the angle `at`; sets innovations and likelihoods."""
    set_basis(at, bank.head[LOWEST], bank.basis)
    for k in range(bank.regressor.size):
        bank.regressor[k] = -bank.basis[k]
    _foresee(bank, bank.states.shape[1] - 1, reading + known_part(bank.second, bank.basis))
    models = bank.models
    for m in range(models.shape[1]):
        variance = models[SCALE, m] * (noise + models[SPREAD, m])
        rest = 1.0 + models[INNOVATION, m] ** 2 / (FREEDOM * variance)
        models[LIKELIHOOD, m] = 1.0 / (rest * rest * rest * rest * math.sqrt(rest * variance))


@compiled
def _foresee(bank: Bank, row: int, reading: float) -> None:
    states, models = bank.states, bank.models
    foresee(
        states[MEAN], bank.factor, row, bank.regressor, reading, states[PROJECTED], models[INNOVATION], models[SPREAD]
    )  # fmt: skip


@compiled
def _correct(bank: Bank, noise: float) -> None:
    """Correct all models by what was foreseen last; a reading far off is widened in the model that it surprises."""
    states, models = bank.states, bank.models
    for m in range(models.shape[1]):
        models[OWN_NOISE, m] = max(noise, models[INNOVATION, m] ** 2 / (WIDE * models[SCALE, m]) - models[SPREAD, m])
    correct(
        states[MEAN], bank.factor, states[PROJECTED], models[INNOVATION], models[OWN_NOISE], states[GAIN],
        models[TOTAL],
        models[KEEP], models[MIX],
    )  # fmt: skip


@compiled
def nearest(bank: Bank, noise: float, least_probability: float) -> float:
    """The least normalised innovation squared of the models whose probability counts."""
    least, models = math.inf, bank.models
    for m in range(models.shape[1]):
        if models[PROBABILITY, m] > least_probability:
            least = min(least, models[INNOVATION, m] ** 2 / (models[SCALE, m] * (noise + models[SPREAD, m])))
    return least


@compiled
def take_angle(bank: Bank, noise: float, least_scale: float, with_second: bool) -> float:
    """Correct all models by the angle foreseen last; its likelihood under the bank.

    Learns the probabilities and each model's scale of the noise; models that fell behind begin again from the best.
    """
    models = bank.models
    count = models.shape[1]
    together = 0.0
    for m in range(count):
        together += models[PROBABILITY, m] * models[LIKELIHOOD, m]
    _correct(bank, noise)
    best, memory = 0, 0.0
    for m in range(count):
        ratio = models[LIKELIHOOD, m] / together
        models[PROBABILITY, m] = (1.0 - SHARE) * models[PROBABILITY, m] * ratio + SHARE / count
        models[STANDING, m] = min(1.0, models[STANDING, m] * ratio)
        squared = min(models[INNOVATION, m] ** 2 / (models[SCALE, m] * (noise + models[SPREAD, m])), WIDE)
        models[LEARNT, m] = min(models[LEARNT, m] + 1.0, SCALE_SAMPLES)
        models[SCALE, m] = max(models[SCALE, m] * (1.0 + (squared - 1.0) / models[LEARNT, m]), least_scale)
        memory += models[PROBABILITY, m] * models[LOG, m]
        if models[PROBABILITY, m] > models[PROBABILITY, best]:
            best = m
    bank.head[BEST], bank.head[LOG_MEMORY] = best, memory
    for m in range(count):
        if models[STANDING, m] < BEHIND and models[PROBABILITY, m] < FEW and m != best:
            _begin_again(bank, best, m)
    if with_second:
        set_second(bank.states[MEAN], best, bank.head[LOWEST], bank.second)
    return together


@compiled
def _begin_again(bank: Bank, source: int, target: int) -> None:
    n = bank.states.shape[1]
    for j in range(n):
        bank.states[MEAN, j, target] = bank.states[MEAN, j, source]
        for i in range(j, n):
            bank.factor[j, i, target] = bank.factor[j, i, source]
    bank.models[SCALE, target] = bank.models[SCALE, source]
    bank.models[LEARNT, target] = bank.models[LEARNT, source]
    bank.models[STANDING, target] = 1.0


@compiled
def take_speed(bank: Bank, speed: float, theta: float, variance: float) -> None:
    """Correct all models by a reading of the speed [rad/s] at an angle: the clock's rate is speed (1 + g')."""
    lowest = bank.head[LOWEST]
    set_basis(theta, lowest, bank.basis)
    rate = speed
    for k in range(bank.second.size // 2):
        slope = bank.second[2 * k + 1] * bank.basis[2 * k] - bank.second[2 * k] * bank.basis[2 * k + 1]
        rate += speed * lowest * (k + 1) * slope
    for k in range(bank.regressor.size // 2):
        bank.regressor[2 * k] = speed * lowest * (k + 1) * bank.basis[2 * k + 1]
        bank.regressor[2 * k + 1] = -speed * lowest * (k + 1) * bank.basis[2 * k]
    _foresee(bank, bank.states.shape[1] - 2, rate)
    _correct(bank, variance / bank.models[SCALE, int(bank.head[BEST])])


@compiled
def angle(bank: Bank, m: int, guess: float) -> float:
    """The angle of model m, near `guess`."""
    return angle_of(bank.states[MEAN], m, bank.head[LOWEST], bank.basis, bank.second, guess, bank.wave)


@compiled
def blend(bank: Bank, own: float, about: FloatArray, top: float, moments: FloatArray) -> None:
    """Add the models of a bank of weight `own` to moments (10,) `about` an angle, speed and acceleration (3,).

    They are the weight; the weighted sums of the three; and of 00, 01, 02, 11, 12, 22 of their products.
    """
    state, gradient = bank.state, bank.gradient
    set_basis(about[0], bank.head[LOWEST], bank.basis)
    for m in range(bank.models.shape[1]):
        weight = own * bank.models[PROBABILITY, m]
        if weight < MINOR * top:
            continue
        observe(
            bank.states[MEAN], bank.factor, m, bank.head[LOWEST], bank.basis, bank.second, about[0], bank.wave, state,
            gradient,
        )  # fmt: skip
        moments[0] += weight
        place = 4
        for p in range(3):
            state[p] -= about[p]
        for p in range(3):
            moments[1 + p] += weight * state[p]
            for q in range(p, 3):
                product = 0.0
                for j in range(gradient.shape[1]):
                    product += gradient[p, j] * gradient[q, j]
                moments[place] += weight * (bank.models[SCALE, m] * product + state[p] * state[q])
                place += 1
