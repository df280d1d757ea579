"""Records and parts of an MCAP file: chunks, runs of messages outside chunks, messages within them, damage."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema, Statistics

from textile_twin_core.arrays import IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.cdr_decode import Bytes, MessageBlock, gather

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
LEAST_MESSAGE = 22
"""Bytes of a message record before its CDR."""


def walk(buffer: mmap.mmap | bytes, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Iterate over records between start and end: (opcode, position, end), without an incomplete last one."""
    unpack = HEAD.unpack_from
    while start + 9 <= end:
        opcode, length = unpack(buffer, start)
        after = start + 9 + length
        if after > end:
            return
        yield opcode, start, after
        start = after


class DamageError(RecordingError):
    """Error for a chunk with a wrong checksum, compression or record (`why`), or for a file that is not MCAP."""

    def __init__(self, message: str, why: str = "") -> None:
        super().__init__(message)
        self.why = why


def decompress(compression: str, data: bytes, size: int) -> bytes:
    """Decompress a chunk to this size; raises the errors of the compression library."""
    if compression == "zstd":
        import zstandard

        return zstandard.decompress(data, size)
    if compression == "lz4":
        import lz4.frame

        unpacked: bytes = lz4.frame.decompress(data)
        return unpacked
    if compression:
        raise ValueError(f"compression {compression[:16]!r} is unknown")
    return data


@dataclass
class Part:
    """Chunk, or run of messages outside chunks: its position and, where the file has an index, its messages."""

    start: int
    end: int
    first_ns: int
    last_ns: int
    chunked: bool
    index: dict[int, IntArray] = field(default_factory=dict)
    """Channel -> rows (log time, offset) of its messages; empty without an index."""
    heads: IntArray | None = None
    """Positions of the intact messages in a damaged chunk; None for an intact chunk."""

    @property
    def indexed_count(self) -> int:
        """Number of messages by the index; 0 without one."""
        return sum(map(len, self.index.values()))


@dataclass
class Messages:
    """Messages of one part, in the order of the file."""

    buffer: Bytes
    heads: IntArray

    def channels(self) -> IntArray:
        """Return the channel of each message."""
        return gather(self.buffer, self.heads + 9, "<u2").astype(np.int64)

    def counts(self) -> dict[int, int]:
        """Return the number of messages of each channel."""
        ids, numbers = np.unique(self.channels(), return_counts=True)
        return {int(channel): int(number) for channel, number in zip(ids, numbers, strict=True)}

    def span_ns(self) -> tuple[int, int]:
        """Return the log times of the first and last message; requires at least one message."""
        times = gather(self.buffer, self.heads + 15, "<u8")
        return int(times.min()), int(times.max())

    def block(self, which: IntArray) -> MessageBlock:
        """Return the chosen messages as a block."""
        heads = self.heads[which]
        sizes = gather(self.buffer, heads + 1, "<u8").astype(np.int64) - 22
        logged, published = (gather(self.buffer, heads + at, "<u8").astype(np.int64) for at in (15, 23))
        return MessageBlock(self.buffer, heads + 31, sizes, logged, published)


def find_gaps(buffer: Bytes, heads: IntArray) -> list[tuple[int, int]] | None:
    """Return the ranges of the chunk outside its indexed messages; None if the index does not fit the chunk."""
    if len(heads) == 0:
        return [(0, len(buffer))]
    if heads[0] < 0 or heads[-1] > len(buffer) - 31 or not (buffer[heads] == Opcode.MESSAGE).all():
        return None
    lengths = gather(buffer, heads + 1, "<u8")
    if (lengths > len(buffer)).any() or (lengths < LEAST_MESSAGE).any():
        return None
    ends = heads + 9 + lengths.astype(np.int64)
    starts_ofgaps = np.concatenate([[0], ends])
    ends_ofgaps = np.concatenate([heads, [len(buffer)]])
    if (ends_ofgaps < starts_ofgaps).any():
        return None
    wide = np.flatnonzero(ends_ofgaps > starts_ofgaps)
    return [(int(starts_ofgaps[k]), int(ends_ofgaps[k])) for k in wide]


def find_whole(buffer: Bytes, part: Part) -> IntArray:
    """Find the messages in an uncompressed damaged chunk whose channel and log time agree with its index."""
    rows = [np.column_stack([np.full(len(table), channel), table]) for channel, table in part.index.items()]
    table = np.concatenate(rows) if rows else np.empty((0, 3), np.int64)
    table = table[np.argsort(table[:, 2], kind="stable")]
    table = table[(table[:, 2] >= 0) & (table[:, 2] <= len(buffer) - 9 - LEAST_MESSAGE)]
    heads: IntArray = table[:, 2]
    right = buffer[heads] == Opcode.MESSAGE
    right &= gather(buffer, heads + 9, "<u2") == table[:, 0]
    right &= gather(buffer, heads + 15, "<u8").astype(np.int64) == table[:, 1]
    heads = heads[right]
    if len(heads) == 0:
        return heads
    lengths = gather(buffer, heads + 1, "<u8")
    room = np.append(heads[1:], len(buffer)) - heads - 9
    heads = heads[(lengths >= LEAST_MESSAGE) & (lengths <= np.maximum(room, 0).astype(np.uint64))]
    return heads


LOG_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".lvm", ".parquet", ".mat", ".h5", ".hdf5", ".tdms", ".mf4")
"""Suffixes of the tables of data loggers."""


def what_it_is(head: bytes) -> str:
    """Describe a file that is not MCAP, from its first bytes."""
    if not head:
        return "the file is empty"
    if head.startswith(b"#ROSBAG"):
        return "a ROS 1 bag, convert it first (rosbags-convert --src FILE --dst FOLDER)"
    if head.startswith(b"RRF"):
        return "a rerun recording, not a bag"
    return "not a bag"


class Damage:
    """Collection of the skipped parts of a file.

    Args:
        lost: Start and end of the part of the file in which no record can be separated from the next; None without one.
    """

    def __init__(self, lost: tuple[int, int] | None) -> None:
        self._lost = lost
        self._chunks: list[Part] = []
        self._why = ""
        self.undeclared = 0
        """Number of messages of undeclared channels."""

    def add(self, chunk: Part, why: str) -> None:
        """Add a chunk with its stated time span; only the first reason is reported, as the others rarely differ."""
        self._chunks.append(replace(chunk))
        self._why = self._why or why

    def words(self, found: int, stated: int | None, span_ns: tuple[int, int] | None) -> str:
        """Describe the missing data in one line; empty if nothing is missing.

        Args:
            found: Number of readable messages.
            stated: Number of messages by the summary of the file; None without one.
            span_ns: Log times of the first and last readable message; None without one.
        """
        words = []
        if self._chunks:
            n, size = len(self._chunks), sum(chunk.end - chunk.start for chunk in self._chunks)
            chunks = "a chunk" if n == 1 else f"{n} chunks"
            at = f"at byte {self._chunks[0].start}" + (" and after it" if n > 1 else "")
            words.append(f"{chunks} {at} ({size} bytes{self._span(span_ns)}): {self._why}")
        if self._lost:
            words.append(f"{self._lost[1] - self._lost[0]} bytes from byte {self._lost[0]} on are no records")
        if self.undeclared:
            words.append(f"{self.undeclared} messages are of channels that it does not declare")
        if stated is not None and found != stated:
            words.append(f"{found} of {stated} messages are found")
        elif words:
            words.append(f"{found} messages are found")
        return "; ".join(words)

    def _span(self, span_ns: tuple[int, int] | None) -> str:
        """Describe the time span of the chunks; empty if their stated times are damaged, too."""
        if span_ns is None:
            return ""
        first, last = min(chunk.first_ns for chunk in self._chunks), max(chunk.last_ns for chunk in self._chunks)
        length = span_ns[1] - span_ns[0] + 1
        if not span_ns[0] - length <= first <= last <= span_ns[1] + length:
            return ""
        begin, end = (first - span_ns[0]) * 1e-9, (last - span_ns[0]) * 1e-9
        return f", {begin:.3f} s to {end:.3f} s after the first message"


_LOOSE_BYTES = 1 << 20
"""Approximate size of a block of unchunked messages."""
_LEAST = {Opcode.CHUNK: 40, Opcode.FOOTER: 20}
_KNOWN = frozenset(int(opcode) for opcode in Opcode)
_PRIVATE = 0x80


class Contents:
    """Schemas, channels, metadata and parts of a complete, unchunked or truncated file.

    Attributes:
        truncated: True if the file ends without a footer.
        stated_count: Number of messages by the summary; None without a summary.
        lost: Start and end of the part behind a damaged head of a record; None without one.
    """

    def __init__(self, file: mmap.mmap) -> None:
        self._file = file
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.parts: list[Part] = []
        self.truncated = True
        self.stated_count: int | None = None
        self.lost: tuple[int, int] | None = None
        self._scan()

    def describe(self, opcode: int, body: bytes) -> None:
        """Read a record that describes others; a damaged one is skipped, as most are in the file twice."""
        with suppress(EndOfFile, ValueError, struct.error):
            self._take(opcode, body)

    def _take(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self.channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            self.stated_count = Statistics.read(stream).message_count
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self.metadata[metadata.name] = metadata.metadata

    def _scan(self) -> None:
        loose: Part | None = None
        indexed: Part | None = None  # the chunk whose index follows
        for opcode, start, end in self._records():
            if opcode == Opcode.MESSAGE and end - start >= 9 + LEAST_MESSAGE:
                (time,) = struct.unpack_from("<Q", self._file, start + 15)
                if loose is None or start - loose.start > _LOOSE_BYTES:
                    loose = Part(start, end, time, time, chunked=False)
                    self.parts.append(loose)
                loose.end, loose.first_ns, loose.last_ns = (
                    end,
                    min(time, loose.first_ns),
                    max(time, loose.last_ns),
                )
            elif opcode == Opcode.CHUNK:
                first, last = struct.unpack_from("<QQ", self._file, start + 9)
                self.parts.append(Part(start, end, first, last, chunked=True))
            elif opcode == Opcode.MESSAGE_INDEX and indexed is not None:
                self._index(indexed, start + 9, end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.STATISTICS):
                self.describe(opcode, self._file[start + 9 : end])
            elif opcode == Opcode.FOOTER:
                self.truncated = self._file[end : end + len(MAGIC)] != MAGIC
            if opcode != Opcode.MESSAGE_INDEX:
                indexed = self.parts[-1] if opcode == Opcode.CHUNK else None
        if self.lost is not None:
            self.truncated = self._file[-len(MAGIC) :] != MAGIC
            if self.truncated:
                self.lost = None  # the last record is incomplete
        if self.truncated and self.parts:
            # The index of the last chunk may be incomplete: find its messages record by record.
            self.parts[-1].index.clear()

    def _records(self) -> Iterator[tuple[int, int, int]]:
        """Iterate over records, (opcode, position, end) each, until one has an impossible head."""
        at, size = len(MAGIC), len(self._file)
        while at + 9 <= size:
            opcode, length = HEAD.unpack_from(self._file, at)
            after = at + 9 + length
            known = opcode in _KNOWN or opcode >= _PRIVATE
            if not known or after > size or length < _LEAST.get(opcode, 0):
                break
            yield opcode, at, after
            at = after
            if opcode == Opcode.FOOTER:
                return
        self.lost = (at, size)

    def _index(self, part: Part, start: int, end: int) -> None:
        """Read the index of one channel; without a valid one, messages are found record by record."""
        if end - start >= 6:
            channel, length = struct.unpack_from("<HI", self._file, start)
            if length == end - start - 6 and length % 16 == 0:
                rows = np.frombuffer(self._file, "<i8", length // 8, start + 6)  # without a copy
                part.index[channel] = rows.reshape(-1, 2)
