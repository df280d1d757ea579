"""Parts of an MCAP file: chunks, runs of messages outside chunks, and positions of messages within them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from mcap.opcode import Opcode

from textile_twin_core.arrays import IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.cdr_decode import Bytes, MessageBlock, gather

LEAST_MESSAGE = 22
"""Bytes of a message record before its CDR."""


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
