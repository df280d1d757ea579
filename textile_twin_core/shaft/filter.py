"""State and error matrix of the recursive shaft filter, and the steps of linear algebra on them."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.hypotheses import HypothesisBank, Verdict
from textile_twin_core.shaft.past import Estimate, Past
from textile_twin_core.shaft.ripple import (
    DIP,
    DIP_RATE,
    FIRST_RIPPLE,
    LEVEL,
    LOG_LONGEST,
    LOG_RESPONSE,
    LOG_SHORTEST,
    SLOPE,
    THETA,
    Ripple,
    advance,
    blank_gradient,
    observe,
)

RIPPLE_AT_START = 0.03
RIPPLE_AFTER_DOUBT = 4e-4
"""Events that are half believed, or come in crowds, open the ripple's coefficients by up to this much, so that a wrong
ripple cannot live on as a row of events. One event beyond doubt says nothing against the ripple."""
LARGEST_RIPPLE = 0.3
LOG_RESPONSE_VARIANCE = 0.1
LONGEST_ARC = 0.3
"""Of the highest order's wave in one integration step [rad]."""
MOST_PARTS = 8


class ShaftFilter:
    """The filter's state, how far off it may be, and how far off it is under each hypothesis.

    Row by row the error matrix holds the state and below it theta of all held samples, then their omega, then alpha;
    column by column the state's covariance and one column per hypothesis. Every step is made on the whole, so that held
    samples are smoothed (fixed-lag smoother, Biswas and Mahalanabis 1973) and hypotheses are weighed on the way.

    Attributes:
        state: the n numbers of `ripple`.
        error: (n + 3 held, n + hypotheses).
        orders: orders of ripple in the state.
        ripple: the ripple at the state's angle.
    """

    def __init__(self, orders: list[int], response_s: float, bank: HypothesisBank, past: Past | None) -> None:
        self.orders, self.bank, self.past = orders, bank, past
        size = FIRST_RIPPLE + 2 * len(orders)
        self.state = [0.0] * size
        self.state[LOG_RESPONSE] = math.log(response_s)
        self._resize(np.zeros((size, size + bank.columns)))

    def _resize(self, error: FloatArray) -> None:
        self.size = size = len(self.state)
        self._highest = max(self.orders, default=1)
        self._transition = np.eye(size)
        self._gradient = blank_gradient(size)
        self._use(error)
        self.look()

    def _use(self, error: FloatArray) -> None:
        """Take an error matrix, the views of it that every sample needs, and room for its changes."""
        size = self.size
        self.error, self._change = error, np.empty_like(error)
        self._own, self._own_change = error[:size], self._change[:size]
        self._by_state = error[:, :size]

    def look(self) -> None:
        """Bring the ripple to the state's angle."""
        self.ripple = Ripple(self.state[THETA], self.orders, self.state[FIRST_RIPPLE:])

    @property
    def angle(self) -> float:
        """The state's angle [rad], local."""
        return self.state[THETA]

    @property
    def level(self) -> float:
        """The slow part of the speed [rad/s]."""
        return self.state[LEVEL]

    @property
    def speed(self) -> float:
        """The speed [rad/s]."""
        return (self.state[LEVEL] + self.state[DIP]) * self.ripple.value

    def _shift(self, by: FloatArray) -> None:
        self.state = [value + change for value, change in zip(self.state, by.tolist(), strict=True)]

    @property
    def speed_gradient(self) -> FloatArray:
        """(n,) derivative of the speed last looked at by the state."""
        row: FloatArray = self._gradient[1]
        return row

    @property
    def hypotheses(self) -> FloatArray:
        """The error's columns that belong to the bank, rows of held samples included."""
        return self.error[:, self.size :]

    # Time and readings

    def start(self, angle: float, speed: float, first: bool, scale: float, sigma: float) -> None:
        """Begin anew at an angle known to `sigma`, with a guess of the speed; ripple and drive stay unless `first`."""
        state, error, size = self.state, self.error, self.size
        ripple = error[FIRST_RIPPLE:size, FIRST_RIPPLE:size].copy()
        response = LOG_RESPONSE_VARIANCE if first else float(error[LOG_RESPONSE, LOG_RESPONSE])
        error[:] = 0.0
        self.bank.clear(self.hypotheses)
        state[THETA], state[LEVEL] = angle, speed
        state[SLOPE] = state[DIP] = state[DIP_RATE] = 0.0
        if first:
            state[FIRST_RIPPLE:] = [0.0] * (size - FIRST_RIPPLE)
        at = np.arange(FIRST_RIPPLE, size)
        if not first:
            error[FIRST_RIPPLE:size, FIRST_RIPPLE:size] = ripple
        error[at, at] += RIPPLE_AT_START**2 if first else 1e-6
        error[THETA, THETA] = sigma**2
        error[LEVEL, LEVEL] = (0.3 * scale) ** 2
        error[SLOPE, SLOPE] = (0.5 * scale) ** 2
        error[LOG_RESPONSE, LOG_RESPONSE] = response

    def start_from_two(self, variance: float, step: float) -> None:
        """The speed came from two readings of this variance."""
        error = self.error
        error[THETA, THETA] = variance
        error[LEVEL, LEVEL] = 2.0 * variance / step**2
        error[THETA, LEVEL] = error[LEVEL, THETA] = variance / step

    def predict(self, step: float, idle_ripple: bool) -> float:
        """Move on by `step` seconds; the angle moved. `idle_ripple`: whether idle orders gather evidence."""
        size, state, transition = self.size, self.state, self._transition
        arc = abs(state[LEVEL]) * step * self._highest
        parts = 1 + min(int(arc / LONGEST_ARC), MOST_PARTS - 1)
        before = state[THETA]
        for part in range(parts):
            if part:
                self.look()
            advance(state, self.ripple, step / parts, transition)
            self._own[:] = np.dot(transition, self._own, self._own_change)
            self._by_state[:] = np.dot(self._by_state, transition.T)
        moved = state[THETA] - before
        if idle_ripple and self.bank.idle:
            self.error[THETA, size + self.bank.events :] += self.bank.idle_waves(before + moved / 2.0) * moved
        return moved

    def disturb(self, jerk: float, burst: float, step: float) -> None:
        """Add the process noise of a step: variance `jerk` on V' (with what it makes of V), `burst` on w'."""
        error = self.error
        error[SLOPE, SLOPE] += jerk
        error[LEVEL, SLOPE] += jerk * step / 2.0
        error[SLOPE, LEVEL] += jerk * step / 2.0
        error[LEVEL, LEVEL] += jerk * step * step / 3.0
        error[DIP_RATE, DIP_RATE] += burst

    def angle_row(self) -> tuple[FloatArray, FloatArray]:
        """What a reading of the angle sees: its row of the error matrix, and the column that it is spread by."""
        column = self.error[:, THETA]
        seen = self.error[THETA].copy()
        seen[: self.size] = column[: self.size]  # so that rounding cannot make the covariance drift out of symmetry
        return seen, column

    def speed_row(self) -> tuple[float, FloatArray, FloatArray]:
        """The speed, and what a reading of it sees."""
        self.look()
        _, omega, _ = observe(self.state, self.ripple, self._gradient)
        gradient = self._gradient[1]
        return omega, gradient @ self._own, self._by_state @ gradient

    def correct(self, seen: FloatArray, gain: FloatArray, innovation: float, variance: float) -> None:
        """Take in one reading."""
        size = self.size
        if self.past is not None:
            self.past.mend(gain[size:], innovation, variance)
        self._shift(gain[:size] * innovation)
        self.error -= np.dot(gain[:, None], seen[None, :], self._change)  # faster than the product of numpy's arrays
        self.bank.see(seen[size:], innovation, variance)

    # States out

    def observed(self) -> tuple[tuple[float, float, float], FloatArray, FloatArray]:
        """(theta, omega, alpha), their rows of the error matrix, and their covariance."""
        motion = observe(self.state, self.ripple, self._gradient)
        across = np.dot(self._gradient, self._own)
        return motion, across, np.dot(across[:, : self.size], self._gradient.T)

    def blend(self, rows: FloatArray, verdict: Verdict) -> tuple[FloatArray, FloatArray]:
        """Shift and spread that the hypotheses add to a state with the given (3, columns) rows of the error matrix."""
        events = rows[:, self.size : self.size + self.bank.events]
        shift = events @ verdict.mean
        return shift, (events * verdict.moment) @ events.T - shift[:, None] * shift

    def hold(self, past: Past, estimate: Estimate, across: FloatArray) -> None:
        """Keep a state open to later samples."""
        size, columns = self.size, self.error.shape[1]
        if past.full:
            old = self.error[size:].reshape(3, past.capacity, columns)
            order = past.grow()
            held = np.zeros((3, past.capacity, columns))
            held[:, : order.size] = old[:, order]
            self._use(np.concatenate([self._own, held.reshape(-1, columns)]))
        self.error[size + past.push(estimate) :: past.capacity] = across

    def let_go(self, past: Past, verdict: Verdict | None) -> Estimate:
        """The state held longest, as it now stands."""
        rows = self.error[self.size + past.oldest :: past.capacity]
        estimate = past.pop()
        if verdict is not None:
            estimate.move(*self.blend(rows, verdict))
        rows[:] = 0.0
        return estimate

    # What has been learnt

    def take_in(self, verdict: Verdict, crowding: float) -> None:
        """Replace the mixture of what may have happened by one Gaussian, of the same mean and covariance.

        `crowding`, 0 to 1: how far such events follow each other too closely to be what they seem.
        """
        size, error, bank = self.size, self.error, self.bank
        columns = error[:, size : size + bank.events]
        shift = columns @ verdict.mean
        error[:, :size] += (columns * verdict.moment) @ columns[:size].T - shift[:, None] * shift[:size]
        if self.past is not None:
            self.past.widen(columns[size:], verdict.moment)
            self.past.mend(shift[size:], 1.0, 1.0)
        self._shift(shift[:size])
        self.open_ripple(RIPPLE_AFTER_DOUBT * max(crowding, math.sqrt(1.0 - min(verdict.weight, 1.0))))
        bank.clear(self.hypotheses)  # the idle orders too: an event looks like some of each
        self.look()

    def take_in_order(self, place: int) -> None:
        """Make one of the bank's idle orders of ripple part of the state."""
        size, bank = self.size, self.bank
        at = size + bank.events + 2 * place
        columns = self.error[:, at : at + 2]
        order, mean, variance = bank.remove_order(place)
        shift, own = columns @ mean, columns * variance
        block = self.error[:, :size] + own @ columns[:size].T
        kept = np.delete(self.error[:, size:], [at - size, at - size + 1], axis=1)
        rows = np.zeros((2, size + 2 + kept.shape[1]))
        rows[:, :size] = own[:size].T
        rows[:, size : size + 2] = np.diag(variance)
        wide = np.concatenate([block, own, kept], axis=1)
        if self.past is not None:
            self.past.widen(columns[size:], variance)
            self.past.mend(shift[size:], 1.0, 0.0)
        self._shift(shift[:size])
        self.state += mean.tolist()
        self.orders.append(order)
        self._resize(np.concatenate([wide[:size], rows, wide[size:]]))

    def open_motion(self, level: float, slope: float, rate: float) -> None:
        """Let speed level, its slope and the dip's rate change by so much (standard deviations)."""
        for place, sigma in ((LEVEL, level), (SLOPE, slope), (DIP_RATE, rate)):
            self.error[place, place] += sigma**2

    def open_ripple(self, sigma: float) -> None:
        """Let the ripple's coefficients change by so much, within what they were trusted to be at the start."""
        at = np.arange(FIRST_RIPPLE, self.size)
        own = self.error[at, at]
        self.error[at, at] = np.maximum(own, np.minimum(own + sigma**2, RIPPLE_AT_START**2))

    def tend(self) -> None:
        """Now and then: keep the covariance symmetric and open, ripple and response within what a machine can have."""
        size, error, state = self.size, self.error, self.state
        error[:size, :size] = (error[:size, :size] + error[:size, :size].T) / 2.0
        at = np.arange(FIRST_RIPPLE, size)
        error[at, at] += 3e-13
        if max(map(abs, state[FIRST_RIPPLE:]), default=0.0) > LARGEST_RIPPLE:  # what looked like ripple was none
            state[FIRST_RIPPLE:] = [0.0] * (size - FIRST_RIPPLE)
            error[at] = 0.0
            error[:, at] = 0.0
            error[at, at] = RIPPLE_AT_START**2
        variance = float(error[LOG_RESPONSE, LOG_RESPONSE]) + 1e-6
        error[LOG_RESPONSE, LOG_RESPONSE] = min(variance, LOG_RESPONSE_VARIANCE)
        state[LOG_RESPONSE] = min(max(state[LOG_RESPONSE], LOG_SHORTEST), LOG_LONGEST)

    def amplitudes(self) -> tuple[float, ...]:
        """Relative amplitude of the ripple by order, from order 1 on."""
        ripple = self.state[FIRST_RIPPLE:]
        size = dict(zip(self.orders, map(math.hypot, ripple[0::2], ripple[1::2]), strict=True))
        return tuple(size.get(k, 0.0) for k in range(1, max(self.orders, default=0) + 1))
