"""Many recordings in one command: processes or a Dask cluster, progress, one table, failures by name."""

from __future__ import annotations

import argparse
import copy
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from textile_twin_core.cli.arguments import count
from textile_twin_core.cli.mistakes import BeyondLimitError, UsageError, collected, tell
from textile_twin_core.cli.outputs import check_outputs, save_json
from textile_twin_core.cli.progress import progress
from textile_twin_core.files import staged
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.job_pool import Outcome, run_jobs
from textile_twin_core.recordings.recording_paths import recording_names, recordings_in

_MOST_NAMED = 5
"""Most failed recordings named in the error."""


@dataclass(frozen=True)
class BatchJob:
    """One recording of a batch: the command's arguments with this recording as `bag`, and the machine."""

    arguments: argparse.Namespace
    machine: Machine


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add --workers and --dask."""
    parser.add_argument(
        "--workers", type=count, default=os.cpu_count() or 1, metavar="N", help="processes (default: one per core)"
    )
    parser.add_argument(
        "--dask", metavar="ADDRESS", help="scheduler of a Dask cluster that does the work, such as tcp://host:8786"
    )


def add_batch(parser: argparse.ArgumentParser) -> None:
    """Add --parquet, --workers and --dask, for several recordings."""
    group = parser.add_argument_group("several recordings, or folders of them")
    group.add_argument(
        "--parquet", type=Path, metavar="FILE", help="write a table, one row each; overwritten if it exists"
    )
    add_workers(group)  # type: ignore[arg-type]  # a group takes arguments as a parser does


def one_recording(arguments: argparse.Namespace) -> bool:
    """Find the recordings of a command; return true for a single one, which becomes `bag` of the arguments.

    Raises UsageError or RecordingError.
    """
    if arguments.parquet is None and len(arguments.bags) == 1:
        (path,) = arguments.bags
        folder = path.is_dir() and not (path / "metadata.yaml").exists()
        if not folder or recordings_in([path])[0] == [path]:
            arguments.bag = path
            if arguments.dask is not None:
                raise UsageError("--dask works on several recordings; give a folder of them, or --parquet FILE")
            return True
    check_outputs(arguments)
    return False


def run_batch(
    arguments: argparse.Namespace,
    machine: Machine,
    function: Callable[[BatchJob], dict[str, Any]],
    line: Callable[[Mapping[str, Any]], str],
    beyond: Callable[[Mapping[str, Any]], str] = lambda _: "",
) -> None:
    """Run a command's function on each recording, report each in a line, write --json and --parquet.

    Args:
        arguments: the command's arguments, including those of `add_batch`.
        machine: the machine of all recordings.
        function: the work on one recording; returns its numbers for --json.
        line: formats the numbers of a recording in a line.
        beyond: describes the exceeded limits; empty without any.

    Raises:
        UsageError: a recording failed; raised after all others are written.
        BeyondLimitError: a recording is beyond a limit.
    """
    recordings, notices = recordings_in(arguments.bags)
    tell(*notices)
    recordings.sort(key=str)
    jobs = [BatchJob(_single(arguments, path.resolve()), machine) for path in recordings]
    outcomes: list[Outcome[dict[str, Any]] | None] = [None] * len(jobs)
    with progress(len(jobs), function.__name__.strip("_"), " recordings", long=1) as done:
        for outcome in run_jobs(function, jobs, arguments.workers, arguments.dask):
            outcomes[outcome.index] = outcome
            if done is not None:
                done(1)
    ended = [outcome for outcome in outcomes if outcome is not None]
    names, rows, over = recording_names(recordings), [], []
    for name, outcome in zip(names, ended, strict=True):
        numbers = outcome.result
        rows.append({"bag": name, "error": outcome.error or None, **(numbers or {})})
        print(f"{name}: {outcome.error if numbers is None else line(numbers)}")
        if numbers is not None and (limit := beyond(numbers)):
            over.append(f"{name}: {limit}")
    print(memory_line(ended))
    save_json(arguments.json, rows)
    if arguments.parquet is not None:
        write_table(arguments.parquet, rows)
    failed = failed_line([name for name, outcome in zip(names, ended, strict=True) if outcome.error], len(ended))
    if over:
        raise BeyondLimitError("; ".join([*over[:_MOST_NAMED], *filter(None, [failed])]))
    if failed:
        raise UsageError(failed)


def quietly(job: BatchJob, work: Callable[[argparse.Namespace, Machine], dict[str, Any]]) -> dict[str, Any]:
    """Do the work on one recording without output; its notices precede its notes."""
    with collected() as notices:
        numbers = work(job.arguments, job.machine)
    return {**numbers, "notes": [*notices, *numbers["notes"]]}


def memory_line(outcomes: Iterable[Outcome[Any]]) -> str:
    """State the number of processes and the largest memory of one."""
    peaks: dict[str, int] = {}
    for outcome in outcomes:
        if outcome.worker:
            peaks[outcome.worker] = max(peaks.get(outcome.worker, 0), outcome.peak_bytes)
    each = "each at most" if len(peaks) > 1 else "at most"
    memory = f"; {each} {max(peaks.values()) / 1e6:.0f} MB of memory" if any(peaks.values()) else ""
    return f"{len(peaks)} process{'es' * (len(peaks) != 1)}{memory}"


def failed_line(failed: Sequence[str], total: int, what: str = "read") -> str:
    """Name the recordings that failed; empty without failures."""
    if not failed:
        return ""
    named = ", ".join(failed[:_MOST_NAMED]) + " ..." * (len(failed) > _MOST_NAMED)
    return f"{len(failed)} of {total} recordings could not be {what}: {named}"


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write one row per recording as Parquet; the columns are the keys of --json, joined by dots.

    Raises OutputError if the file cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    flat = [dict(_columns(row)) for row in rows]
    names = dict.fromkeys(name for row in flat for name in row)
    with staged(path) as partial:
        parquet.write_table(pyarrow.table({name: [row.get(name) for row in flat] for name in names}), partial)


def _columns(value: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, Any]]:
    """Yield names and values of the columns of nested objects; a list of objects gives a list for each key."""
    for name, each in value.items():
        if isinstance(each, list) and each and isinstance(each[0], dict):
            keys = dict.fromkeys(key for one in each for key in one)
            each = {key: [one.get(key) for one in each] for key in keys}
        if isinstance(each, Mapping):
            yield from _columns(each, f"{before}{name}.")
        elif each != []:  # an empty list may be one of objects: null, as its columns are
            yield f"{before}{name}", each


def _single(arguments: argparse.Namespace, bag: Path) -> argparse.Namespace:
    """Return the arguments of a batch for one of its recordings."""
    single = copy.copy(arguments)
    single.bag = bag
    single.bags = [bag]
    return single
