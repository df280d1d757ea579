"""The search for designs: goals, limits and free parameters in, the Pareto front out, while people look on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.explore.analysis import analyse
from textile_twin_core.explore.design import Design
from textile_twin_core.synthesis import pareto
from textile_twin_core.synthesis.batch import SAMPLES, Batch
from textile_twin_core.synthesis.tolerance import Limit, batch_of

_POPULATION, _SLOW_POPULATION = 160, 24
GENERATIONS = 200
_FINE = 720
_OPEN = 1e3
_TELL_S = 0.25


@dataclass(frozen=True)
class Goal:
    """A number to be made as large, or as small, as it can be."""

    number: str
    maximise: bool


@dataclass(frozen=True)
class Task:
    """What is searched for: free parameters with their ranges (SI), goals, limits, and the seed."""

    free: Mapping[str, tuple[float, float]]
    goals: tuple[Goal, ...]
    limits: tuple[Limit, ...] = ()
    seed: int = 0


@dataclass(frozen=True)
class FrontDesign:
    """A design of the front: its free parameters and its goals and limited numbers (SI)."""

    values: Mapping[str, float]
    numbers: Mapping[str, float]


@dataclass(frozen=True)
class LimitKept:
    """How many of the designs keep a limit, and the value of its number (SI) that comes nearest to it; NaN without."""

    limit: Limit
    designs: int
    nearest: float


@dataclass(frozen=True)
class SearchProgress:
    """How far the search is: its front, designs looked at, designs a second of pure evaluation, share of the time.

    `complete` says that all generations were gone through: then the seed alone decides what is found. `kept` tells of
    each limit by how many designs it was kept.
    """

    front: tuple[FrontDesign, ...]
    designs: int
    designs_per_second: float
    share: float
    complete: bool = False
    kept: tuple[LimitKept, ...] = ()


Report = Callable[[SearchProgress], None]


def search(
    design: Design,
    task: Task,
    report: Report | None = None,
    stopped: Callable[[], bool] | None = None,
    seconds: float = 60.0,
    generations: int = GENERATIONS,
) -> SearchProgress:
    """The designs of which none is better in all goals, within the limits, from the present one and random others.

    Generalised differential evolution (see `synthesis.pareto`) through the batched closed forms, a generation at a
    time, so that the same seed and generations give the same front. It ends after `generations`, or `seconds`, or when
    `stopped` says so after one; the front is then evaluated anew on a finer grid. `report` is told of it a few times a
    second. Machines without a batch form are looked at one by one.
    Raises SceneError for unknown names, empty ranges, or no goal.
    """
    numbers_of, numbers, slow = _evaluator(design, SAMPLES)
    _check(design, task, numbers)
    goals = _Goals(task, numbers_of)
    low, high = np.array(list(task.free.values()), dtype=np.float64).T
    random = np.random.default_rng(task.seed)
    begin = told = time.monotonic()
    start = _start(design, task, _SLOW_POPULATION if slow else _POPULATION, random)
    for number, population in enumerate(pareto.generations(start, low, high, goals, random), 1):
        now = time.monotonic()
        if report and now - told > _TELL_S:
            told = now
            share = max((now - begin) / seconds, number / generations)
            front = _again(_front(population, task), task, numbers_of)
            report(SearchProgress(front, goals.designs, goals.rate, min(1.0, share), kept=goals.kept()))
        if number >= generations or now - begin > seconds or (stopped and stopped()):
            break
    finer = numbers_of if slow else _evaluator(design, _FINE)[0]
    front = _again(_front(population, task), task, finer)
    return SearchProgress(front, goals.designs, goals.rate, 1.0, number >= generations, goals.kept())


Evaluate = Callable[[Mapping[str, FloatArray], Sequence[str]], dict[str, FloatArray]]


def _evaluator(design: Design, samples: int) -> tuple[Evaluate, tuple[str, ...], bool]:
    """Numbers of many designs, their names, and whether it goes one by one."""
    try:
        batch = batch_of(design.family, design.values, design.speed_rad_s, design.dwell_within_m)
    except SceneError:
        slowly = OneByOne(design)
        return slowly.evaluate, slowly.names, True
    batch = Batch(batch.machine, design.speed_rad_s, design.dwell_within_m, samples)
    fixed = dict(design.values)

    def evaluate(values: Mapping[str, FloatArray], names: Sequence[str]) -> dict[str, FloatArray]:
        count = next(iter(values.values())).size
        columns = {**{k: np.full(count, v) for k, v in fixed.items()}, **values}
        return batch.evaluate(design.family.columns(columns), names)

    return evaluate, batch.names, False


class OneByOne:
    """The numbers of many designs, one after the other: what a machine without a batch form has."""

    def __init__(self, design: Design) -> None:
        self._design = design
        self.names = tuple(analyse(design).numbers)

    def evaluate(self, values: Mapping[str, FloatArray], names: Iterable[str]) -> dict[str, FloatArray]:
        """Numbers by name, each (n,), for the values (n,) by parameter; NaN for a design that cannot be."""
        rows = [self._numbers(dict(zip(values, row, strict=True))) for row in zip(*values.values(), strict=True)]
        return {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}

    def _numbers(self, values: Mapping[str, Any]) -> Mapping[str, float]:
        try:
            return analyse(self._design.changed({name: float(value) for name, value in values.items()})).numbers
        except TwinError:
            return {}


def _check(design: Design, task: Task, numbers: Sequence[str]) -> None:
    if not task.goals:
        raise SceneError("no goal is given: say which number is to be made large or small")
    if not task.free:
        raise SceneError("no parameter is free: choose at least one that may change")
    known = {p.name for p in design.family.parameters}
    for name, (low, high) in task.free.items():
        if name not in known:
            raise SceneError(f"machine '{design.family.name}' has no parameter '{name}'")
        if not (np.isfinite([low, high]).all() and low < high):
            raise SceneError(f"range of '{name}': give two rising numbers")
    for number in [goal.number for goal in task.goals] + [limit.number for limit in task.limits]:
        if number not in numbers:
            raise SceneError(f"'{number}' is no number of this machine that can be searched for")


class _Goals:
    """A task's goals, all to be made small, and by how much a design breaks its limits, for many designs."""

    def __init__(self, task: Task, evaluate: Evaluate) -> None:
        self.task, self._evaluate = task, evaluate
        self.names = tuple(dict.fromkeys([g.number for g in task.goals] + [k.number for k in task.limits]))
        self.designs, self._seconds = 0, 0.0
        self._kept = [0] * len(task.limits)
        self._lacks = [(np.inf, np.nan)] * len(task.limits)

    def kept(self) -> tuple[LimitKept, ...]:
        """Of each limit, how it was kept so far."""
        counts = zip(self.task.limits, self._kept, self._lacks, strict=True)
        return tuple(LimitKept(limit, designs, nearest) for limit, designs, (_, nearest) in counts)

    @property
    def rate(self) -> float:
        """Designs a second of evaluation."""
        return self.designs / self._seconds if self._seconds else 0.0

    def __call__(self, designs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Goals (n, goals) and lacks (n,) of designs (n, parameters)."""
        begin = time.perf_counter()
        found = self._evaluate({name: designs[:, k] for k, name in enumerate(self.task.free)}, self.names)
        self._seconds += time.perf_counter() - begin
        self.designs += designs.shape[0]
        goals = np.column_stack([-found[g.number] if g.maximise else found[g.number] for g in self.task.goals])
        lacks = np.where(np.isfinite(goals).all(axis=1), 0.0, _OPEN)
        for k, limit in enumerate(self.task.limits):
            way = limit.value - found[limit.number] if limit.at_least else found[limit.number] - limit.value
            lacks += np.maximum(0.0, np.nan_to_num(way / (abs(limit.value) or 1.0), nan=0.0))
            self._kept[k] += int(np.count_nonzero(way <= 0.0))
            if np.isfinite(way).any():
                best = int(np.nanargmin(way))
                self._lacks[k] = min(self._lacks[k], (float(way[best]), float(found[limit.number][best])))
        return np.nan_to_num(goals, nan=_OPEN), lacks


def _start(design: Design, task: Task, size: int, random: np.random.Generator) -> FloatArray:
    """Random designs of the ranges; the first is the present one, as far as it lies in them."""
    low, high = np.array(list(task.free.values()), dtype=np.float64).T
    drawn = random.uniform(low, high, (size, low.size))
    drawn[0] = np.clip([design.value(name) or 0.0 for name in task.free], low, high)
    return drawn


def _front(population: pareto.Population, task: Task) -> tuple[FrontDesign, ...]:
    """The best designs so far that keep all limits, with their goals."""
    front = population.front
    found = [
        FrontDesign(
            dict(zip(task.free, row.tolist(), strict=True)),
            {g.number: float(-v if g.maximise else v) for g, v in zip(task.goals, values, strict=True)},
        )
        for row, values in zip(front.designs, front.goals, strict=True)
    ]
    return tuple(sorted(found, key=lambda one: one.numbers[task.goals[0].number]))


def _again(front: tuple[FrontDesign, ...], task: Task, evaluate: Evaluate) -> tuple[FrontDesign, ...]:
    """The front with all goals and limited numbers, evaluated anew."""
    if not front:
        return front
    names = tuple(dict.fromkeys([g.number for g in task.goals] + [k.number for k in task.limits]))
    columns = {name: np.array([one.values[name] for one in front]) for name in task.free}
    found = evaluate(columns, names)
    return tuple(
        FrontDesign(one.values, {name: float(found[name][k]) for name in names}) for k, one in enumerate(front)
    )
