"""Pareto search by generalised differential evolution (GDE3; Kukkonen and Lampinen 2005), by whole generations.

This own implementation exists because a generation of the compiled evaluator takes less time than the bookkeeping of
object-based libraries.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray

_SCALE, _CROSSOVER = (0.3, 0.9), 0.9
Evaluate = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Maps designs (n, parameters) to goals to be minimised (n, goals) and violations of limits (n,)."""


@dataclass(frozen=True)
class Population:
    """Designs (n, parameters), their goals (n, goals) and violations of limits (n,)."""

    designs: FloatArray
    goals: FloatArray
    lacks: FloatArray

    def chosen(self, which: IntArray | BoolArray) -> Population:
        """Select some of the designs."""
        return Population(self.designs[which], self.goals[which], self.lacks[which])

    @property
    def front(self) -> Population:
        """Select the designs within all limits that no other design dominates."""
        fit = self.chosen(self.lacks <= 0.0)
        return fit.chosen(_ranks(fit) == 0) if fit.lacks.size else fit


def generations(
    start: FloatArray, low: FloatArray, high: FloatArray, evaluate: Evaluate, random: np.random.Generator
) -> Iterator[Population]:
    """Yield the population of `start` (n, parameters), then one generation after another, within low..high."""
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
    """Make one trial per design: a third plus a scaled difference of two others (rand/1/bin), reflected into range."""
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
    """Return (n,) whether each design is preferred to its counterpart: limits first, then all goals."""
    no_worse = (one.goals <= other.goals).all(axis=1) & (one.goals < other.goals).any(axis=1)
    both_fit = (one.lacks <= 0.0) & (other.lacks <= 0.0)
    return np.asarray(np.where(both_fit, no_worse, one.lacks < other.lacks))


def _survivors(population: Population, size: int) -> IntArray:
    """Select the best by front, and of the last front that fits in part the least crowded."""
    ranks = _ranks(population)
    chosen: list[IntArray] = []
    free = size
    for rank in range(int(ranks.max()) + 1):
        members = np.flatnonzero(ranks == rank)
        if members.size > free:
            members = members[_spread(population.goals[members], free)]
        chosen.append(members)
        free -= members.size
        if free == 0:
            break
    return np.concatenate(chosen)


def _ranks(population: Population) -> IntArray:
    """Rank (n,) by front: 0 for non-dominated designs; designs beyond limits follow in order of violation."""
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
    """Select the `size` members of a front farthest from their neighbours, removing the most crowded in turn."""
    alive = np.arange(goals.shape[0])
    extent = np.ptp(goals, axis=0)
    scaled = (goals - goals.min(axis=0)) / np.where(extent > 0.0, extent, 1.0)
    while alive.size > size:
        # remove a fifth of the excess at a time, since the neighbours change
        drop = max(1, (alive.size - size) // 5)
        crowding = _crowding(scaled[alive])
        alive = np.delete(alive, np.argsort(crowding, kind="stable")[:drop])
    return alive


def _crowding(goals: FloatArray) -> FloatArray:
    """Compute the (n,) distance to the neighbours along each goal (Deb et al. 2002); infinite at the ends."""
    total = np.zeros(goals.shape[0])
    for column in goals.T:
        order = np.argsort(column, kind="stable")
        gaps = np.full(column.size, np.inf)
        gaps[1:-1] = column[order[2:]] - column[order[:-2]]
        total[order] += gaps
    return total
