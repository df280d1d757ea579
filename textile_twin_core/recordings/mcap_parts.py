"""Parts of an MCAP file: chunks, stretches of messages outside them, and where messages lie in one."""

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
    """A chunk whose checksum, compression or records do not hold (`why` says which), or a file that is none."""

    def __init__(self, message: str, why: str = "") -> None:
        super().__init__(message)
        self.why = why


def decompress(compression: str, data: bytes, size: int) -> bytes:
    """The bytes of a chunk, of this size; raises what the library of its compression raises."""
    if compression == "zstd":
        import zstandard

        return zstandard.decompress(data, size)
    if compression == "lz4":
        import lz4.frame

        unpacked: bytes = lz4.frame.decompress(data)
        return unpacked
    if compression:
        raise ValueError(f"compression {compression[:16]!r} is not known")
    return data


@dataclass
class Part:
    """A chunk, or a stretch of messages outside chunks: where it lies and, if the file tells, what it has."""

    start: int
    end: int
    first_ns: int
    last_ns: int
    chunked: bool
    index: dict[int, IntArray] = field(default_factory=dict)
    """Channel -> rows (log time, offset) of its messages; empty when the file does not tell."""
    heads: IntArray | None = None
    """Where the messages that are whole begin in a damaged chunk; None for one that is not damaged."""

    @property
    def told(self) -> int:
        """Number of messages by the index; 0 without one."""
        return sum(map(len, self.index.values()))


@dataclass
class Messages:
    """All messages of one part: one entry per message, in the order of the file."""

    buffer: Bytes
    heads: IntArray

    def channels(self) -> IntArray:
        """Channel of each message."""
        return gather(self.buffer, self.heads + 9, "<u2").astype(np.int64)

    def counts(self) -> dict[int, int]:
        """Messages of each channel."""
        ids, numbers = np.unique(self.channels(), return_counts=True)
        return {int(channel): int(number) for channel, number in zip(ids, numbers, strict=True)}

    def span_ns(self) -> tuple[int, int]:
        """Log times of the first and last message of which there is at least one."""
        times = gather(self.buffer, self.heads + 15, "<u8")
        return int(times.min()), int(times.max())

    def block(self, which: IntArray) -> MessageBlock:
        """The chosen messages."""
        heads = self.heads[which]
        sizes = gather(self.buffer, heads + 1, "<u8").astype(np.int64) - 22
        logged, published = (gather(self.buffer, heads + at, "<u8").astype(np.int64) for at in (15, 23))
        return MessageBlock(self.buffer, heads + 31, sizes, logged, published)


def find_gaps(buffer: Bytes, heads: IntArray) -> list[tuple[int, int]] | None:
    """Stretches of the chunk that its indexed messages leave; None when the index does not fit the chunk."""
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
    """Heads of the messages of a damaged chunk, not compressed, that its index tells rightly: channel and log time."""
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
"""Names of loggers' tables."""


def what_it_is(head: bytes) -> str:
    """What a file that is no MCAP file seems to be, from its first bytes."""
    if not head:
        return "the file is empty"
    if head.startswith(b"#ROSBAG"):
        return "a ROS 1 bag, convert it first (rosbags-convert --src FILE --dst FOLDER)"
    if head.startswith(b"RRF"):
        return "a rerun recording, no bag"
    return "not a bag"
