"""One Kalman filter with an intensity of its own at each step, forwards and back: what smoothing is made of.

Backwards everything is told in coordinates e in which the filter's covariance is the identity: x = mean + L e. From a
sample to the one before, mean and factor of e go through the same rotations and triangles as the filter did, turned
round (after Dyer and McReynolds 1969; Bierman 1983): no covariance can become negative, nothing is inverted, and the
white jerk is smoothed on the way. What the state owes to the ripple goes both ways along with it (see `ripple`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import ANGLE, WIDE
from textile_twin_core.shaft.clock import gradient, known_part, set_basis, shaft_state, wave
from textile_twin_core.shaft.kinematics import HALF_JERK, LAST_JERK
from textile_twin_core.shaft.mixture import owe
from textile_twin_core.shaft.ripple import absorb, feel, shift
from textile_twin_core.shaft.status import WAVES, WIDEST, Record

_STATE: Final = [
    ("state", np.float64, (3,)), ("factor", np.float64, (3, 3)), ("sensitivity", np.float64, (3, WIDEST)),
]  # fmt: skip
STEP: Final = np.dtype(
    [
        *_STATE,
        ("seen", np.float64, (3,)),
        ("keep", np.float64, (3,)),
        ("mix", np.float64, (3,)),
        ("turns", np.float64, (6, 2)),
        ("surprise", np.float64),
        ("trust", np.float64),
        ("felt", np.float64, (WIDEST,)),
    ]
)
"""What a step leaves behind for the way back. After its reading: state and factor (row j: column j of L) of
acceleration, rate and angle of the clock, sensitivity to the ripple. What the reading saw of each column and how
Carlson's update mixed them; cosines and sines of the time update's rotations (acceleration, jerk 0), (rate, 0),
(rate, 1), (angle, 0), (angle, 1), (angle, 2); innovation over its variance, the inverse of this, and how much the
innovation felt of the ripple."""
CHAIN: Final = np.dtype(
    [
        *_STATE,
        ("back_mean", np.float64, (6,)),
        ("back", np.float64, (6, 6)),
        ("back_felt", np.float64, (3, WIDEST)),
        ("lowest", np.float64),
        ("ripple", np.float64, (WIDEST,)),
        ("ripple_factor", np.float64, (WIDEST, WIDEST)),
        ("second", np.float64, (2 * WIDEST,)),
        ("basis", np.float64, (2 * WIDEST,)),
        ("gain", np.float64, (3,)),
        ("room", np.float64, (WIDEST,)),
        ("owed", np.float64, (3, WIDEST)),
        ("slopes", np.float64, (6,)),
        ("kinematic", np.float64, (6,)),
        ("common_part", np.float64, (6,)),
    ]
)
"""The filter now; mean, factor [row, column] and ripple's part of e on the way back, three jerks below; the ripple that
is taken as known, its factor, and room to work in."""


@compiled
def stand(chain: Record, waves: int, theta: float, omega: float, alpha: float, kinematic: FloatArray) -> None:
    """Put the chain where the shaft is; `kinematic` (6,) is l00 .. l22 of the factor."""
    g = _wave_at(chain, waves, theta)
    slope = 1.0 + g[1]
    chain.state[0], chain.state[1], chain.state[2] = alpha * slope + omega * omega * g[2], omega * slope, theta + g[0]
    factor = chain.factor
    factor[0, 0], factor[0, 1], factor[0, 2] = kinematic[0], kinematic[1], kinematic[2]
    factor[1, 1], factor[1, 2], factor[2, 2] = kinematic[3], kinematic[4], kinematic[5]
    for i in range(2 * waves):
        turning = chain.lowest * (i // 2 + 1) * omega
        chain.sensitivity[0, i] = -turning * turning * chain.basis[i]
        chain.sensitivity[1, i] = turning * (-chain.basis[i + 1] if i % 2 == 0 else chain.basis[i - 1])
        chain.sensitivity[2, i] = chain.basis[i]


@compiled
def _wave_at(chain: Record, waves: int, theta: float) -> tuple[float, float, float, float]:
    if waves == 0:
        return (0.0, 0.0, 0.0, 0.0)
    set_basis(theta, chain.lowest, 4 * waves, chain.basis)
    return wave(chain.ripple, chain.second, waves, chain.lowest, chain.basis)


@compiled
def ripple_at(chain: Record, waves: int, theta: float) -> float:
    """g at an angle: what a reading of the shaft lacks of its clock."""
    if waves == 0:
        return 0.0
    set_basis(theta, chain.lowest, 4 * waves, chain.basis)
    return known_part(chain.ripple, 2 * waves, chain.basis) + known_part(chain.second, 4 * waves, chain.basis)


@compiled
def know_ripple(chain: Record, status: Record, family: int) -> None:
    """Let the chain know the ripple as the filter knows it by now; its state follows the change."""
    best, width = status.best[family], 2 * WAVES[family]
    root = math.sqrt(status.scale[best])
    for i in range(width):
        chain.room[i] = status.ripple[best, i] - chain.ripple[i]
        chain.ripple[i] = status.ripple[best, i]
        for j in range(i + 1):
            chain.ripple_factor[j, i] = status.factor[best, j, i] * root
    for i in range(2 * width):
        chain.second[i] = status.second[family, i]
    acceleration, rate, angle = shift(chain.sensitivity, chain.room, width)
    chain.state[0] += acceleration
    chain.state[1] += rate
    chain.state[2] += angle


@compiled
def _rotate(x: float, y: float, turn: FloatArray) -> float:
    """Write down the rotation that turns (x, y) into (length, 0)."""
    length = math.sqrt(x * x + y * y)
    turn[0] = x / length if length > 0.0 else 1.0
    turn[1] = y / length if length > 0.0 else 0.0
    return length


@compiled
def move_on(chain: Record, at: Record, step: float, intensity: float) -> None:
    """Time update, as `kinematics.move_on`, written down."""
    mean, factor, turns = chain.state, chain.factor, at.turns
    half = 0.5 * step * step
    mean[2] += step * mean[1] + half * mean[0]
    mean[1] += step * mean[0]
    factor[0, 2] += step * factor[0, 1] + half * factor[0, 0]
    factor[0, 1] += step * factor[0, 0]
    factor[1, 2] += step * factor[1, 1]
    root = math.sqrt(intensity * step)
    a1, a2, b2 = root * step * 0.5, root * half / 3.0, root * half * HALF_JERK
    f01, f02 = factor[0, 1], factor[0, 2]
    factor[0, 0] = _rotate(factor[0, 0], root, turns[0])
    factor[0, 1], a1 = turns[0, 0] * f01 + turns[0, 1] * a1, turns[0, 0] * a1 - turns[0, 1] * f01
    factor[0, 2], a2 = turns[0, 0] * f02 + turns[0, 1] * a2, turns[0, 0] * a2 - turns[0, 1] * f02
    f11, f12 = _rotate(factor[1, 1], a1, turns[1]), factor[1, 2]
    f12, a2 = turns[1, 0] * f12 + turns[1, 1] * a2, turns[1, 0] * a2 - turns[1, 1] * f12
    factor[1, 1] = _rotate(f11, root * step * HALF_JERK, turns[2])
    factor[1, 2], b2 = turns[2, 0] * f12 + turns[2, 1] * b2, turns[2, 0] * b2 - turns[2, 1] * f12
    f22 = _rotate(_rotate(factor[2, 2], a2, turns[3]), b2, turns[4])
    factor[2, 2] = _rotate(f22, root * step * step * LAST_JERK, turns[5])


@compiled
def _correct(chain: Record, at: Record, off: float, noise: float) -> None:
    """Carlson's measurement update by an innovation, as `kinematics.correct`, written down."""
    mean, factor, gain = chain.state, chain.factor, chain.gain
    spread = factor[0, 2] ** 2 + factor[1, 2] ** 2 + factor[2, 2] ** 2
    gain[0] = gain[1] = gain[2] = 0.0
    total = max(noise, off * off / WIDE - spread)
    for back in range(3):
        j = 2 - back
        seen = factor[j, 2]
        more = total + seen * seen
        part = 1.0 / math.sqrt(total * more)
        keep, mix = total * part, seen * part
        at.seen[j], at.keep[j], at.mix[j] = seen, keep, mix
        total = more
        for i in range(j, 3):
            old = factor[j, i]
            factor[j, i] = keep * old - mix * gain[i]
            gain[i] += old * seen
    at.surprise, at.trust = off / total, 1.0 / total
    for i in range(3):
        gain[i] *= at.trust
        mean[i] += gain[i] * off


@compiled
def take_clock(chain: Record, at: Record, reading: float, noise: float) -> None:
    """A reading of the clock, the ripple taken as known; noise 0: none. The state is written down."""
    if noise > 0.0:
        _correct(chain, at, reading - chain.state[2], noise)
    else:
        _pass_by(at)
    for i in range(3):
        at.state[i] = chain.state[i]
        for j in range(i + 1):
            at.factor[j, i] = chain.factor[j, i]


@compiled
def _pass_by(at: Record) -> None:
    for i in range(3):
        at.seen[i], at.keep[i], at.mix[i] = 0.0, 1.0, 0.0
    at.surprise = at.trust = 0.0


@compiled
def carry_sensitivity(chain: Record, at: Record, waves: int, step: float, theta: float) -> None:
    """Sensitivity to the ripple through the step that was just made, with a reading at the angle `theta`."""
    width = 2 * waves
    set_basis(theta, chain.lowest, width, chain.basis)
    feel(chain.sensitivity, chain.ripple, chain.ripple_factor, step, ANGLE, chain.basis, at.felt, width)
    if at.trust > 0.0:
        absorb(chain.sensitivity, at.felt, chain.gain[0], chain.gain[1], chain.gain[2], width)
    for row in range(3):
        for i in range(width):
            at.sensitivity[row, i] = chain.sensitivity[row, i]


@compiled
def turn_round(chain: Record) -> None:
    """Begin the way back: at the last step the filter knows all."""
    for i in range(3):
        chain.back_mean[i] = 0.0
        for w in range(WIDEST):
            chain.back_felt[i, w] = 0.0
        for j in range(3):
            chain.back[i, j] = 1.0 if i == j else 0.0


@compiled
def step_back(chain: Record, at: Record, width: int, jerk: FloatArray) -> None:
    """From after the reading of a step to after that of the step before.

    `jerk` (2,) becomes what the step's white jerk, of unit variance beforehand, turned out to be: its mean squared, and
    how much of its variance the readings took away (of 3 degrees of freedom both).
    """
    mean, back = chain.back_mean, chain.back
    carried = carry0 = carry1 = carry2 = 0.0
    for i in range(3):
        seen, keep, mix = at.seen[i], at.keep[i], at.mix[i]
        old, b0, b1, b2 = mean[i], back[i, 0], back[i, 1], back[i, 2]
        mean[i] = seen * (at.surprise - carried) + keep * old
        back[i, 0], back[i, 1], back[i, 2] = (
            keep * b0 - seen * carry0,
            keep * b1 - seen * carry1,
            keep * b2 - seen * carry2,
        )
        carried += mix * old
        carry0 += mix * b0
        carry1 += mix * b1
        carry2 += mix * b2
    if width > 0:
        _feel_back(chain.back_felt, at.felt, at.trust, at.seen, at.keep, at.mix, at.turns, width)
    _undo_motion(mean, back, at.turns)
    squares, left = 0.0, 0.0
    for r in range(3, 6):
        squares += mean[r] ** 2
        for j in range(6):
            left += back[r, j] ** 2
    jerk[0], jerk[1] = squares, max(3.0 - left, 0.0)
    _make_triangle(back)


@compiled
def _feel_back(
    felt_by: FloatArray, felt: FloatArray, trust: float, seen: FloatArray, keep: FloatArray, mix: FloatArray,
    turns: FloatArray, width: int,
) -> None:  # fmt: skip
    """The ripple's part (3, .) of e through reading and motion, as the mean goes; from the jerks nothing is kept."""
    for w in range(width):
        surprise = trust * felt[w]
        x0, x1, x2 = felt_by[0, w], felt_by[1, w], felt_by[2, w]
        carried = mix[0] * x0
        a = seen[0] * surprise + keep[0] * x0
        b = seen[1] * (surprise - carried) + keep[1] * x1
        carried += mix[1] * x1
        c = seen[2] * (surprise - carried) + keep[2] * x2
        e = turns[4, 1] * turns[5, 0] * c
        c = turns[4, 0] * turns[5, 0] * c
        f = turns[3, 1] * c
        c = turns[3, 0] * c
        b, e = turns[2, 0] * b - turns[2, 1] * e, turns[2, 1] * b + turns[2, 0] * e
        b, f = turns[1, 0] * b - turns[1, 1] * f, turns[1, 1] * b + turns[1, 0] * f
        a = turns[0, 0] * a - turns[0, 1] * f
        felt_by[0, w], felt_by[1, w], felt_by[2, w] = a, b, c


@compiled
def _undo_motion(mean: FloatArray, back: FloatArray, turns: FloatArray) -> None:
    """Rows acceleration, rate, angle and three of jerk; columns of e, then of the jerk that was left."""
    for r in range(3):
        mean[3 + r] = 0.0
        for j in range(3):
            back[r, 3 + j] = back[3 + r, j] = back[3 + r, 3 + j] = 0.0
        back[3 + r, 3 + r] = 1.0
    for again in range(6):
        which = 5 - again
        row = 2 if which > 2 else (1 if which > 0 else 0)
        other = 5 if which == 5 else (4 if which == 4 or which == 2 else 3)
        c, z = turns[which, 0], turns[which, 1]
        x, y = mean[row], mean[other]
        mean[row], mean[other] = c * x - z * y, z * x + c * y
        for j in range(6):
            x, y = back[row, j], back[other, j]
            back[row, j] = c * x - z * y
            back[other, j] = z * x + c * y


@compiled
def _make_triangle(back: FloatArray) -> None:
    """Reflect the columns so that the first three rows become a triangle again (Householder 1958)."""
    for r in range(3):
        squares = 0.0
        for j in range(r, 6):
            squares += back[r, j] ** 2
        corner = -math.sqrt(squares) if back[r, r] > 0.0 else math.sqrt(squares)
        pivot, size = back[r, r] - corner, squares - corner * back[r, r]
        for q in range(r + 1, 3 if size > 0.0 else r + 1):
            part = pivot * back[q, r]
            for j in range(r + 1, 6):
                part += back[r, j] * back[q, j]
            part /= size
            back[q, r] -= part * pivot
            for j in range(r + 1, 6):
                back[q, j] -= part * back[r, j]
        back[r, r] = corner
        for j in range(r + 1, 6):
            back[r, j] = 0.0


@compiled
def tell(chain: Record, at: Record, waves: int, about: float, row: FloatArray, covariance: FloatArray) -> None:
    """Angle (near `about`), speed, acceleration (3,) and covariance (9,) after a step, all readings considered."""
    told, by, mean, factor, owed = chain.gain, chain.back, chain.back_mean, at.factor, chain.sensitivity
    g = _wave_at(chain, waves, about)
    for i in range(3):
        told[i] = at.state[i]
        for j in range(i + 1):
            told[i] += factor[j, i] * mean[j]
    row[0], row[1], row[2] = shaft_state(told[2], told[1], told[0], about, g, chain.slopes)
    part = chain.common_part
    for place in range(6):
        part[place] = 0.0
    if waves > 0:
        for i in range(2 * waves):
            x0, x1, x2 = chain.back_felt[0, i], chain.back_felt[1, i], chain.back_felt[2, i]
            owed[0, i] = at.sensitivity[0, i] + factor[0, 0] * x0
            owed[1, i] = at.sensitivity[1, i] + factor[0, 1] * x0 + factor[1, 1] * x1
            owed[2, i] = at.sensitivity[2, i] + factor[0, 2] * x0 + factor[1, 2] * x1 + factor[2, 2] * x2
        owe(chain, waves, owed, chain.ripple_factor)
    covariance[0], covariance[1], covariance[2] = part[0], part[1], part[2]
    covariance[4], covariance[5], covariance[8] = part[3], part[4], part[5]
    for j in range(3):
        acceleration = factor[0, 0] * by[0, j]
        rate = factor[0, 1] * by[0, j] + factor[1, 1] * by[1, j]
        angle = factor[0, 2] * by[0, j] + factor[1, 2] * by[1, j] + factor[2, 2] * by[2, j]
        d0, d1, d2 = gradient(angle, rate, acceleration, 0.0, 0.0, 0.0, chain.slopes)
        covariance[0] += d0 * d0
        covariance[1] += d0 * d1
        covariance[2] += d0 * d2
        covariance[4] += d1 * d1
        covariance[5] += d1 * d2
        covariance[8] += d2 * d2
    covariance[3], covariance[6], covariance[7] = covariance[1], covariance[2], covariance[5]
