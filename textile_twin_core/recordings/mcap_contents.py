"""What an MCAP file declares and where its messages lie, found by one walk through its records."""

from __future__ import annotations

import mmap
import struct
from contextlib import suppress
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema, Statistics

from textile_twin_core.recordings.mcap_framing import MAGIC, Framing
from textile_twin_core.recordings.mcap_parts import LEAST_MESSAGE, Part

_LOOSE_BYTES = 1 << 20
"""Unchunked messages are handed on in blocks of about this many bytes."""


class Contents:
    """Schemas, channels, metadata and parts of a file; complete, unchunked and cut-off files are walked alike.

    `truncated` is set when the file ends without a footer; `told` is the number of messages of which its summary
    speaks, None without one; `lost` are the stretches, start and end, in which no record can be found.
    """

    def __init__(self, file: mmap.mmap) -> None:
        self._file = file
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.parts: list[Part] = []
        self.truncated = True
        self.told: int | None = None
        self.lost: list[tuple[int, int]] = []
        self._scan()

    def describe(self, opcode: int, body: bytes) -> None:
        """Take in a record that describes others; a damaged one is left out, as most are in the file twice."""
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
            self.told = Statistics.read(stream).message_count
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self.metadata[metadata.name] = metadata.metadata

    def _scan(self) -> None:
        loose: Part | None = None
        indexed: Part | None = None  # the chunk whose index follows
        framing, reached = Framing(self._file, self.channels), len(MAGIC)
        for opcode, start, end in framing:
            if start != reached:  # past a stretch that is lost
                loose = indexed = None
            reached = end
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
        self.lost = framing.lost
        if self.truncated and self.lost and self.lost[-1][1] == len(self._file):
            if self._file[-len(MAGIC) :] == MAGIC:
                self.truncated = False  # the end is there: what stands before it is damaged
            else:
                self.lost.pop()  # the last record was not written to its end
        if self.truncated and self.parts:
            # The index of the last chunk may be cut off between two channels: find its messages by walking.
            self.parts[-1].index.clear()

    def _index(self, part: Part, start: int, end: int) -> None:
        """Take in the index of one channel; without it, as when it is damaged, messages are found by walking."""
        if end - start >= 6:
            channel, length = struct.unpack_from("<HI", self._file, start)
            if length == end - start - 6 and length % 16 == 0:
                rows = np.frombuffer(self._file, "<i8", length // 8, start + 6)  # as it lies in the file
                part.index[channel] = rows.reshape(-1, 2)
