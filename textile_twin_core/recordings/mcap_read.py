"""MCAP files into blocks of messages: one walk serves complete, unchunked and cut-off files."""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema, Statistics

from textile_twin_core.arrays import IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.cdr_decode import Bytes, MessageBlock
from textile_twin_core.recordings.mcap_parts import LEAST_MESSAGE, Messages, Part, decompress, find_gaps, what_it_is
from textile_twin_core.recordings.rosbag2_metadata import OfferedQos, TopicInfo
from textile_twin_core.recordings.schemas import MessageSchema

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_LOOSE_BYTES = 1 << 20
"""Unchunked messages are handed on in blocks of about this many bytes."""


class McapFile:
    """One MCAP file, opened: its channels, its message counts and its messages in blocks.

    `truncated` is set when the file ends without a footer, as after a kill; what is whole is read.
    Raises RecordingError for a file that is no MCAP file or is damaged in the middle.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.parts: list[Part] = []
        self.truncated = True
        self._told: int | None = None
        try:
            with path.open("rb") as file:
                head = file.read(len(MAGIC))
                if head != MAGIC:
                    raise RecordingError(f"{path}: {what_it_is(head)}; give a rosbag2 folder or an .mcap file")
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
        self._bytes: Bytes = np.frombuffer(self._map, np.uint8)
        self._scan()
        self.counts = self._count()
        self._let_go()

    @property
    def topics(self) -> dict[int, TopicInfo]:
        """The topic of each channel."""
        return {number: self._topic(channel) for number, channel in self.channels.items()}

    def _topic(self, channel: Channel) -> TopicInfo:
        schema = self.schemas.get(channel.schema_id)
        text = None
        if schema is not None:
            type_hash = channel.metadata.get("topic_type_hash", "")
            text = MessageSchema(schema.data.decode(errors="replace"), type_hash, schema.encoding)
        qos = OfferedQos.of(channel.metadata.get("offered_qos_profiles", ""))
        return TopicInfo(channel.topic, schema.name if schema else "", self.counts.get(channel.id, 0), qos, text)

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and last message; None without messages."""
        filled = [part for part in self.parts if part.last_ns]
        if not filled:
            return None
        return min(part.first_ns for part in filled), max(part.last_ns for part in filled)

    def _record(self, opcode: int, body: bytes) -> None:
        """Take in a record that describes others; a damaged one is left out, as most are in the file twice."""
        with suppress(EndOfFile, ValueError, struct.error):
            self._describe(opcode, body)

    def _describe(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self.channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            self._told = Statistics.read(stream).message_count
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self.metadata[metadata.name] = metadata.metadata

    def _walk(self, buffer: mmap.mmap | bytes, start: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Records between start and end: (opcode, position, end), without an incomplete last one."""
        unpack = _HEAD.unpack_from
        while start + 9 <= end:
            opcode, length = unpack(buffer, start)
            after = start + 9 + length
            if after > end:
                return
            yield opcode, start, after
            start = after

    def _scan(self) -> None:
        loose: Part | None = None
        indexed: Part | None = None  # the chunk whose index follows
        for opcode, start, end in self._walk(self._map, len(MAGIC), len(self._map)):
            if opcode == Opcode.MESSAGE and end - start >= 9 + LEAST_MESSAGE:
                (time,) = struct.unpack_from("<Q", self._map, start + 15)
                if loose is None or start - loose.start > _LOOSE_BYTES:
                    loose = Part(start, end, time, time, chunked=False)
                    self.parts.append(loose)
                loose.end, loose.first_ns, loose.last_ns = (
                    end,
                    min(time, loose.first_ns),
                    max(time, loose.last_ns),
                )
            elif opcode == Opcode.CHUNK:
                first, last = struct.unpack_from("<QQ", self._map, start + 9)
                self.parts.append(Part(start, end, first, last, chunked=True))
            elif opcode == Opcode.MESSAGE_INDEX and indexed is not None:
                self._index(indexed, start + 9, end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.STATISTICS):
                self._record(opcode, self._map[start + 9 : end])
            elif opcode == Opcode.FOOTER:
                self.truncated = self._map[end : end + len(MAGIC)] != MAGIC
                break
            if opcode != Opcode.MESSAGE_INDEX:
                indexed = self.parts[-1] if opcode == Opcode.CHUNK else None
        if self.truncated and self.parts:
            # The index of the last chunk may be cut off between two channels: find its messages by walking.
            self.parts[-1].index.clear()

    def _index(self, part: Part, start: int, end: int) -> None:
        """Take in the index of one channel; without it, as when it is damaged, messages are found by walking."""
        if end - start >= 6:
            channel, length = struct.unpack_from("<HI", self._map, start)
            if length == end - start - 6 and length % 16 == 0:
                rows = np.frombuffer(self._map, "<i8", length // 8, start + 6)  # as it lies in the file
                part.index[channel] = rows.reshape(-1, 2)

    @property
    def notices(self) -> list[str]:
        """What the user should know of the file, one line each."""
        if self.truncated:
            return [f"{self.path}: the recording was cut off; what was written before that is read"]
        found = sum(self.counts.values())
        if self._told is not None and found != self._told:
            return [f"{self.path}: damaged: {found} of {self._told} messages are found"]
        return []

    def _count(self) -> dict[int, int]:
        counts: dict[int, int] = {}
        for part in self.parts:
            found = {channel: len(rows) for channel, rows in part.index.items()}
            if not found or not all(channel in self.channels for channel in found):
                # No index, or no summary: the channels are declared inside the chunks alone.
                part.index.clear()
                ids, numbers = np.unique(self.messages(part).channels(), return_counts=True)
                found = {int(channel): int(number) for channel, number in zip(ids, numbers, strict=True)}
            for channel, number in found.items():
                counts[channel] = counts.get(channel, 0) + number
        unknown = sorted(channel for channel in counts if channel not in self.channels)
        if unknown:
            raise RecordingError(f"{self.path}: messages of channel {unknown[0]}, which the file does not declare")
        return counts

    def _unpack(self, part: Part) -> bytes:
        _, _, size, crc, name_length = struct.unpack_from("<QQQII", self._map, part.start + 9)
        name_start = part.start + 9 + 32
        compression = self._map[name_start : name_start + name_length].decode(errors="replace")
        data = self._map[name_start + name_length + 8 : part.end]
        try:
            unpacked = decompress(compression, data, size)
        except ImportError as error:
            raise RecordingError(f"{self.path}: compressed with {compression}; pip install {error.name}") from error
        except (ValueError, RuntimeError) as error:
            raise self._damaged(part, str(error)) from error
        except Exception as error:  # zstandard and lz4 each have an error class of their own
            raise self._damaged(part, f"{compression} cannot unpack it") from error
        if len(unpacked) != size or (crc and zlib.crc32(unpacked) != crc):
            raise self._damaged(part, "its checksum does not match")
        return unpacked

    def _damaged(self, part: Part, why: str) -> RecordingError:
        return RecordingError(f"{self.path}: the chunk at byte {part.start} is damaged: {why}")

    def messages(self, part: Part) -> Messages:
        """Messages of a part, found by its index where that is complete, by walking where it is not."""
        if not part.chunked:
            records = self._walk(self._map, part.start, part.end)
            found = [s for opcode, s, end in records if opcode == Opcode.MESSAGE and end - s >= 9 + LEAST_MESSAGE]
            return Messages(self._bytes, np.array(found, np.int64))
        unpacked = self._unpack(part)
        buffer: Bytes = np.frombuffer(unpacked, np.uint8)
        heads = self._indexed(buffer, part)
        gaps = find_gaps(buffer, heads)
        if gaps is None:
            heads, gaps = np.empty(0, np.int64), [(0, len(buffer))]
        extra: list[int] = []
        for gap_start, gap_end in gaps:
            for opcode, start, end in self._walk(unpacked, gap_start, gap_end):
                if opcode == Opcode.MESSAGE and end - start >= 9 + LEAST_MESSAGE:
                    extra.append(start)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._record(opcode, unpacked[start + 9 : end])
        told = sum(map(len, part.index.values()))
        if len(heads) + len(extra) < told:
            raise self._damaged(part, f"{len(heads) + len(extra)} of its {told} messages are found")
        if extra:
            heads = np.sort(np.concatenate([heads, np.array(extra, np.int64)]))
        return Messages(buffer, heads)

    def _indexed(self, buffer: Bytes, part: Part) -> IntArray:
        if not part.index:
            return np.empty(0, np.int64)
        return np.sort(np.concatenate([rows[:, 1] for rows in part.index.values()]))

    def blocks(self, channels: set[int], progress: Callable[[int], object] | None = None) -> Iterator[MessageBlock]:
        """Messages of the given channels, part by part; parts that hold none of them are not unpacked."""
        for part in self.parts:
            if part.index and channels.isdisjoint(part.index):
                continue
            messages = self.messages(part)
            which = np.flatnonzero(np.isin(messages.channels(), list(channels)))
            if progress is not None:
                progress(len(which))
            if len(which):
                yield messages.block(which)
        self._let_go()

    def _let_go(self) -> None:
        """Give back the memory that holds what was read; the system's own copy of the file serves the next time."""
        if hasattr(self._map, "madvise"):
            self._map.madvise(mmap.MADV_DONTNEED)
