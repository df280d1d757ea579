"""Kalman filters of a chain's rigid shift and of its drive: a bank over the memory of the drive torque, compiled.

The chain is its own process model, and a correction shifts all stations alike. The filters estimate the error of that
shift and of the drive in five numbers x = (theta, omega, d, lambda, beta):

    alpha = d - lambda omega - beta L,   beta = 1 / (drive inertia + all other inertia),
    lambda = beta * slip,                d = beta * drive torque at standstill

L is the torque of everything else on the chain. With L from the chain an unknown drive is a linear regression on the
readings. Each filter takes the drive torque for a random walk of intensity R N^-6 / T^5, N its memory in samples
(Kalata 1984, The tracking index); for a mass on a spring of natural frequency w that is R N^-2 / T (w^2 + (N T)^-2)^2.
It learns its own scale of the reading noise R from its innovations, and is weighed by Student's likelihood with
fixed-share mixing (Raftery et al. 2010, Online prediction under model uncertainty).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place

MEMORIES: FloatArray = 4.0 ** np.arange(1.0, 6.0)
"""Samples over which each filter takes the drive torque for constant."""
SHIFT, SPEED, TORQUE, SLIP, MOBILITY = range(5)
"""Numbers of x: angle, speed, d, lambda, beta."""
_STUDENT = 8.0
_SHARE = 1e-3
"""Probability that the best filter changes from one sample to the next."""
_MOST_SURPRISE = 9.0
"""Bound of a normalised innovation squared in the scale of the noise."""
_FIRST_SAMPLES, _MOST_SAMPLES = 100.0, 500.0
"""Innovations over which a filter's scale is averaged, at first and at most; a scale far too large falls fast."""
_LEAST_SCALE = 0.05
_IDLE, _MISFIT = 0.01, 4.0
"""A filter below this probability whose scale is this many times that of the best restarts from the best."""
_DRIFT = 1e-4
"""Variance by which slip and inertia of the drive drift in a second, over their prior variance."""


@by_reference
class DriveBank(NamedTuple):
    """The filters; arrays by filter first."""

    x: FloatArray
    """(filters, 5) error of the chain's shift and drive"""
    covariance: FloatArray
    """(filters, 5, 5)"""
    scale: FloatArray
    """(filters,) factor on the reading variance"""
    samples: FloatArray
    """(filters,) innovations that the scale is averaged over"""
    probability: FloatArray
    likelihood: FloatArray
    memory: FloatArray
    prior: FloatArray
    """(2,) prior standard deviations of lambda [1/s] and beta [1/(kg m^2)]; 0 where known"""
    step: FloatArray
    """(2, 5) upper rows of the transition of x over one sample; the lower rows are those of the identity"""
    mean: FloatArray
    """(5,) mean of x over the filters, which the chain takes over"""
    row: FloatArray
    """(5,) room"""


def drive_bank(slip_sigma: float, mobility_sigma: float, memories: FloatArray = MEMORIES) -> DriveBank:
    """A bank before the first sample, with prior standard deviations of lambda and beta (0: known)."""
    count = memories.size
    ones = np.ones(count)
    prior, step = np.array((slip_sigma, mobility_sigma)), np.zeros((2, 5))
    return DriveBank(
        x=np.zeros((count, 5)),
        covariance=np.zeros((count, 5, 5)),
        scale=ones.copy(),
        samples=_FIRST_SAMPLES * ones,
        probability=ones / count,
        likelihood=ones.copy(),
        memory=memories.astype(np.float64),
        prior=prior,
        step=step,
        mean=np.zeros(5),
        row=np.zeros(5),
    )


@compiled_in_place
def begin_bank(bank: DriveBank, angle: float, speed: float, torque: float) -> None:
    """Begin with variances of angle, speed and d; slip and inertia count as known until `release`."""
    for m in range(bank.memory.size):
        for i in range(5):
            bank.x[m, i] = 0.0
            for j in range(5):
                bank.covariance[m, i, j] = 0.0
        bank.covariance[m, SHIFT, SHIFT] = angle
        bank.covariance[m, SPEED, SPEED] = speed
        bank.covariance[m, TORQUE, TORQUE] = torque
        bank.scale[m], bank.samples[m] = 1.0, _FIRST_SAMPLES
        bank.probability[m] = 1.0 / bank.memory.size


@compiled_in_place
def release(bank: DriveBank, torque: float, scale: float) -> None:
    """Begin to estimate slip and inertia, with `scale` times the reading variance; `torque`: added variance of d.

    The scale is that of a chain whose drive is wrong, and falls as the drive becomes known: early samples, which the
    wrong vibration spoils, weigh less than later ones.
    """
    for m in range(bank.memory.size):
        for i in range(5):
            bank.x[m, i] = 0.0
            bank.covariance[m, SLIP, i] = bank.covariance[m, i, SLIP] = 0.0
            bank.covariance[m, MOBILITY, i] = bank.covariance[m, i, MOBILITY] = 0.0
        bank.covariance[m, SLIP, SLIP] = bank.prior[0] ** 2
        bank.covariance[m, MOBILITY, MOBILITY] = bank.prior[1] ** 2
        bank.covariance[m, TORQUE, TORQUE] += torque
        bank.scale[m], bank.samples[m] = scale, _FIRST_SAMPLES
        bank.probability[m] = 1.0 / bank.memory.size


@compiled_in_place
def predict(bank: DriveBank, dt: float, interval: float, variance: float, learning: float, square: float = 0.0) -> None:
    """Advance the filters over a time `dt` [s].

    interval: mean time between readings [s]; variance: of one reading [rad^2]; learning: 1 once slip and inertia are
    estimated, 0 before; square: that of the natural frequency of what is filtered, 0 for a rigid shift [1/s^2].
    """
    (t0, t1, t2, t3, t4), (w0, w1, w2, w3, w4) = bank.step[0], bank.step[1]
    for m in range(bank.memory.size):
        x, p = bank.x[m], bank.covariance[m]
        shift = t0 * x[0] + t1 * x[1] + t2 * x[2] + t3 * x[3] + t4 * x[4]
        speed = w0 * x[0] + w1 * x[1] + w2 * x[2] + w3 * x[3] + w4 * x[4]
        x[0], x[1] = shift, speed
        for j in range(5):
            shift = t0 * p[0, j] + t1 * p[1, j] + t2 * p[2, j] + t3 * p[3, j] + t4 * p[4, j]
            speed = w0 * p[0, j] + w1 * p[1, j] + w2 * p[2, j] + w3 * p[3, j] + w4 * p[4, j]
            p[0, j], p[1, j] = shift, speed
        for j in range(5):
            shift = t0 * p[j, 0] + t1 * p[j, 1] + t2 * p[j, 2] + t3 * p[j, 3] + t4 * p[j, 4]
            speed = w0 * p[j, 0] + w1 * p[j, 1] + w2 * p[j, 2] + w3 * p[j, 3] + w4 * p[j, 4]
            p[j, 0], p[j, 1] = shift, speed
        follows = square + (bank.memory[m] * interval) ** -2.0
        p[TORQUE, TORQUE] += variance * bank.scale[m] * bank.memory[m] ** -2.0 / interval * follows**2 * dt
        p[SLIP, SLIP] += learning * bank.prior[0] ** 2 * _DRIFT * dt
        p[MOBILITY, MOBILITY] += learning * bank.prior[1] ** 2 * _DRIFT * dt


@compiled_in_place
def update(bank: DriveBank, innovation: float, variance: float) -> None:
    """Take a reading: `innovation` is its excess over the chain's angle [rad], `variance` that of a reading [rad^2]."""
    count, total = bank.memory.size, 0.0
    for m in range(count):
        x, p, row = bank.x[m], bank.covariance[m], bank.row
        spread = p[SHIFT, SHIFT] + variance * bank.scale[m]
        off = innovation - x[SHIFT]
        prior_cost = off * off / spread
        log_likelihood = -0.5 * (_STUDENT + 1.0) * math.log(1.0 + prior_cost / _STUDENT) - 0.5 * math.log(spread)
        bank.likelihood[m] = math.exp(log_likelihood)
        bank.samples[m] = min(bank.samples[m] + min(prior_cost, 1.0), _MOST_SAMPLES)
        grown = bank.scale[m] * (1.0 + (min(prior_cost, _MOST_SURPRISE) - 1.0) / bank.samples[m])
        bank.scale[m] = max(grown, _LEAST_SCALE)
        for j in range(5):
            row[j] = p[0, j]
        for i in range(5):
            gain = row[i] / spread
            x[i] += gain * off
            for j in range(5):
                p[i, j] -= gain * row[j]
        bank.probability[m] = (bank.probability[m] + _SHARE / count) / (1.0 + _SHARE) * bank.likelihood[m]
        total += bank.probability[m]
    best = 0
    for m in range(count):
        bank.probability[m] = bank.probability[m] / total if total > 0.0 else 1.0 / count
        if bank.probability[m] > bank.probability[best]:
            best = m
    for i in range(5):
        mean = 0.0
        for m in range(count):
            mean += bank.probability[m] * bank.x[m, i]
        bank.mean[i] = mean
    for m in range(count):
        if bank.probability[m] < _IDLE and bank.scale[m] > _MISFIT * bank.scale[best]:
            for i in range(5):
                bank.x[m, i] = bank.x[best, i]
                for j in range(5):
                    bank.covariance[m, i, j] = bank.covariance[best, i, j]
            bank.scale[m], bank.samples[m] = bank.scale[best], _FIRST_SAMPLES
        for i in range(5):
            bank.x[m, i] -= bank.mean[i]  # which the chain takes over


@compiled_in_place
def innovation_variance(bank: DriveBank, variance: float) -> float:
    """Variance of the next innovation where readings have this variance, whatever scale the filters have learnt."""
    result = 0.0
    for m in range(bank.memory.size):
        result += bank.probability[m] * bank.covariance[m, SHIFT, SHIFT] / bank.scale[m]
    return result + variance


@compiled_in_place
def covariance_of(bank: DriveBank, first: FloatArray, second: FloatArray) -> float:
    """Covariance of two linear functions of x, coefficients (5,), within and between the filters."""
    result = 0.0
    for m in range(bank.memory.size):
        x, p = bank.x[m], bank.covariance[m]
        within, one, two = 0.0, 0.0, 0.0
        for i in range(5):
            one += first[i] * x[i]
            two += second[i] * x[i]
            part = 0.0
            for j in range(5):
                part += p[i, j] * second[j]
            within += first[i] * part
        result += bank.probability[m] * (within + one * two)
    return result
