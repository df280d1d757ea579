"""Fair timing: all candidates in one process on one core, taking turns, with the time of every round stored."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from textile_twin_core.arrays import FloatArray

_CALLS = 200

PINS = hasattr(os, "sched_setaffinity")
"""True if this system can pin a process to a core."""
clock = time.process_time if PINS else time.perf_counter
"""Processor time, independent of other programs; wall time where it is too coarse (Windows, macOS)."""


@dataclass
class Candidate:
    """Method to evaluate a scene.

    Attributes:
        batch: Evaluates `samples` samples at once; None if not supported.
        single: Evaluates one sample; None if not supported.
        result: Returns the outputs of the batch's samples, for the error.
        error: Given in place of `result` if the motion is not that of the scene.
        peer: Name of the library; None for our own methods.
        batch_times, single_times: Times of each round [s].
    """

    method: str
    peer: str | None
    batch: Callable[[], Any] | None = None
    samples: int = 0
    single: Callable[[], Any] | None = None
    result: Callable[[], dict[str, FloatArray]] | None = None
    error: Callable[[], float] | None = None
    note: str = ""
    batch_times: list[float] = field(default_factory=list)
    single_times: list[float] = field(default_factory=list)

    @property
    def ns_per_sample(self) -> float | None:
        """Median over the rounds [ns]."""
        return statistics.median(self.batch_times) / self.samples * 1e9 if self.batch_times else None

    @property
    def us_per_call(self) -> float | None:
        """Median over the rounds [us]."""
        return statistics.median(self.single_times) * 1e6 if self.single_times else None


def bench_core() -> int | None:
    """Return the core of the benchmark: the last available one, since systems use the first for their own work.

    None if the system cannot pin a process to a core.
    """
    return max(os.sched_getaffinity(0)) if PINS else None


@contextmanager
def one_core() -> Iterator[None]:
    """Pin this thread, and the threads it starts, to `bench_core`; moving to another core would empty its caches."""
    core = bench_core()
    if core is None:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def take_turns(
    candidates: Iterable[Candidate], rounds: int, progress: Callable[[int], object] = lambda _: None
) -> None:
    """Time every candidate once per round, so that disturbances affect all of them equally.

    Each runs once untimed just before, to exclude the cache state left by the others.
    """
    candidates = list(candidates)
    for candidate in candidates:  # trigger late compilation
        for function in (candidate.batch, candidate.single):
            if function is not None:
                function()
    for _ in range(rounds):
        for candidate in candidates:
            if candidate.batch is not None:
                candidate.batch()
                begin = clock()
                candidate.batch()
                candidate.batch_times.append(clock() - begin)
            if candidate.single is not None:
                candidate.single_times.append(_per_call(candidate.single))
        progress(1)


def _per_call(function: Callable[[], Any]) -> float:
    begin = clock()
    function()
    first = clock() - begin
    calls = max(1, min(_CALLS, int(0.01 / max(first, 1e-7))))
    begin = clock()
    for _ in range(calls):
        function()
    return (clock() - begin) / calls
