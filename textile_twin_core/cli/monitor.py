"""textile-twin monitor: watch over the turns of recordings for faults."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording_topics, count
from textile_twin_core.cli.mistakes import BeyondLimitError, UsageError, tell
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import check_outputs, save_json
from textile_twin_core.cli.progress import on_terminal, stages
from textile_twin_core.cli.recording_batch import add_workers, failed_line, memory_line
from textile_twin_core.cli.sensor_options import add_sensors, topics_of, with_sensors
from textile_twin_core.comparison.fault_watch import WatchSettings
from textile_twin_core.files import staged
from textile_twin_core.recordings.job_pool import Outcome
from textile_twin_core.recordings.monitored import Job, Watched, names_of, samples_of, trend_table, watch_bags
from textile_twin_core.recordings.recording_paths import recordings_in


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "monitor",
        "Learns the torque of a machine over its first turns, and watches all later ones: needle side, drive side and\n"
        "sensor faults, distinguished by their effect on the torque. A folder stands for all recordings in it.\n"
        "Exit code 3 when there was an alarm, 2 when a recording could not be watched, after all others were.",
        "textile-twin monitor bags/* --machine my_machine.yaml --parquet trends.parquet",
    )
    parser.add_argument(
        "bags", metavar="BAG", type=Path, nargs="+", help="rosbag2 folders, .mcap files, or folders of them"
    )
    add_recording_topics(parser)
    add_sensors(parser)
    add_machine(parser, option=True)
    parser.add_argument("--learn", type=count, default=100, metavar="TURNS", help="turns to learn from (default 100)")
    parser.add_argument(
        "--parquet", type=Path, metavar="FILE", help="write the trend of every turn; overwritten if it exists"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the alarms; overwritten if it exists")
    add_workers(parser)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Watch the recordings, print the alarms and write the outputs."""
    machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)

    check_outputs(arguments)
    bags, notices = recordings_in(arguments.bags)
    tell(*notices)
    settings = WatchSettings(learn_turns=arguments.learn)
    topics = topics_of(arguments)
    jobs = [Job(bag.resolve(), machine, settings, topics) for bag in bags]
    outcomes = _watch(jobs, arguments)
    watched = [outcome.result for outcome in outcomes if outcome.result is not None]
    watched.sort(key=lambda each: str(each.bag))
    for name, each in zip(names_of(watched), watched, strict=True):
        _tell(name, each)
    if len(watched) > 1:
        print(memory_line(outcomes))
    _write(arguments, watched)
    unread = [each for each in watched if each.error]
    if unread and len(watched) == 1:
        raise UsageError(unread[0].error)
    # The exit code alone must show that a recording was not watched, which may not be healthy.
    missing = failed_line([each.bag.name for each in unread], len(watched), "watched")
    alarms = sum(len(each.alarms) for each in watched)
    if alarms:
        where = sum(bool(each.alarms) for each in watched)
        summary = f"{_counted(alarms, 'alarm')} in {_counted(where, 'recording')}"
        raise BeyondLimitError("; ".join(filter(None, (summary, missing))))
    if missing:
        raise UsageError(missing)


def _watch(jobs: list[Job], arguments: argparse.Namespace) -> list[Outcome[Watched]]:
    """Watch all recordings; return them in the order of completion."""
    samples = {job.bag: samples_of(job) for job in jobs} if on_terminal() else {}
    watched: list[Outcome[Watched]] = []
    total = 2 * sum(samples.values())  # each sample counts twice: when it is taken, and when it is watched
    with stages(total) as stage:
        done = stage("watching", 1.0, total)
        counted = over = 0

        def count(units: int) -> None:
            nonlocal counted
            counted += units
            if done is not None:
                done(units)

        for each in watch_bags(jobs, arguments.workers, arguments.dask, count):
            watched.append(each)
            over += 2 * samples.get(jobs[each.index].bag, 0)
            count(over - counted)  # other processes and unfinished recordings do not count themselves
    return watched


def _tell(name: str, watched: Watched) -> None:
    if watched.error:
        print(f"{name}: {watched.error}")
        return
    turns, alarms = len(watched.columns.get("turn", ())) - watched.learnt, watched.alarms
    first = f" at {watched.seconds(alarms[0]):.1f} s" if alarms else ""
    raised = f"{len(alarms)} alarms, first{first}" if len(alarms) > 1 else f"alarm{first}" if alarms else "no alarm"
    print(f"{name}: {turns} turns watched, {watched.learnt} learnt (not watched); {raised}")
    for note in watched.notes:
        print(f"  {note}")
    for alarm in alarms:
        print(f"  {watched.seconds(alarm):.1f} s, turn {alarm.turn}: {alarm.text}")


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _write(arguments: argparse.Namespace, watched: list[Watched]) -> None:
    trend = trend_table(watched) if arguments.parquet is not None else {}
    if trend:
        import pyarrow
        from pyarrow import parquet

        with staged(arguments.parquet) as partial:
            parquet.write_table(pyarrow.table(trend), partial)
    elif arguments.parquet is not None:
        tell(f"--parquet {arguments.parquet}: not written, as no turn was watched")
    if arguments.json is not None:
        recordings = [
            {
                "bag": name,
                "turns": len(each.columns.get("turn", ())),
                "learnt": each.learnt,
                "alarms": [dataclasses.asdict(alarm) | {"time_s": each.seconds(alarm)} for alarm in each.alarms],
                "notes": each.notes,
                "error": each.error,
            }
            for name, each in zip(names_of(watched), watched, strict=True)
        ]
        save_json(arguments.json, recordings)
