"""MCAP files into blocks of messages, also those that are cut off or damaged."""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel

from textile_twin_core.arrays import IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.cdr_decode import Bytes, MessageBlock
from textile_twin_core.recordings.mcap_contents import MAGIC, Contents, walk
from textile_twin_core.recordings.mcap_parts import LEAST_MESSAGE, Messages, Part, decompress, find_gaps, what_it_is
from textile_twin_core.recordings.rosbag2_metadata import OfferedQos, TopicInfo
from textile_twin_core.recordings.schemas import MessageSchema


class McapFile:
    """One MCAP file, opened: its channels, its message counts and its messages in blocks.

    `truncated` is set when the file ends without a footer, as after a kill; what is whole is read.
    Raises RecordingError for a file that is no MCAP file or is damaged in the middle.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as file:
                head = file.read(len(MAGIC))
                if head != MAGIC:
                    raise RecordingError(f"{path}: {what_it_is(head)}; give a rosbag2 folder or an .mcap file")
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
        self._bytes: Bytes = np.frombuffer(self._map, np.uint8)
        self._contents = Contents(self._map)
        self.truncated, self.metadata = self._contents.truncated, self._contents.metadata
        self.counts = self._count()
        self._let_go()

    @property
    def topics(self) -> dict[int, TopicInfo]:
        """The topic of each channel."""
        return {number: self._topic(channel) for number, channel in self._contents.channels.items()}

    def _topic(self, channel: Channel) -> TopicInfo:
        schema = self._contents.schemas.get(channel.schema_id)
        text = None
        if schema is not None:
            type_hash = channel.metadata.get("topic_type_hash", "")
            text = MessageSchema(schema.data.decode(errors="replace"), type_hash, schema.encoding)
        qos = OfferedQos.of(channel.metadata.get("offered_qos_profiles", ""))
        return TopicInfo(channel.topic, schema.name if schema else "", self.counts.get(channel.id, 0), qos, text)

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and last message; None without messages."""
        filled = [part for part in self._contents.parts if part.last_ns]
        if not filled:
            return None
        return min(part.first_ns for part in filled), max(part.last_ns for part in filled)

    @property
    def notices(self) -> list[str]:
        """What the user should know of the file, one line each."""
        if self.truncated:
            return [f"{self.path}: the recording was cut off; what was written before that is read"]
        found = sum(self.counts.values())
        if self._contents.told is not None and found != self._contents.told:
            return [f"{self.path}: damaged: {found} of {self._contents.told} messages are found"]
        return []

    def _count(self) -> dict[int, int]:
        counts: dict[int, int] = {}
        for part in self._contents.parts:
            found = {channel: len(rows) for channel, rows in part.index.items()}
            if not found or not all(channel in self._contents.channels for channel in found):
                # No index, or no summary: the channels are declared inside the chunks alone.
                part.index.clear()
                ids, numbers = np.unique(self.messages(part).channels(), return_counts=True)
                found = {int(channel): int(number) for channel, number in zip(ids, numbers, strict=True)}
            for channel, number in found.items():
                counts[channel] = counts.get(channel, 0) + number
        unknown = sorted(channel for channel in counts if channel not in self._contents.channels)
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
            records = walk(self._map, part.start, part.end)
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
            for opcode, start, end in walk(unpacked, gap_start, gap_end):
                if opcode == Opcode.MESSAGE and end - start >= 9 + LEAST_MESSAGE:
                    extra.append(start)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._contents.describe(opcode, unpacked[start + 9 : end])
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
        for part in self._contents.parts:
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
