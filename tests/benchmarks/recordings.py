"""How fast recordings are written and read: a million JointStates, ours beside the rosbags and mcap libraries.

Run from the root of the repository: python -m tests.benchmarks.recordings [MESSAGES]
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from textile_twin_core.files import read_motion_table, write_table
from textile_twin_core.recordings import BagWriter, open_bag


def _seconds(work: Callable[[], object], times: int) -> float:
    best = float("inf")
    for _ in range(times):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return best


def _decode_with_rosbags(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)


def _raw_with_rosbags(bag: Path) -> None:
    with Reader(bag) as reader:
        for _ in reader.messages():
            pass


def _records_with_mcap(bag: Path) -> None:
    with next(bag.glob("*.mcap")).open("rb") as file:
        for _ in StreamReader(file).records:
            pass


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    rng = np.random.default_rng(0)
    stamps = 1_700_000_000_000_000_000 + np.arange(count) * 2_000_000 + rng.integers(0, 20_000, count)
    angles = np.cumsum(rng.normal(0.03, 0.001, count))
    with tempfile.TemporaryDirectory() as folder:
        bag, other, table = (Path(folder) / name for name in ("bag", "copy", "table.csv"))

        def write() -> None:
            with BagWriter(bag, overwrite=True) as out:
                out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], angles)

        def write_singly() -> None:
            message = open_bag(bag).raw_messages()
            _, _, cdr = next(message)
            with BagWriter(other, overwrite=True) as out:
                out.add_topic("main_shaft/angle", "sensor_msgs/msg/JointState")
                for stamp in stamps.tolist():
                    out.write("main_shaft/angle", stamp, cdr)

        columns = {"theta_rad": angles, "omega_rad_s": angles, "alpha_rad_s2": angles}
        rows: list[tuple[str, Callable[[], object], int]] = [
            ("written from arrays", write, 3),
            ("written message by message", write_singly, 1),
            ("read into arrays", lambda: open_bag(bag).read_angles(), 3),
            ("raw messages in order of time", lambda: sum(1 for _ in open_bag(bag).raw_messages()), 1),
            ("rosbags, raw", lambda: _raw_with_rosbags(bag), 1),
            ("mcap, records", lambda: _records_with_mcap(bag), 1),
            ("rosbags, decoded", lambda: _decode_with_rosbags(bag), 1),
            ("table of 3 columns written as CSV", lambda: write_table(table, columns), 1),
            ("table read from CSV", lambda: read_motion_table(table), 1),
        ]
        print(f"{count} JointStates of one joint")
        for name, work, times in rows:
            seconds = _seconds(work, times)
            print(f"{name:34} {seconds:7.2f} s {seconds / count * 1e9:8.0f} ns each")


if __name__ == "__main__":
    main()
