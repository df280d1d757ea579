"""Cost of writing and reading recordings: a million JointStates, ours beside rosbags, mcap and rerun.

Run from the root of the repository: python -m tests.benchmarks.recordings [MESSAGES]
Times are those of the processor, memory is the maximum of a fresh process that does this alone. mcap_ros2 is beside
the others where it is installed (pip install mcap-ros2-support).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from textile_twin_core.files import read_motion_table, write_table
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.cdr_decode import layouts
from textile_twin_core.recordings.mcap_parts import Messages, decompress, walk
from textile_twin_core.recordings.schemas import JOINT_STATE, message_schema


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


def _columns_with_mcap(bag: Path) -> None:
    """Chunks by mcap's stream reader, their messages by our decoding in bulk."""
    stamps, angles = [], []
    with next(bag.glob("*.mcap")).open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if not isinstance(record, Chunk):
                continue
            data = decompress(record.compression, record.data, record.uncompressed_size)
            heads = [start for opcode, start, _ in walk(data, 0, len(data)) if opcode == Opcode.MESSAGE]
            messages = Messages(np.frombuffer(data, np.uint8), np.array(heads, np.int64))
            block = messages.block(np.arange(len(heads)))
            for layout, chosen in layouts(block, JOINT_STATE, "main_shaft/angle"):
                stamps.append(layout.stamps(block, chosen))
                angles.append(layout.read(block, chosen, "position", layout.names.index("main_shaft")))
    np.concatenate(stamps), np.concatenate(angles)


def _columns_with_rerun(bag: Path) -> None:
    """Arrow columns by rerun's reader."""
    from rerun.chunk import McapReader

    for chunk in McapReader(next(bag.glob("*.mcap"))).stream():
        chunk.to_record_batch()


def _written_with_mcap(bag: Path, copy: Path, stamps: list[int]) -> None:
    """CDR bytes that are there already, one by one by mcap's writer."""
    _, _, cdr = next(open_bag(bag).raw_messages())
    with copy.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema(JOINT_STATE, "ros2msg", b"")
        channel = writer.register_channel("main_shaft/angle", "cdr", schema)
        for stamp in stamps:
            writer.add_message(channel, stamp, cdr, stamp)
        writer.finish()


def _written_with_mcap_ros2(copy: Path, stamps: list[int], angles: list[float]) -> None:
    from mcap_ros2.writer import Writer as Ros2Writer

    with copy.open("wb") as file:
        writer = Ros2Writer(file)
        schema = writer.register_msgdef(JOINT_STATE, message_schema(JOINT_STATE).text)
        for stamp, angle in zip(stamps, angles, strict=True):
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
            message = {"header": header, "name": ["main_shaft"], "position": [angle], "velocity": [], "effort": []}
            writer.write_message("main_shaft/angle", schema, message, stamp)
        writer.finish()


READERS: dict[str, Callable[[Path], object]] = {
    "read into arrays": lambda bag: open_bag(bag).read_angles(),
    "mcap's chunks, our decoding": _columns_with_mcap,
    "rerun, Arrow columns": _columns_with_rerun,
    "rosbags, decoded": _decode_with_rosbags,
}
_QUICK = tuple(READERS)[:3]
if find_spec("mcap_ros2") is not None:
    READERS["mcap_ros2, decoded"] = _decode_with_mcap_ros2


def _memory_of(reader: str, bag: Path) -> float:
    """Maximum memory [MB] of a fresh process that reads the bag once, with all that Python and the libraries take."""
    program = (
        "import sys; from pathlib import Path; from tests.benchmarks.recordings import READERS;"
        "READERS[sys.argv[1]](Path(sys.argv[2]));"
        " print(open('/proc/self/status').read().partition('VmHWM:')[2].split()[0])"
    )
    command = [sys.executable, "-c", program, reader, str(bag)]
    said = subprocess.run(command, check=True, capture_output=True, text=True)
    return int(said.stdout) / 1024.0


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    rng = np.random.default_rng(0)
    stamps = 1_700_000_000_000_000_000 + np.arange(count) * 2_000_000 + rng.integers(0, 20_000, count)
    angles = np.cumsum(rng.normal(0.03, 0.001, count))
    with tempfile.TemporaryDirectory() as folder:
        bag, other, table, copy = (Path(folder) / name for name in ("bag", "copy", "table.csv", "copy.mcap"))

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
            ("mcap, written", lambda: _written_with_mcap(bag, copy, stamps.tolist()), 1),
            *((name, partial(reader, bag), 3 if name in _QUICK else 1) for name, reader in READERS.items()),
            ("raw messages in order of time", lambda: sum(1 for _ in open_bag(bag).raw_messages()), 1),
            ("rosbags, raw", lambda: _raw_with_rosbags(bag), 1),
            ("mcap, records", lambda: _records_with_mcap(bag), 1),
            ("table of 3 columns written as CSV", lambda: write_table(table, columns), 1),
            ("table read from CSV", lambda: read_motion_table(table), 1),
        ]
        if find_spec("mcap_ros2") is not None:
            write_ros2 = partial(_written_with_mcap_ros2, copy, stamps.tolist(), angles.tolist())
            rows.append(("mcap_ros2, encoded and written", write_ros2, 1))
        print(f"{count} JointStates of one joint")
        for name, work, times in rows:
            seconds = _seconds(work, times)
            print(f"{name:34} {seconds:7.2f} s {seconds / count * 1e9:8.0f} ns each")
        for name in READERS:
            print(f"{name:34} {_memory_of(name, bag):7.0f} MB at most")


if __name__ == "__main__":
    main()
