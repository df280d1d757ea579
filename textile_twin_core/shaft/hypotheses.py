"""What may have happened to the shaft of late: a bank of events of unknown time and size, weighed by the innovations.

Each hypothesis is one column of the filter's error: how far the filter, which knows nothing of the event, is off per
unit of the event's size. The innovation sees the column's first row, so that size and evidence of every hypothesis
follow from two running sums (Willsky and Jones 1976, generalised likelihood ratio; weighed here as in a Gaussian sum,
Alspach and Sorenson 1972). Kinds: a load knock (impulse on the drive's response), a ramp (lasting change of the
acceleration), one more order of ripple.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.ripple import DIP_RATE, SLOPE

RAMPS_PER_KNOCK = 0.02
EVIDENCE_FOR_ORDER = 9.0
"""Log likelihood ratio from which an order of ripple is taken into the state."""
RIPPLE_PRIOR = 0.01
LEAVING = 0.05
"""Weight from which events may not be forgotten but must be taken in."""


@dataclass(frozen=True)
class Verdict:
    """What the innovations say: the weight of any event, and of each its weight and its size's weighted moments."""

    weight: float
    weights: FloatArray
    mean: FloatArray
    moment: FloatArray


class HypothesisBank:
    """Columns: `width` knocks, `width` ramps (both in rings by time of birth), two for each idle order of ripple."""

    def __init__(self, width: int, idle_orders: list[int]) -> None:
        self.width = width
        self.events = 2 * width
        self._set_idle(idle_orders)
        self.columns = self.events + 2 * len(idle_orders)
        self.information = np.zeros(self.columns)
        self.score = np.zeros(self.columns)
        self._odds = np.zeros(self.events)
        self._prior = 0.0
        self._spread, self._mean, self._likelihood = np.zeros((3, self.events))
        self._all = 1.0
        self.next = 0

    def _set_idle(self, orders: list[int]) -> None:
        self.idle = orders
        self._multiples = np.repeat(orders, 2).astype(np.float64)
        self._phases = np.tile([0.0, math.pi / 2.0], len(orders))

    def idle_waves(self, angle: float) -> FloatArray:
        """(2 idle orders,) cos, sin of each idle order at an angle, alternating."""
        waves: FloatArray = np.cos(self._multiples * angle - self._phases)
        return waves

    def born(self, columns: FloatArray, probability: float) -> None:
        """Let an event begin now, in place of the oldest; `columns` are the filter's error columns, in place."""
        knock, ramp = self.next, self.next + self.width
        both = slice(knock, self.events, self.width)
        columns[:, both] = 0.0
        columns[DIP_RATE, knock] = columns[SLOPE, ramp] = 1.0
        self.information[both] = 0.0
        self.score[both] = 0.0
        forgotten = float(self._odds[knock] + self._odds[ramp])
        self._odds[knock], self._odds[ramp] = probability, probability * RAMPS_PER_KNOCK
        self._prior += probability * (1.0 + RAMPS_PER_KNOCK) - forgotten
        self.next = (self.next + 1) % self.width

    def see(self, seen: FloatArray, innovation: float, variance: float) -> None:
        """Take in one innovation; `seen` is what it holds of each column per unit size."""
        per = seen / variance
        self.information += per * seen
        self.score += per * innovation

    def weigh(self, size: float) -> float:
        """The weight of any event having happened, their sizes being of standard deviation `size` beforehand.

        A weight that is surely below `LEAVING` is not worked out: a bound of it is returned.
        """
        spread, mean, likelihood = self._spread, self._mean, self._likelihood
        score = self.score[: self.events]
        np.add(self.information[: self.events], 1.0 / (size * size), spread)
        np.reciprocal(spread, spread)
        np.multiply(spread, score, mean)
        np.multiply(mean, score, likelihood)
        top = float(likelihood[likelihood.argmax()])
        nothing = math.exp(-0.5 * top)
        if self._prior < LEAVING * nothing:
            return self._prior / nothing
        # The likelihood ratio, exp(mean * score / 2) * sqrt(spread) / size, but for a factor that all share.
        likelihood -= top
        np.exp(likelihood, likelihood)
        likelihood *= spread
        np.sqrt(likelihood, likelihood)
        total = float(self._odds.dot(likelihood))
        self._all = total + size * nothing
        return total / self._all

    def verdict(self, weight: float) -> Verdict:
        """What was found when the events were weighed last, in detail; `weight` was that of any event."""
        weights = self._odds * self._likelihood / self._all
        mean = weights * self._mean
        return Verdict(weight, weights, mean, weights * self._spread + mean * self._mean)

    def leaving(self, verdict: Verdict) -> bool:
        """Whether the hypotheses that are replaced next still carry weight."""
        after = (self.next + 1) % self.width
        going = [self.next, after, self.next + self.width, after + self.width]
        return float(verdict.weights[going].sum()) > LEAVING

    def clear(self, columns: FloatArray) -> None:
        """Forget everything."""
        columns[:] = 0.0
        self.information[:] = 0.0
        self.score[:] = 0.0
        self._odds[:] = 0.0
        self._prior = 0.0

    def best_order(self) -> int | None:
        """Place among the idle orders of the one whose evidence is beyond doubt and largest, or None."""
        if not self.idle:
            return None
        inverse = 1.0 / RIPPLE_PRIOR**2
        information = self.information[self.events :] + inverse
        score = self.score[self.events :]
        evidence = 0.5 * (score * score / information - np.log(information / inverse))
        paired = evidence[0::2] + evidence[1::2]
        best = int(np.argmax(paired))
        return best if paired[best] > EVIDENCE_FOR_ORDER else None

    def remove_order(self, place: int) -> tuple[int, FloatArray, FloatArray]:
        """Take an idle order out of the bank: the order, and mean and variance of its two coefficients."""
        at = self.events + 2 * place
        pair = slice(at, at + 2)
        variance = 1.0 / (self.information[pair] + 1.0 / RIPPLE_PRIOR**2)
        mean = variance * self.score[pair]
        self.information = np.delete(self.information, [at, at + 1])
        self.score = np.delete(self.score, [at, at + 1])
        self.columns -= 2
        order = self.idle[place]
        self._set_idle([other for other in self.idle if other != order])
        return order, mean, variance
