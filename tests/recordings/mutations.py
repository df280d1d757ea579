"""Randomly damaged recordings, and the required result: the original messages, or an error in one line."""

from __future__ import annotations

import resource
import signal
import struct
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from types import FrameType

import mcap.records as records
import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from textile_twin_core.errors import RecordingError, TwinError
from textile_twin_core.recordings import BagWriter, open_bag

START_NS = 1_700_000_000_000_000_000
CHUNK = 0x06
EXTREMES = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1, 2**40)
ANGLE, TORQUE = "main_shaft/angle", "balancing_torque/measured"


def chunked(path: Path, count: int = 400) -> Path:
    """Write a file of several compressed chunks with indices."""
    stamps = START_NS + np.arange(count) * 2_000_000
    with BagWriter(path) as out:
        for part in np.array_split(np.arange(count), 4):
            out.write_joint_states(ANGLE, stamps[part], ["main_shaft"], part * 0.03)
            out.write_wrenches(TORQUE, stamps[part] + 1_000_000, np.sin(part * 0.03))
            out._file._end_chunk()
    return path


def unchunked(path: Path, whole: Path) -> Path:
    """Write the same messages without chunks, checksums or summary, as a small logger does."""
    bag, builder = open_bag(whole), RecordBuilder()
    data = b"\x89MCAP0\r\n"

    def put(record: records.McapRecord) -> bytes:
        record.write(builder)
        end: bytes = builder.end()  # type: ignore[no-untyped-call]
        return end

    data += put(records.Header(profile="ros2", library="test"))
    for number, topic in enumerate(bag.topics.values(), 1):
        assert topic.schema is not None
        text = topic.schema.text.encode()
        data += put(records.Schema(id=number, name=topic.msgtype, encoding="ros2msg", data=text))
        data += put(records.Channel(id=number, topic=topic.name, message_encoding="cdr", metadata={}, schema_id=number))
    numbers = {name: number for number, name in enumerate(bag.topics, 1)}
    for name, log_ns, raw in bag.raw_messages():
        data += struct.pack("<BQHIQQ", 5, 22 + len(raw), numbers[name], 0, log_ns, log_ns) + raw
    path.write_bytes(data)
    return path


def by_library(
    path: Path,
    whole: Path,
    form: CompressionType = CompressionType.NONE,
    chunk_bytes: int = 8192,
    crcs: bool = True,
    indices: bool = True,
) -> Path:
    """Write the same messages in chunks, by the mcap library."""
    bag = open_bag(whole)
    kinds = {} if indices else {"index_types": 0, "use_statistics": False, "use_summary_offsets": False}
    with path.open("wb") as file:
        writer = Writer(file, chunk_bytes, form, enable_crcs=crcs, **kinds)
        writer.start("ros2", "test")
        numbers = {}
        for topic in bag.topics.values():
            assert topic.schema is not None
            schema = writer.register_schema(topic.msgtype, "ros2msg", topic.schema.text.encode())
            numbers[topic.name] = writer.register_channel(topic.name, "cdr", schema)
        for name, log_ns, raw in bag.raw_messages():
            writer.add_message(numbers[name], log_ns, raw, log_ns)
        writer.finish()
    return path


def record_starts(data: bytes) -> list[int]:
    """Return the positions of the records of an MCAP file."""
    starts, at = [], 8
    while at + 9 <= len(data) - 8:
        starts.append(at)
        at += 9 + int(struct.unpack_from("<Q", data, at + 1)[0])
    return starts


def mutated(data: bytes, random: Random) -> tuple[bytes, str]:
    """Return a copy with one to three faults of storage or of a faulty program, and their names.

    Half of them are in the head of a record, where the effect is largest.
    """
    spoilt, said = bytearray(data), []
    starts = record_starts(data)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        at = random.choice(starts) + random.randrange(40) if random.random() < 0.5 else random.randrange(len(data))
        at = min(max(at, 8), max(len(spoilt) - 1, 8))
        kind = random.choice(("bit", "byte", "length", "cut", "zeros", "twice", "lost", "noise"))
        said.append(f"{kind} at {at}")
        if kind == "bit":
            spoilt[at : at + 1] = bytes(byte ^ 1 << random.randrange(8) for byte in spoilt[at : at + 1])
        elif kind == "byte":
            spoilt[at : at + 1] = random.randbytes(1)
        elif kind == "length":
            width = random.choice(("<Q", "<I"))
            value = random.choice(EXTREMES) % (1 << (8 * struct.calcsize(width)))
            spoilt[at : at + struct.calcsize(width)] = struct.pack(width, value)
        elif kind == "cut":
            del spoilt[at:]
        elif kind == "zeros":
            spoilt[at : at + 512] = bytes(min(512, len(spoilt) - at))
        elif kind == "twice":
            spoilt[at:at] = spoilt[at : at + 200]
        elif kind == "lost":
            del spoilt[at : at + random.randrange(1, 400)]
        else:
            spoilt[at : at + 64] = random.randbytes(min(64, len(spoilt) - at))
    return bytes(spoilt), ", ".join(said)


class Judge:
    """Reader of damaged recordings that counts the results. Any result but the original data or one line is a failure.

    Args:
        whole: The original recording.
        checked: True if checksums protect its messages, so that none may be altered.
    """

    def __init__(self, whole: Path, checked: bool) -> None:
        bag = open_bag(whole)
        self._messages = {name: set() for name in bag.topics}  # type: dict[str, set[tuple[int, bytes]]]
        for name, log_ns, raw in bag.raw_messages():
            self._messages[name].add((log_ns, raw))
        self._known = set().union(*self._messages.values())
        self._checked = checked
        self.outcomes: Counter[str] = Counter()
        self.salvaged = 0
        """Number of refused recordings from which messages were salvaged."""
        self.slowest_s = 0.0

    def judge(self, spoilt: Path, said: str) -> None:
        """Read everything in a damaged recording.

        Raises:
            AssertionError: The error is of another kind or has several lines, data were never recorded, or
                reading hangs.
        """
        started = time.monotonic()
        try:
            with time_limit(10.0):
                self._read(spoilt)
        except TwinError as error:
            assert "\n" not in str(error), (said, error)
            self.outcomes["refused in a line"] += 1
            self._salvage(spoilt, said)
        except Exception as error:
            raise AssertionError(f"{said}: {type(error).__name__}: {error}") from error
        else:
            self.outcomes["read"] += 1
        self.slowest_s = max(self.slowest_s, time.monotonic() - started)

    def _salvage(self, spoilt: Path, said: str) -> None:
        """Return the messages that `recover` copies from a refused recording."""
        try:
            bag = open_bag(spoilt, salvage=True)
        except RecordingError as error:
            assert "\n" not in str(error), (said, error)
            return
        found = Counter((log_ns, raw) for _, log_ns, raw in bag.raw_messages())
        assert bag.notices, f"{said}: salvaged in silence"
        assert found.total() == bag.message_count, said
        assert not self._checked or self._known.issuperset(found), f"{said}: a message that was never recorded"
        self.salvaged += bool(found)

    def _read(self, spoilt: Path) -> None:
        bag, found = open_bag(spoilt), 0
        for name, log_ns, raw in bag.raw_messages():
            found += 1
            if self._checked:
                assert (log_ns, raw) in self._known, f"{name}: a message that was never recorded"
        if self._checked:
            assert found == len(self._known) or bag.notices, f"{found} of {len(self._known)} messages, in silence"
        for read, topic in ((bag.read_angles, ANGLE), (bag.read_torques, TORQUE)):
            try:
                read(topic)
            except RecordingError as error:
                assert "\n" not in str(error)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise an alarm after this much processor time of the process, independent of other processes."""

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise AssertionError(f"not done within {seconds:g} s of processor time")

    handler = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)


@contextmanager
def memory_limit(more_bytes: int) -> Iterator[None]:
    """Limit the memory to the present use plus `more_bytes`; larger requests raise MemoryError."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + more_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def cut_everywhere(folder: Path, offsets: int, seed: int) -> int:
    """Truncate a recording at every record boundary and at random offsets, and check that all earlier messages
    are read.

    Args:
        folder: Folder for the recordings.
        offsets: Number of random offsets, besides the boundaries.
        seed: Seed of the offsets.

    Returns:
        The number of cuts.
    """
    random, whole, cut = Random(seed), chunked(folder / "whole.mcap"), folder / "cut.mcap"
    data = whole.read_bytes()
    bounds = record_starts(data)
    ends = [after for start, after in zip(bounds, [*bounds[1:], len(data)], strict=True) if data[start] == CHUNK]
    with whole.open("rb") as file:
        chunks = [
            record for record in StreamReader(file, emit_chunks=True).records if isinstance(record, records.Chunk)
        ]
    counts = [sum(isinstance(record, records.Message) for record in breakup_chunk(chunk)) for chunk in chunks]
    places = sorted({*bounds, *(random.randrange(len(data)) for _ in range(offsets))})
    for place in places:
        cut.write_bytes(data[:place])
        expected = sum(count for count, end in zip(counts, ends, strict=True) if end <= place)
        try:
            bag = open_bag(cut)
        except RecordingError:
            assert place < 8, f"cut at {place}: refused"
            continue
        found = sum(1 for _ in bag.raw_messages())
        assert found == bag.message_count == expected and bag.notices, f"cut at {place}: {found} of {expected}"
    return len(places)


def run(folder: Path, count: int, seed: int) -> dict[str, Judge]:
    """Damage each kind of recording, `count` times in total, and judge the results.

    Args:
        folder: Folder for the recordings.
        count: Number of damaged recordings of all kinds together.
        seed: Seed of the faults.
    """
    random = Random(seed)
    whole = chunked(folder / "chunked.mcap")
    kinds = {
        "chunked": (whole, True),
        "unchunked": (unchunked(folder / "unchunked.mcap", whole), False),
        "without checksums": (by_library(folder / "without.mcap", whole, crcs=False), False),
    }
    judges = {name: Judge(path, checked) for name, (path, checked) in kinds.items()}
    spoilt = folder / "spoilt.mcap"
    with memory_limit(140 << 20):
        for number in range(count):
            name = list(kinds)[number % len(kinds)]
            data, said = mutated(kinds[name][0].read_bytes(), random)
            spoilt.write_bytes(data)
            judges[name].judge(spoilt, f"seed {seed}, {name} {number}: {said}")
    return judges
