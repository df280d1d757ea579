"""Search for designs: from goals, limits and free parameters to the Pareto front, with progress reports."""

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
from textile_twin_core.synthesis.tolerance import Limit, ManyDesigns

_POPULATION, _SLOW_POPULATION = 160, 24
GENERATIONS = 200
_FINE = 720
_OPEN = 1e3
_TELL_S = 0.25


@dataclass(frozen=True)
class Goal:
    """Number to maximise or minimise."""

    number: str
    maximise: bool


@dataclass(frozen=True)
class Task:
    """Task of a search: free parameters with their ranges (SI), goals, limits, and the seed."""

    free: Mapping[str, tuple[float, float]]
    goals: tuple[Goal, ...]
    limits: tuple[Limit, ...] = ()
    seed: int = 0


@dataclass(frozen=True)
class FrontDesign:
    """Design of the front: its free parameters, goals and limited numbers (SI)."""

    values: Mapping[str, float]
    numbers: Mapping[str, float]


@dataclass(frozen=True)
class LimitTally:
    """Number of designs that meet a limit, and the nearest value of its number (SI); NaN without designs."""

    limit: Limit
    designs: int
    nearest: float


@dataclass(frozen=True)
class SearchProgress:
    """Progress of a search.

    Attributes:
        front: Best designs so far.
        designs: Number of evaluated designs.
        designs_per_second: Rate of pure evaluation.
        share: Share of the time.
        complete: True if all generations have run, so that the seed alone determines the front.
        tallies: Number of designs that meet each limit.
    """

    front: tuple[FrontDesign, ...]
    designs: int
    designs_per_second: float
    share: float
    complete: bool = False
    tallies: tuple[LimitTally, ...] = ()


Report = Callable[[SearchProgress], None]


def search(
    design: Design,
    task: Task,
    report: Report | None = None,
    stopped: Callable[[], bool] | None = None,
    seconds: float = 60.0,
    generations: int = GENERATIONS,
) -> SearchProgress:
    """Search for Pareto-optimal designs within the limits, from the present design and random ones.

    The algorithm is generalised differential evolution (see `synthesis.pareto`) on batches of designs, or on single
    designs where these are not possible (see `many_designs`). The same seed and generations give the same
    front. The final front is evaluated again on a finer grid.

    Args:
        design: Present design.
        task: Goals, limits and free parameters.
        report: Called with the progress a few times per second.
        stopped: Checked after each generation; true ends the search.
        seconds: Time limit [s].
        generations: Largest number of generations.

    Returns:
        The final front and its statistics.

    Raises:
        SceneError: A name is unknown, a range is empty, or there is no goal.
    """
    designs = many_designs(design, task.free)
    slow = isinstance(designs, OneByOne)
    _check(design, task, designs.names)
    goals = _Goals(task, designs.evaluate)
    low, high = np.array(list(task.free.values()), dtype=np.float64).T
    random = np.random.default_rng(task.seed)
    begin = reported = time.monotonic()
    start = _start(design, task, _SLOW_POPULATION if slow else _POPULATION, random)
    for number, population in enumerate(pareto.generations(start, low, high, goals, random), 1):
        now = time.monotonic()
        if report and now - reported > _TELL_S:
            reported = now
            share = max((now - begin) / seconds, number / generations)
            front = _again(_front(population, task), task, designs)
            report(SearchProgress(front, goals.designs, goals.rate, min(1.0, share), tallies=goals.tallies()))
        if number >= generations or now - begin > seconds or (stopped and stopped()):
            break
    finer = designs if slow else many_designs(design, task.free, _FINE)
    front = _again(_front(population, task), task, finer)
    return SearchProgress(front, goals.designs, goals.rate, 1.0, number >= generations, goals.tallies())


Evaluate = Callable[[Mapping[str, FloatArray], Sequence[str]], dict[str, FloatArray]]


def many_designs(design: Design, free: Iterable[str], samples: int = SAMPLES) -> ManyDesigns:
    """Return an evaluator of many variants of a design in some parameters.

    It is a batch, or one by one for a machine with a history, or where a parameter selects a closed form.
    """
    try:
        batch = Batch(design.family, design.values, design.speed_rad_s, design.dwell_within_m, samples)
    except SceneError:
        return OneByOne(design)
    known = [name for name in free if name in design.family.searchable]
    return OneByOne(design) if batch.fixed(known) else batch


class OneByOne:
    """Evaluation of designs one by one."""

    def __init__(self, design: Design) -> None:
        self._design = design
        self.names = tuple(analyse(design).numbers)

    def evaluate(self, values: Mapping[str, FloatArray], names: Iterable[str]) -> dict[str, FloatArray]:
        """Return numbers (n,) by name for values (n,) by parameter; NaN for a design that is not valid."""
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
            raise SceneError(f"'{number}' cannot be a goal or limit: this machine has no such number")


class _Goals:
    """Goals of a task, as values to minimise, and violations of its limits, for many designs."""

    def __init__(self, task: Task, evaluate: Evaluate) -> None:
        self.task, self._evaluate = task, evaluate
        self.names = tuple(dict.fromkeys([g.number for g in task.goals] + [k.number for k in task.limits]))
        self.designs, self._seconds = 0, 0.0
        self._met = [0] * len(task.limits)
        self._violations = [(np.inf, np.nan)] * len(task.limits)

    def tallies(self) -> tuple[LimitTally, ...]:
        """Return the tally of each limit so far."""
        counts = zip(self.task.limits, self._met, self._violations, strict=True)
        return tuple(LimitTally(limit, designs, nearest) for limit, designs, (_, nearest) in counts)

    @property
    def rate(self) -> float:
        """Designs per second of evaluation."""
        return self.designs / self._seconds if self._seconds else 0.0

    def __call__(self, designs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return goals (n, goals) and violations (n,) of designs (n, parameters)."""
        begin = time.perf_counter()
        found = self._evaluate({name: designs[:, k] for k, name in enumerate(self.task.free)}, self.names)
        self._seconds += time.perf_counter() - begin
        self.designs += designs.shape[0]
        goals = np.column_stack([-found[g.number] if g.maximise else found[g.number] for g in self.task.goals])
        violations = np.where(np.isfinite(goals).all(axis=1), 0.0, _OPEN)
        for k, limit in enumerate(self.task.limits):
            excess = limit.value - found[limit.number] if limit.at_least else found[limit.number] - limit.value
            violations += np.maximum(0.0, np.nan_to_num(excess / (abs(limit.value) or 1.0), nan=0.0))
            self._met[k] += int(np.count_nonzero(excess <= 0.0))
            if np.isfinite(excess).any():
                best = int(np.nanargmin(excess))
                self._violations[k] = min(self._violations[k], (float(excess[best]), float(found[limit.number][best])))
        return np.nan_to_num(goals, nan=_OPEN), violations


def _start(design: Design, task: Task, size: int, random: np.random.Generator) -> FloatArray:
    """Draw random designs within the ranges; the first is the present one, clipped to them."""
    low, high = np.array(list(task.free.values()), dtype=np.float64).T
    drawn = random.uniform(low, high, (size, low.size))
    drawn[0] = np.clip([design.value(name) or 0.0 for name in task.free], low, high)
    return drawn


def _front(population: pareto.Population, task: Task) -> tuple[FrontDesign, ...]:
    """Return the best designs so far that meet all limits, with their goals."""
    front = population.front
    found = [
        FrontDesign(
            dict(zip(task.free, row.tolist(), strict=True)),
            {g.number: float(-v if g.maximise else v) for g, v in zip(task.goals, values, strict=True)},
        )
        for row, values in zip(front.designs, front.goals, strict=True)
    ]
    return tuple(sorted(found, key=lambda one: one.numbers[task.goals[0].number]))


def _again(front: tuple[FrontDesign, ...], task: Task, designs: ManyDesigns) -> tuple[FrontDesign, ...]:
    """Evaluate the front again with all goals and limited numbers."""
    if not front:
        return front
    names = tuple(dict.fromkeys([g.number for g in task.goals] + [k.number for k in task.limits]))
    columns = {name: np.array([one.values[name] for one in front]) for name in task.free}
    found = designs.evaluate(columns, names)
    return tuple(
        FrontDesign(one.values, {name: float(found[name][k]) for name in names}) for k, one in enumerate(front)
    )
