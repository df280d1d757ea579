"""What it costs to write and read recordings: a million JointStates, ours beside the rosbags and mcap libraries.

Run from the root of the repository: python -m tests.benchmarks.recordings [MESSAGES]
Times are those of the processor. mcap_ros2 is beside the others where it is installed (pip install mcap-ros2-support).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
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
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
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


def _decode_with_mcap_ros2(bag: Path) -> None:
    from mcap_ros2.reader import read_ros2_messages

    for message in read_ros2_messages(str(next(bag.glob("*.mcap")))):
        _ = message.ros_msg


def _memory_of_reading(bag: Path) -> float:
    """The most that a process of its own holds [MB], which does nothing but read the angles."""
    program = (
        "import sys; from textile_twin_core.recordings import open_bag; open_bag(sys.argv[1]).read_angles();"
        " print(open('/proc/self/status').read().partition('VmHWM:')[2].split()[0])"
    )
    said = subprocess.run([sys.executable, "-c", program, str(bag)], check=True, capture_output=True, text=True)
    return int(said.stdout) / 1024.0


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
        if find_spec("mcap_ros2") is not None:
            rows.append(("mcap_ros2, decoded", lambda: _decode_with_mcap_ros2(bag), 1))
        print(f"{count} JointStates of one joint")
        for name, work, times in rows:
            seconds = _seconds(work, times)
            print(f"{name:34} {seconds:7.2f} s {seconds / count * 1e9:8.0f} ns each")
        print(f"read into arrays: {_memory_of_reading(bag):.0f} MB at most, with all that Python and numpy take")


if __name__ == "__main__":
    main()
