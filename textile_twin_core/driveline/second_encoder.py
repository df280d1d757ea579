"""Second encoder of an elastic shaft, compiled: Kalman filters of the twist that the chain does not explain.

The chain follows the first encoder. The difference of the two readings, less the twist of the chain between them, is

    y = q + zero + noise,   q'' = a - w^2 q - 2 c q'

q is the share of one natural mode, w and c its frequency and decay rate: of the mode that gives the most compliance
between the two encoders. `a` is the acceleration by unmodelled torques. The zero is the mean of y, so q has no mean.
The estimate of q is added to the chain's motion and torques and does not act back on the chain: wrong gains cannot make
the chain unstable.

A bank of filters (`drive_bank`) takes `a` for a random walk. Its memories reach from a single sample, for which the
measured twist is the truth, to infinity, for which the chain is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.driveline.chain import ShaftChain
from textile_twin_core.driveline.drive_bank import DriveBank, begin_bank, covariance_of, drive_bank, predict, update
from textile_twin_core.driveline.runs import Outputs

_MEMORIES: FloatArray = np.append(4.0 ** np.arange(0.0, 6.0), np.inf)
"""Samples over which each filter takes the unmodelled torque for constant."""
_TWIST, _RATE, _TORQUE = range(3)
"""Numbers of the bank's x: q, q' and a."""
_UNKNOWN, _RINGING, _AVERAGED, _HELD = 0.0, 1.0, 2.0, 3.0
"""Second encoder's zero: before its first reading, during the vibration of the start, its mean since, fixed."""
_GATE = 25.0
"""Squared innovation over its variance under every filter from which a reading is an outlier."""
_STRAIGHT = 1e-6
"""Product of decay rate or frequency and time below which the shape moves uniformly."""


@by_reference
class SecondEncoder(NamedTuple):
    """The filters of the second encoder. All arrays are empty without one."""

    bank: DriveBank
    shape: FloatArray
    """(stations,) share of q at each station"""
    mode: FloatArray
    """(3,) w^2 [1/s^2], c [1/s], and half the angle after which readings may repeat [rad]"""
    x: FloatArray
    """(3,) estimates of q, q' and a"""
    zero: FloatArray
    """(3,) mean of y [rad], time over which it was taken [s], and its state, such as _AVERAGED"""
    begun: FloatArray
    """(1,) 1 once the filters have taken a reading"""
    gradient: FloatArray
    """(5,) gradient of the sensor's torque by x"""


def second_encoder(
    chain: ShaftChain, inertia: FloatArray, first: int, second: int | None, period_rad: float
) -> SecondEncoder:
    """Filters before the first reading.

    Args:
        chain: The chain.
        inertia: (stations,) mean inertias, the drive's with its best value [kg m^2].
        first: Station of the first encoder.
        second: Station of the second one; None: without a second encoder.
        period_rad: Angle after which the second encoder's readings may repeat, reduced to the main shaft.

    Returns:
        The filters.
    """
    memories, shape, mode = np.zeros(0), np.zeros(0), np.zeros(3)
    if second is not None:
        damping = assembled(chain.damping) + np.diag(chain.viscous)
        squares, shapes = scipy.linalg.eigh(assembled(chain.stiffness), np.diag(inertia))
        squares, shapes = squares[1:], shapes[:, 1:]
        most = int(np.argmax((shapes[second] - shapes[first]) ** 2 / squares))
        memories, natural = _MEMORIES, shapes[:, most]
        mode = np.array((squares[most], 0.5 * natural @ damping @ natural, 0.5 * period_rad))
        shape = (natural - natural[first]) / (natural[second] - natural[first])
    x, zero, gradient = np.zeros(3), np.zeros(3), np.zeros(5)
    return SecondEncoder(drive_bank(0.0, 0.0, memories), shape, mode, x, zero, np.zeros(1), gradient)


def assembled(pieces: FloatArray) -> FloatArray:
    """Matrix of a chain from the stiffness or damping of its pieces."""
    matrix = np.zeros((pieces.size + 1, pieces.size + 1))
    for i, value in enumerate(pieces):
        matrix[i : i + 2, i : i + 2] += value * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return matrix


def hold_zero(encoder: SecondEncoder) -> None:
    """Fix the zero at the mean so far, where there is one."""
    if encoder.zero[2] != _UNKNOWN:
        encoder.zero[2] = _HELD


@compiled_in_place
def restart_second(encoder: SecondEncoder) -> None:
    """Forget the twist; an averaged zero stays."""
    encoder.begun[0] = 0.0
    for i in range(3):
        encoder.x[i] = 0.0


@compiled_in_place
def advance_second(encoder: SecondEncoder, dt: float, interval: float, variance: float) -> None:
    """Predict over a time `dt` [s]; `interval`, `variance` as in `drive_bank.predict`."""
    if encoder.begun[0] == 0.0:
        return
    square, c = encoder.mode[0], encoder.mode[1]
    swing = square - c * c
    w = math.sqrt(abs(swing))
    decay = math.exp(-c * dt)
    if w * dt < _STRAIGHT:
        even, odd = 1.0, dt
    elif swing > 0.0:
        even, odd = math.cos(w * dt), math.sin(w * dt) / w
    else:
        even, odd = math.cosh(w * dt), math.sinh(w * dt) / w
    stay, moved = decay * (even + c * odd), decay * odd
    step = encoder.bank.step
    step[0, _TWIST], step[0, _RATE], step[0, _TORQUE] = stay, moved, (1.0 - stay) / square
    step[1, _TWIST], step[1, _RATE], step[1, _TORQUE] = -square * moved, decay * (even - c * odd), moved
    predict(encoder.bank, dt, interval, variance, 0.0, square)
    x, twist, rate = encoder.x, 0.0, 0.0
    for i in range(3):
        twist += step[0, i] * x[i]
        rate += step[1, i] * x[i]
    x[_TWIST], x[_RATE] = twist, rate


@compiled_in_place
def take_second(encoder: SecondEncoder, excess: float, interval: float, variance: float, rung: float) -> None:
    """Take a reading.

    excess: measured twist less the chain's, with any number of periods [rad]; rung: 1 once the vibration of the
    start has decayed, 0 before; others as in `advance_second`.
    """
    x, bank, half, zero = encoder.x, encoder.bank, encoder.mode[2], encoder.zero
    if zero[2] == _UNKNOWN:
        zero[0], zero[1], zero[2] = excess, 0.0, _RINGING
    off = excess - zero[0]
    off -= 2.0 * half * math.floor(0.5 * off / half + 0.5)
    if encoder.begun[0] == 0.0:
        encoder.begun[0] = 1.0
        begin_bank(bank, variance, variance / interval**2, 0.0)
        x[_TWIST] = off
    widest = 0.0
    for m in range(bank.memory.size):
        widest = max(widest, bank.covariance[m, 0, 0] + variance * bank.scale[m])
    if (off - x[_TWIST]) ** 2 > _GATE * widest:
        return
    if rung > 0.0 and zero[2] == _RINGING:
        zero[1], zero[2] = 0.0, _AVERAGED
    if zero[2] != _HELD and (zero[2] == _RINGING or rung > 0.0):
        zero[1] += interval
        shift = off * interval / zero[1]
        zero[0] += shift
        off -= shift
    update(bank, off - x[_TWIST], variance)
    for i in range(3):
        x[i] += bank.mean[i]


@compiled_in_place
def add_twist(encoder: SecondEncoder, chain: ShaftChain, piece: int, j: int, out: Outputs) -> float:
    """Add the estimate to row j of a chain's motion; returns the variance of the torque in a piece [(N m)^2]."""
    if encoder.begun[0] == 0.0:
        return 0.0
    q, rate, a = encoder.x[_TWIST], encoder.x[_RATE], encoder.x[_TORQUE]
    faster = a - encoder.mode[0] * q - 2.0 * encoder.mode[1] * rate
    shape = encoder.shape
    for i in range(shape.size):
        out.psi[j, i] += shape[i] * q
        out.omega[j, i] += shape[i] * rate
        out.alpha[j, i] += shape[i] * faster
    for i in range(shape.size - 1):
        strain = shape[i] - shape[i + 1]
        out.pieces[j, i] += strain * (chain.stiffness[i] * q + chain.damping[i] * rate)
    strain = shape[piece] - shape[piece + 1]
    encoder.gradient[_TWIST], encoder.gradient[_RATE] = strain * chain.stiffness[piece], strain * chain.damping[piece]
    return covariance_of(encoder.bank, encoder.gradient, encoder.gradient)
