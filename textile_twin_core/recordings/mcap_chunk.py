"""Chunk of an MCAP file being written: messages in sequence, and the index of each channel."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
from mcap.opcode import Opcode

from textile_twin_core.arrays import IntArray
from textile_twin_core.recordings.cdr_decode import Bytes

MESSAGE_HEAD_BYTES = 31
"""Size of a message record before its CDR bytes."""
_MESSAGE_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log", "<u8"),
        ("publish", "<u8"),
    ]
)
_HEAD = struct.Struct("<BQHIQQ").pack
_INDEX_HEAD = struct.Struct("<BQHI").pack


class PendingChunk:
    """Messages that wait to be written together, with their log times."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.span_ns: tuple[int, int] | None = None
        """First and last log time; None without a message."""
        self._rows: dict[int, list[IntArray]] = {}
        self._singles: dict[int, list[int]] = {}
        """Log time and offset, alternating, of messages added one by one."""

    def add(self, channel: int, sequence: int, log_time_ns: int, publish_time_ns: int, cdr: bytes) -> None:
        """Append one message."""
        self._singles.setdefault(channel, []).extend((log_time_ns, len(self.data)))
        length = MESSAGE_HEAD_BYTES - 9 + len(cdr)
        self.data += _HEAD(Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_time_ns, publish_time_ns)
        self.data += cdr
        self._reach(log_time_ns, log_time_ns)

    def add_rows(
        self, channel: int, sequence: int, log_times_ns: IntArray, publish_times_ns: IntArray, rows: Bytes
    ) -> None:
        """Append messages of equal length from this sequence number on: times (n,), CDR bytes (n, size)."""
        n, size = rows.shape
        messages = np.empty((n, MESSAGE_HEAD_BYTES + size), np.uint8)
        heads = np.empty(n, _MESSAGE_HEAD)
        heads["opcode"], heads["length"], heads["channel"] = Opcode.MESSAGE, MESSAGE_HEAD_BYTES - 9 + size, channel
        heads["sequence"] = (sequence + np.arange(n)) & 0xFFFFFFFF
        heads["log"], heads["publish"] = log_times_ns, publish_times_ns
        messages[:, :MESSAGE_HEAD_BYTES] = heads.view(np.uint8).reshape(n, MESSAGE_HEAD_BYTES)
        messages[:, MESSAGE_HEAD_BYTES:] = rows
        offsets = len(self.data) + np.arange(n) * messages.shape[1]
        self._rows.setdefault(channel, []).append(np.stack([log_times_ns, offsets], axis=1))
        self.data += messages.tobytes()
        self._reach(int(log_times_ns.min()), int(log_times_ns.max()))

    def indices(self) -> Iterator[tuple[int, bytes]]:
        """Iterate over channel numbers and their index records, sorted by log time."""
        for channel, singles in self._singles.items():
            self._rows.setdefault(channel, []).append(np.array(singles, np.int64).reshape(-1, 2))
        for channel, pieces in self._rows.items():
            table = np.concatenate(pieces)
            body = table[np.argsort(table[:, 0], kind="stable")].astype("<u8").tobytes()
            yield channel, _INDEX_HEAD(Opcode.MESSAGE_INDEX, 6 + len(body), channel, len(body)) + body

    def _reach(self, first_ns: int, last_ns: int) -> None:
        low, high = self.span_ns or (first_ns, last_ns)
        self.span_ns = (min(first_ns, low), max(last_ns, high))
