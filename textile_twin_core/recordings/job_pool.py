"""Job pool: runs jobs in this process, in processes of this computer, or on a Dask cluster; each gives a result
or an error.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Generic, TypeVar

from textile_twin_core.errors import RecordingError, TwinError, how_to_install

J = TypeVar("J")
R = TypeVar("R")

_KILLED = "its process was killed, most likely for lack of memory: give it fewer processes (--workers), or more memory"


@dataclass(frozen=True)
class Outcome(Generic[R]):
    """Outcome of one job.

    Attributes:
        index: Position of the job in the given sequence.
        result: Return value of the function; None after an error.
        error: One line with the reason for a missing result.
        worker: Host and process number.
        peak_bytes: Largest memory of that process so far.
    """

    index: int
    result: R | None
    error: str = ""
    worker: str = ""
    peak_bytes: int = 0


def run_jobs(
    function: Callable[[J], R], jobs: Sequence[J], workers: int = 1, scheduler: str | None = None
) -> Iterator[Outcome[R]]:
    """Run a function on each job; outcomes come in the order in which the jobs end.

    A process that is killed loses nothing: its job runs again. The job ends in an error where its process is killed
    each time.

    Args:
        function: a function of a module, as other processes import it.
        jobs: arguments of the function; they are pickled.
        workers: processes on this computer.
        scheduler: address of a Dask cluster, which then runs the jobs.

    Raises:
        RecordingError: the cluster cannot be reached, or its package is not installed.

    Examples:
        >>> [outcome.result for outcome in run_jobs(abs, [-1, 2])]
        [1, 2]
    """
    if scheduler is not None:
        return _on_cluster(function, jobs, scheduler)
    if workers < 2 or len(jobs) < 2:
        return (_run(function, index, job) for index, job in enumerate(jobs))
    return _in_processes(function, jobs, workers)


def _run(function: Callable[[J], R], index: int, job: J) -> Outcome[R]:
    result, error = None, ""
    try:
        result = function(job)
    except TwinError as failure:
        error = str(failure)
    except MemoryError:
        error = "the recording does not fit into memory; take a part of it"
    except Exception as failure:  # one recording must not end the work on the others
        error = f"a fault of textile-twin, please report it ({type(failure).__name__}: {failure})"
    return Outcome(index, result, error, f"{socket.gethostname()}:{os.getpid()}", _peak_bytes())


def _peak_bytes() -> int:
    """Return the largest resident memory of this process (VmHWM); 0 where the system does not state it."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:")), 0)


def _in_processes(function: Callable[[J], R], jobs: Sequence[J], workers: int) -> Iterator[Outcome[R]]:
    waiting = dict(enumerate(jobs))
    suspects: list[int] = []  # jobs that ran when a process was killed; each is repeated alone to find the cause
    while waiting:
        batch = suspects[:1] or list(waiting)
        # Spawn instead of fork, since the readers and compiled loops use threads.
        with ProcessPoolExecutor(min(workers, len(batch)), mp_context=get_context("spawn")) as pool:
            futures: dict[Future[Outcome[R]], int] = {}
            with suppress(BrokenProcessPool):  # a process is killed while jobs are still handed in
                for index in batch:
                    futures[pool.submit(_run, function, index, waiting[index])] = index
            for future in as_completed(futures):
                index = futures[future]
                try:
                    outcome = future.result()
                except BrokenProcessPool:
                    if not suspects:
                        continue
                    outcome = Outcome(index, None, _KILLED)
                del waiting[index]
                yield outcome
        # The pool keeps one job ready beside those in work.
        suspects = suspects[1:] if suspects else list(waiting)[: workers + 1]


def _on_cluster(function: Callable[[J], R], jobs: Sequence[J], scheduler: str) -> Iterator[Outcome[R]]:
    try:
        from dask.distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ModuleNotFoundError as error:
        raise RecordingError(f"--dask needs the package distributed; {how_to_install('distributed')}") from error
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise RecordingError(f"--dask {scheduler}: no scheduler answers there ({error})") from error
    with client:
        futures = client.map(_run, [function] * len(jobs), range(len(jobs)), jobs, pure=False)
        places: dict[Any, int] = {future.key: index for index, future in enumerate(futures)}
        ended = as_completed(futures)
        del futures  # the cluster discards each result once it is here
        for future in ended:
            try:
                yield future.result()
            except KilledWorker:
                yield Outcome(places[future.key], None, _KILLED)
            except Exception as error:  # the scheduler is gone, or the worker has another version of the package
                text = f"the cluster gave no result ({type(error).__name__}: {error})"
                yield Outcome(places[future.key], None, " ".join(text.split()))
