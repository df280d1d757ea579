"""Declarations of an MCAP file and positions of its messages, from one pass over its records."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema, Statistics

from textile_twin_core.recordings.mcap_parts import HEAD, LEAST_MESSAGE, MAGIC, Part

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
