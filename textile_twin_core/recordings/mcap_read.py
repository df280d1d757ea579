"""Reader of MCAP files into blocks of messages, also of truncated or damaged files."""

from __future__ import annotations

import mmap
import shlex
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel

from textile_twin_core.arrays import IntArray
from textile_twin_core.errors import RecordingError, how_to_install
from textile_twin_core.recordings.cdr_decode import Bytes, MessageBlock
from textile_twin_core.recordings.mcap_parts import (
    LEAST_MESSAGE,
    LOG_SUFFIXES,
    MAGIC,
    Contents,
    Damage,
    DamageError,
    Messages,
    Part,
    decompress,
    find_gaps,
    find_whole,
    walk,
    what_it_is,
)
from textile_twin_core.recordings.rosbag2_metadata import OfferedQos, TopicInfo
from textile_twin_core.recordings.schemas import MessageSchema
from textile_twin_core.recordings.zstd_storage import opened, plain_messages


class McapFile:
    """Opened MCAP file: its channels, message counts, and messages in blocks.

    `truncated` is true if the file ends without a footer, as after a kill; the intact part is read.

    Args:
        path: The file.
        recording: Recording that the file belongs to; None for a single file.
        salvage: Decompress everything at once and skip damaged parts, which `notices` then lists.

    Raises:
        RecordingError: The file is not MCAP or, unless salvaged, a chunk is damaged (here or when it is reached).
    """

    def __init__(self, path: Path, recording: Path | None = None, salvage: bool = False) -> None:
        self.path, self._recording = path, recording or path
        try:
            file, head = opened(path)
            with file:
                head = head[: len(MAGIC)]
                other = "give a rosbag2 folder or an .mcap file" if path == self._recording else self._advice
                if path.suffix.lower() in LOG_SUFFIXES:
                    other = (
                        f"make a recording of a logger's table: textile-twin import {shlex.quote(str(path))} --out DIR"
                    )
                no_bag = DamageError(f"{path}: {what_it_is(head)}; {other}")
                if head != MAGIC and not (salvage and head):
                    raise no_bag
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
        self._bytes: Bytes = np.frombuffer(self._map, np.uint8)
        self._contents = Contents(self._map)
        self.truncated, self.metadata = self._contents.truncated, self._contents.metadata
        self._damage = Damage(self._contents.lost)
        if head != MAGIC and not self._contents.parts:
            raise no_bag
        if salvage:
            self._salvage()
        self.counts = self._count(salvage)
        self._release_memory()

    @property
    def topics(self) -> dict[int, TopicInfo]:
        """Topic of each channel."""
        return {number: self._topic(channel) for number, channel in self._contents.channels.items()}

    def _topic(self, channel: Channel) -> TopicInfo:
        schema = self._contents.schemas.get(channel.schema_id)
        text = None
        if schema is not None:
            type_hash = channel.metadata.get("topic_type_hash", "")
            text = MessageSchema(schema.data.decode(errors="replace"), type_hash, schema.encoding)
        qos = OfferedQos.of(channel.metadata.get("offered_qos_profiles", ""))
        return TopicInfo(
            channel.topic,
            schema.name if schema else "",
            self.counts.get(channel.id, 0),
            qos,
            text,
            channel.message_encoding,
        )

    def span_ns(self) -> tuple[int, int] | None:
        """Return the log times of the first and last message; None without messages."""
        filled = [part for part in self._contents.parts if part.last_ns]
        if not filled:
            return None
        return min(part.first_ns for part in filled), max(part.last_ns for part in filled)

    @property
    def notices(self) -> list[str]:
        """Notices on the file for the user, one line each."""
        lines = []
        if self.truncated:
            lines.append(f"{self.path}: the recording was cut off; what was written before that is read")
        damage = self._damage.words(sum(self.counts.values()), self._contents.stated_count, self.span_ns())
        if damage:
            lines.append(f"{self.path}: damaged: {damage}")
        return lines

    def _count(self, salvage: bool) -> dict[int, int]:
        counts: dict[int, int] = {}
        for part in self._contents.parts:
            found = {channel: len(rows) for channel, rows in part.index.items()}
            if not found or not all(channel in self._contents.channels for channel in found):
                # Without index or summary, channels are declared inside the chunks only.
                part.index.clear()
                found = self.messages(part).counts()
            for channel, number in found.items():
                counts[channel] = counts.get(channel, 0) + number
        unknown = sorted(channel for channel in counts if channel not in self._contents.channels)
        if unknown and not salvage:
            raise RecordingError(
                f"{self.path}: messages of channel {unknown[0]}, which the file does not declare; {self._advice}"
            )
        self._damage.undeclared = sum(counts.pop(channel) for channel in unknown)
        return counts

    def _salvage(self) -> None:
        """Decompress every part, skip damaged data, and discard indices and time spans that do not fit."""
        parts = self._contents.parts
        for part in tuple(parts):
            try:
                messages = self.messages(part)
            except DamageError as error:
                part.heads = self._whole_heads(part)
                messages = Messages(self._bytes, part.heads) if not len(part.heads) else self.messages(part)
                self._damage.add(part, error.why)
            found = messages.counts()
            if found != {channel: len(rows) for channel, rows in part.index.items()}:
                part.index.clear()
            if not found:
                parts.remove(part)
                continue
            part.first_ns, part.last_ns = messages.span_ns()
            self._release_memory()

    def _whole_heads(self, part: Part) -> IntArray:
        """Find the intact messages of a damaged chunk that has no checksum.

        Without an index these are the messages before the damage, except the last one, whose length may be wrong.
        """
        try:
            unpacked, _ = self._unpack(part)
        except DamageError:
            return np.empty(0, np.int64)
        if part.index:
            return find_whole(np.frombuffer(unpacked, np.uint8), part)
        heads = [(s, opcode, end - s) for opcode, s, end in walk(unpacked, 0, len(unpacked))][:-1]
        whole = [s for s, opcode, size in heads if opcode == Opcode.MESSAGE and size >= 9 + LEAST_MESSAGE]
        return np.array(whole, np.int64)

    def _unpack(self, part: Part) -> tuple[bytes, bool]:
        """Return the records of a chunk, and whether a checksum confirms them."""
        _, _, size, crc, name_length = struct.unpack_from("<QQQII", self._map, part.start + 9)
        name_start = part.start + 9 + 32
        compression = self._map[name_start : name_start + name_length].decode(errors="replace")
        data = self._map[name_start + name_length + 8 : part.end]
        try:
            unpacked = decompress(compression, data, size)
        except ImportError as error:
            raise RecordingError(
                f"{self.path}: compressed with {compression}; {how_to_install(error.name or compression)}"
            ) from error
        except (ValueError, RuntimeError) as error:
            raise self._damaged(part, str(error)) from error
        except Exception as error:  # zstandard and lz4 have different error classes
            raise self._damaged(part, f"{compression} cannot unpack it") from error
        if len(unpacked) != size or (crc and zlib.crc32(unpacked) != crc):
            raise self._damaged(part, "its checksum does not match")
        return unpacked, crc != 0

    def _damaged(self, part: Part, why: str) -> DamageError:
        where = f"{self.path}: the chunk at byte {part.start} is damaged"
        return DamageError(f"{where}: {why}; {self._advice}", why)

    @property
    def _advice(self) -> str:
        return f"textile-twin recover {shlex.quote(str(self._recording))} --out DIR recovers the intact part"

    def messages(self, part: Part) -> Messages:
        """Find the messages of a part by its index if complete, otherwise record by record."""
        if not part.chunked:
            records = walk(self._map, part.start, part.end)
            found = [s for opcode, s, end in records if opcode == Opcode.MESSAGE and end - s >= 9 + LEAST_MESSAGE]
            return Messages(self._bytes, np.array(found, np.int64))
        unpacked, checked = self._unpack(part)
        buffer: Bytes = np.frombuffer(unpacked, np.uint8)
        if part.heads is not None:
            return Messages(buffer, part.heads)
        heads = self._indexed(buffer, part)
        gaps = find_gaps(buffer, heads)
        if gaps is None:
            heads, gaps = np.empty(0, np.int64), [(0, len(buffer))]
        extra: list[int] = []
        complete = True
        for gap_start, gap_end in gaps:
            reached = gap_start
            for opcode, start, end in walk(unpacked, gap_start, gap_end):
                if opcode == Opcode.MESSAGE and end - start >= 9 + LEAST_MESSAGE:
                    extra.append(start)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._contents.describe(opcode, unpacked[start + 9 : end])
                reached = end
            complete &= reached == gap_end
        if not checked and len(heads) + len(extra) < part.indexed_count:
            raise self._damaged(part, f"{len(heads) + len(extra)} of its {part.indexed_count} messages are found")
        if not checked and not complete:
            raise self._damaged(part, "its records do not fill it")
        if extra:
            heads = np.sort(np.concatenate([heads, np.array(extra, np.int64)]))
        return Messages(buffer, heads)

    def _indexed(self, buffer: Bytes, part: Part) -> IntArray:
        if not part.index:
            return np.empty(0, np.int64)
        return np.sort(np.concatenate([rows[:, 1] for rows in part.index.values()]))

    def blocks(self, channels: set[int], progress: Callable[[int], object] | None = None) -> Iterator[MessageBlock]:
        """Iterate over the messages of the given channels, part by part; parts without them are not decompressed."""
        for part in self._contents.parts:
            if part.index and channels.isdisjoint(part.index):
                continue
            messages = self.messages(part)
            which = np.flatnonzero(np.isin(messages.channels(), list(channels)))
            if progress is not None:
                progress(len(which))
            if len(which):
                yield plain_messages(messages.block(which), self.path)
        self._release_memory()

    def _release_memory(self) -> None:
        """Release the memory of the mapped file; the page cache of the system serves the next access."""
        if hasattr(self._map, "madvise"):
            self._map.madvise(mmap.MADV_DONTNEED)
