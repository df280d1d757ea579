"""One Kalman filter with an intensity of its own at each step, forwards and back: what smoothing is made of.

Backwards everything is told in coordinates e in which the filter's covariance is the identity: x = mean + L e. From a
sample to the one before, mean and factor of e go through the same rotations and triangles as the filter did, turned
round (after Dyer and McReynolds 1969; Bierman 1983): no covariance can become negative, nothing is inverted, and the
white jerk is smoothed on the way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import WIDE
from textile_twin_core.shaft.clock import known_part, observe, set_basis
from textile_twin_core.shaft.factor import HALF_JERK, LAST_JERK

TURNS = 6
"""Rotations of a time update: (acceleration, jerk 0), (rate, 0), (rate, 1), (angle, 0), (angle, 1), (angle, 2)."""


HEADER = 4
NOW, BACK, GAIN, CARRY, TOLD = range(5)
"""Of `vectors`: mean of the filter now; mean of e on the way back; then room to work in."""
SEEN, KEEP, MIX = range(3)
"""Of `updates`: what the reading saw of each column, and how Carlson's update mixed them."""
SURPRISE = 2 * TURNS
"""Of `turns`, after cosines and sines: innovation over its variance."""


class Chain(NamedTuple):
    """A filter of n states on its way, and what its steps left behind for the way back.

    Attributes:
        head: (4,) waves, steps, n, lowest order.
        vectors: (5, n, 1) see `NOW`.
        factor: (n, n, 1) of now, laid out as in `factor`; back: (n, n) that of e, [row, column].
        means, factors: (s, n), (s, n, n) after the reading of each step.
        updates: (s, 3, n) see `SEEN`; turns: (s, 13) of the time updates.
        second, basis: of the clock.
        block, gradient, wave, state: room to work in.
    """

    head: FloatArray
    vectors: FloatArray
    factor: FloatArray
    back: FloatArray
    means: FloatArray
    factors: FloatArray
    updates: FloatArray
    turns: FloatArray
    second: FloatArray
    basis: FloatArray
    block: FloatArray
    gradient: FloatArray
    wave: FloatArray
    state: FloatArray


def chain_room(waves: int, cycle_turns: float, steps: int) -> FloatArray:
    """Room for a chain with so many orders of ripple and so many steps (see `bank.bank_room`)."""
    n = 2 * waves + 3
    size = HEADER + 5 * n + 2 * n * n + steps * (n + n * n + 3 * n + SURPRISE + 1) + 8 * waves
    room = np.zeros(size + TURNS * (n + 4) + 3 * n + 7)
    room[:HEADER] = waves, steps, n, 1.0 / cycle_turns
    return room


@compiled
def open_chain(room: FloatArray) -> Chain:
    """The chain that lives in a room."""
    waves, steps, n = int(room[0]), int(room[1]), int(room[2])
    a = HEADER + 5 * n
    b = a + n * n
    c = b + n * n
    d = c + steps * n
    e = d + steps * n * n
    f = e + steps * 3 * n
    g = f + steps * (SURPRISE + 1)
    h = g + 4 * waves
    i = h + 4 * waves
    j = i + TURNS * (n + 4)
    k = j + 3 * n
    return Chain(
        room[:HEADER], room[HEADER:a].reshape((5, n, 1)), room[a:b].reshape((n, n, 1)), room[b:c].reshape((n, n)),
        room[c:d].reshape((steps, n)), room[d:e].reshape((steps, n, n)), room[e:f].reshape((steps, 3, n)),
        room[f:g].reshape((steps, SURPRISE + 1)), room[g:h], room[h:i], room[i:j].reshape((TURNS, n + 4)),
        room[j:k].reshape((3, n)), room[k : k + 4], room[k + 4 : k + 7],
    )  # fmt: skip


@compiled
def _rotate(x: float, y: float, turns: FloatArray, which: int) -> float:
    """Write down the rotation that turns (x, y) into (length, 0)."""
    length = math.sqrt(x * x + y * y)
    turns[2 * which] = x / length if length > 0.0 else 1.0
    turns[2 * which + 1] = y / length if length > 0.0 else 0.0
    return length


@compiled
def step_on(chain: Chain, s: int, step: float, intensity: float, reading: float, at: float, noise: float) -> None:
    """Time update, then a reading taken at about the angle `at`; step s is written down. noise 0: no reading."""
    mean, factor, turns = chain.vectors[NOW, :, 0], chain.factor[:, :, 0], chain.turns[s]
    n = mean.size
    acc, rate, angle = n - 3, n - 2, n - 1
    half = 0.5 * step * step
    mean[angle] += step * mean[rate] + half * mean[acc]
    mean[rate] += step * mean[acc]
    for j in range(n - 2):
        factor[j, angle] += step * factor[j, rate] + half * factor[j, acc]
        factor[j, rate] += step * factor[j, acc]
    factor[rate, angle] += step * factor[rate, rate]
    root = math.sqrt(intensity * step)
    a1, a2, b2 = root * step * 0.5, root * half / 3.0, root * half * HALF_JERK
    f01, f02 = factor[acc, rate], factor[acc, angle]
    factor[acc, acc] = _rotate(factor[acc, acc], root, turns, 0)
    factor[acc, rate], a1 = turns[0] * f01 + turns[1] * a1, turns[0] * a1 - turns[1] * f01
    factor[acc, angle], a2 = turns[0] * f02 + turns[1] * a2, turns[0] * a2 - turns[1] * f02
    f11, f12 = _rotate(factor[rate, rate], a1, turns, 1), factor[rate, angle]
    f12, a2 = turns[2] * f12 + turns[3] * a2, turns[2] * a2 - turns[3] * f12
    factor[rate, rate] = _rotate(f11, root * step * HALF_JERK, turns, 2)
    factor[rate, angle], b2 = turns[4] * f12 + turns[5] * b2, turns[4] * b2 - turns[5] * f12
    f22 = _rotate(_rotate(factor[angle, angle], a2, turns, 3), b2, turns, 4)
    factor[angle, angle] = _rotate(f22, root * step * step * LAST_JERK, turns, 5)
    if noise > 0.0:
        _correct(chain, s, reading, at, noise)
    else:
        chain.updates[s] = 0.0
        chain.updates[s, KEEP] = 1.0
        turns[SURPRISE] = 0.0
    for i in range(n):
        chain.means[s, i] = mean[i]
        for j in range(i + 1):
            chain.factors[s, j, i] = factor[j, i]


@compiled
def _correct(chain: Chain, s: int, reading: float, at: float, noise: float) -> None:
    """Carlson's measurement update, as `factor.correct`, written down."""
    mean, factor, gain = chain.vectors[NOW, :, 0], chain.factor[:, :, 0], chain.vectors[GAIN, :, 0]
    basis, update = chain.basis, chain.updates[s]
    n = mean.size
    set_basis(at, chain.head[3], basis)
    off = reading + known_part(chain.second, basis) - mean[n - 1]
    for i in range(n - 3):
        off += basis[i] * mean[i]
    spread = 0.0
    for j in range(n):
        seen = factor[j, n - 1]
        for i in range(j, n - 3):
            seen -= basis[i] * factor[j, i]
        update[SEEN, j] = seen
        spread += seen * seen
    gain[:] = 0.0
    total = max(noise, off * off / WIDE - spread)
    for back in range(n):
        j = n - 1 - back
        seen = update[SEEN, j]
        more = total + seen * seen
        part = 1.0 / math.sqrt(total * more)
        keep, mix = total * part, seen * part
        update[KEEP, j], update[MIX, j] = keep, mix
        total = more
        for i in range(j, n):
            old = factor[j, i]
            factor[j, i] = keep * old - mix * gain[i]
            gain[i] += old * seen
    chain.turns[s, SURPRISE] = off / total
    for i in range(n):
        mean[i] += gain[i] * (off / total)


@compiled
def stand_at(chain: Chain, s: int) -> None:
    """Put the chain back to where it was after step s."""
    n = chain.back.shape[0]
    chain.vectors[NOW, :, 0] = chain.means[s]
    for i in range(n):
        for j in range(i + 1):
            chain.factor[j, i, 0] = chain.factors[s, j, i]


@compiled
def turn_round(chain: Chain) -> None:
    """Begin the way back: at the last step the filter knows all."""
    chain.vectors[BACK] = 0.0
    chain.back[:, :] = 0.0
    for i in range(chain.back.shape[0]):
        chain.back[i, i] = 1.0


@compiled
def step_back(chain: Chain, s: int, jerk: FloatArray) -> None:
    """From after the reading of step s to after that of the step before.

    `jerk` (2,) becomes what the step's white jerk, of unit variance beforehand, turned out to be: its mean squared, and
    how much of its variance the readings took away (of 3 degrees of freedom both).
    """
    mean, back, carry = chain.vectors[BACK, :, 0], chain.back, chain.vectors[CARRY, :, 0]
    update, surprise = chain.updates[s], chain.turns[s, SURPRISE]
    carried = 0.0
    carry[:] = 0.0
    for i in range(mean.size):
        seen, keep, mix = update[SEEN, i], update[KEEP, i], update[MIX, i]
        old = mean[i]
        mean[i] = seen * (surprise - carried) + keep * old
        carried += mix * old
        for j in range(i + 1):
            value = back[i, j]
            back[i, j] = keep * value - seen * carry[j]
            carry[j] += mix * value
    _undo_motion(chain, s, jerk)


@compiled
def _undo_motion(chain: Chain, s: int, jerk: FloatArray) -> None:
    """Rows acceleration, rate, angle and three of jerk; columns of e, then of the jerk that was left; last the mean."""
    mean, back, block = chain.vectors[BACK, :, 0], chain.back, chain.block
    n = mean.size
    block[:, :] = 0.0
    for r in range(3):
        for j in range(n - 2 + r):
            block[r, j] = back[n - 3 + r, j]
        block[r, n + 3] = mean[n - 3 + r]
        block[3 + r, n + r] = 1.0
    for again in range(TURNS):
        which = TURNS - 1 - again
        row = 2 if which > 2 else (1 if which > 0 else 0)
        other = 5 if which == 5 else (4 if which == 4 or which == 2 else 3)
        c, z = chain.turns[s, 2 * which], chain.turns[s, 2 * which + 1]
        for j in range(n + 4):
            x, y = block[row, j], block[other, j]
            block[row, j] = c * x - z * y
            block[other, j] = z * x + c * y
    squares, spread = 0.0, 0.0
    for r in range(3, TURNS):
        squares += block[r, n + 3] ** 2
        for j in range(n + 3):
            spread += block[r, j] ** 2
    jerk[0], jerk[1] = squares, max(3.0 - spread, 0.0)
    for r in range(3):  # to a triangle again
        at = n - 3 + r
        for j in range(at + 1, n + 3):
            length = math.sqrt(block[r, at] ** 2 + block[r, j] ** 2)
            if block[r, j] == 0.0 or length == 0.0:
                continue
            c, z = block[r, at] / length, block[r, j] / length
            for q in range(r, 3):
                x, y = block[q, at], block[q, j]
                block[q, at] = c * x + z * y
                block[q, j] = c * y - z * x
        mean[at] = block[r, n + 3]
        for j in range(at + 1):
            back[at, j] = block[r, j]


@compiled
def tell(chain: Chain, s: int, about: float, row: FloatArray, covariance: FloatArray) -> None:
    """Angle (near `about`), speed, acceleration (3,) and covariance (9,) after step s, all readings considered."""
    told, back, gradient, by = chain.vectors[TOLD], chain.back, chain.gradient, chain.state
    n = back.shape[0]
    for i in range(n):
        value = chain.means[s, i]
        for j in range(i + 1):
            value += chain.factors[s, j, i] * chain.vectors[BACK, j, 0]
        told[i, 0] = value
    now = chain.factors[s].reshape((n, n, 1))
    set_basis(about, chain.head[3], chain.basis)
    observe(told, now, 0, chain.head[3], chain.basis, chain.second, about, chain.wave, row, gradient)
    covariance[:] = 0.0
    for j in range(n):
        by[:] = 0.0
        for i in range(j, n):
            for p in range(3):
                by[p] += gradient[p, i] * back[i, j]
        for p in range(3):
            for q in range(3):
                covariance[3 * p + q] += by[p] * by[q]
