"""Pareto search by generalised differential evolution (GDE3; Kukkonen and Lampinen 2005), a whole generation at a time.

Written out because a generation of a compiled evaluator takes less than the bookkeeping of object-based libraries.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray

_SCALE, _CROSSOVER = (0.3, 0.9), 0.9
Evaluate = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""From designs (n, parameters) to goals to be made small (n, goals) and by how much limits are broken (n,)."""


@dataclass(frozen=True)
class Population:
    """Designs (n, parameters), their goals (n, goals) and by how much they break limits (n,)."""

    designs: FloatArray
    goals: FloatArray
    lacks: FloatArray

    def chosen(self, which: IntArray | BoolArray) -> Population:
        """Some of them."""
        return Population(self.designs[which], self.goals[which], self.lacks[which])

    @property
    def front(self) -> Population:
        """Those that keep all limits and of which no other is better in all goals."""
        fit = self.chosen(self.lacks <= 0.0)
        return fit.chosen(_ranks(fit) == 0) if fit.lacks.size else fit


def generations(
    start: FloatArray, low: FloatArray, high: FloatArray, evaluate: Evaluate, random: np.random.Generator
) -> Iterator[Population]:
    """The population of `start` (n, parameters), then of one generation after the other, within low..high."""
    designs = start
    now = Population(designs, *evaluate(designs))
    size = start.shape[0]
    yield now
    while True:
        trial = _trials(now.designs, low, high, random)
        new = Population(trial, *evaluate(trial))
        better, worse = _dominates(new, now), _dominates(now, new)
        kept = now.chosen(~better)
        came = new.chosen(~worse)
        both = Population(*(np.concatenate(pair) for pair in zip(_parts(kept), _parts(came), strict=True)))
        now = both.chosen(_survivors(both, size))
        yield now


def _parts(population: Population) -> tuple[FloatArray, FloatArray, FloatArray]:
    return population.designs, population.goals, population.lacks


def _trials(designs: FloatArray, low: FloatArray, high: FloatArray, random: np.random.Generator) -> FloatArray:
    """One trial for each design: a third plus a scaled difference of two others (rand/1/bin), reflected into range."""
    size, count = designs.shape
    a, b, c = (random.permutation(size) for _ in range(3))
    scale = random.uniform(*_SCALE, (size, 1))
    mutant = designs[a] + scale * (designs[b] - designs[c])
    crossed = random.random((size, count)) < _CROSSOVER
    crossed[np.arange(size), random.integers(0, count, size)] = True
    trial = np.where(crossed, mutant, designs)
    trial = np.where(trial < low, 2.0 * low - trial, trial)
    trial = np.where(trial > high, 2.0 * high - trial, trial)
    return np.clip(trial, low, high)


def _dominates(one: Population, other: Population) -> BoolArray:
    """(n,) whether each of one is to be preferred to its counterpart: limits first, then all goals."""
    no_worse = (one.goals <= other.goals).all(axis=1) & (one.goals < other.goals).any(axis=1)
    both_fit = (one.lacks <= 0.0) & (other.lacks <= 0.0)
    return np.asarray(np.where(both_fit, no_worse, one.lacks < other.lacks))


def _survivors(population: Population, size: int) -> IntArray:
    """The best by front, of the last front that fits in part those that stand alone."""
    ranks = _ranks(population)
    chosen: list[IntArray] = []
    left = size
    for rank in range(int(ranks.max()) + 1):
        members = np.flatnonzero(ranks == rank)
        if members.size > left:
            members = members[_spread(population.goals[members], left)]
        chosen.append(members)
        left -= members.size
        if left == 0:
            break
    return np.concatenate(chosen)


def _ranks(population: Population) -> IntArray:
    """(n,) front by front: 0 for those that none is better than; what breaks limits follows after, by how much."""
    fit = population.lacks <= 0.0
    ranks = np.zeros(fit.size, dtype=np.int64)
    goals = population.goals[fit]
    no_worse = np.ones((goals.shape[0],) * 2, dtype=bool)
    better = np.zeros_like(no_worse)
    for column in goals.T:
        no_worse &= column[:, None] <= column[None, :]
        better |= column[:, None] < column[None, :]
    beaten_by = (no_worse & better).T
    open_, rank, found = np.ones(goals.shape[0], dtype=bool), 0, np.zeros(goals.shape[0], dtype=np.int64)
    while open_.any():
        first = open_ & ~(beaten_by & open_[None, :]).any(axis=1)
        found[first] = rank
        open_ &= ~first
        rank += 1
    ranks[fit] = found
    order = np.argsort(np.argsort(population.lacks[~fit], kind="stable"), kind="stable")
    ranks[~fit] = rank + order
    return ranks


def _spread(goals: FloatArray, size: int) -> IntArray:
    """The `size` members of a front that stand farthest from their neighbours, the most crowded left out one by one."""
    alive = np.arange(goals.shape[0])
    extent = np.ptp(goals, axis=0)
    scaled = (goals - goals.min(axis=0)) / np.where(extent > 0.0, extent, 1.0)
    while alive.size > size:
        # a fifth of what is too many at a time, since those left have other neighbours then
        drop = max(1, (alive.size - size) // 5)
        crowding = _crowding(scaled[alive])
        alive = np.delete(alive, np.argsort(crowding, kind="stable")[:drop])
    return alive


def _crowding(goals: FloatArray) -> FloatArray:
    """(n,) distance to the neighbours along each goal (Deb et al. 2002); infinite at the ends."""
    total = np.zeros(goals.shape[0])
    for column in goals.T:
        order = np.argsort(column, kind="stable")
        gaps = np.full(column.size, np.inf)
        gaps[1:-1] = column[order[2:]] - column[order[:-2]]
        total[order] += gaps
    return total
