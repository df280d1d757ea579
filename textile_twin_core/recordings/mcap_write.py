"""Bulk writer of MCAP files: chunks of messages with their index, and the summary at the end."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import mcap.records as records
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from textile_twin_core.arrays import IntArray
from textile_twin_core.recordings.cdr_decode import Bytes
from textile_twin_core.recordings.mcap_parts import MAGIC
from textile_twin_core.recordings.schemas import MessageSchema


class Summary:
    """Collection of the records of the summary."""

    def __init__(self) -> None:
        self.schemas: dict[str, records.Schema] = {}
        self.metadata: list[records.MetadataIndex] = []
        self._channels: list[records.Channel] = []
        self._chunk_count = 0
        self._chunk_indices = bytearray()
        """Encoded index records of all chunks; compact, since long recordings have many chunks."""

    def add_schema(self, msgtype: str, definition: MessageSchema) -> records.Schema:
        """Declare a type and return its record."""
        schema = records.Schema(
            id=len(self.schemas) + 1, name=msgtype, encoding=definition.encoding, data=definition.text.encode()
        )
        self.schemas[msgtype] = schema
        return schema

    def add_channel(self, topic: str, schema: records.Schema, metadata: dict[str, str]) -> records.Channel:
        """Declare a topic and return its record."""
        channel = records.Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding="cdr",
            metadata=metadata,
            schema_id=schema.id,
        )
        self._channels.append(channel)
        return channel

    def add_chunk(self, index: records.ChunkIndex) -> None:
        """Add the index record of a chunk."""
        self._chunk_count += 1
        self._chunk_indices += bytes_of(index)

    def groups(self, counts: Mapping[int, int], span_ns: tuple[int, int] | None) -> Iterator[tuple[Opcode, bytes]]:
        """Iterate over the non-empty groups of summary records, by kind.

        Args:
            counts: Number of messages of each channel.
            span_ns: First and last log time; None without messages.
        """
        first, last = span_ns or (0, 0)
        statistics = records.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(counts),
            chunk_count=self._chunk_count,
            message_count=sum(counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )
        groups: dict[Opcode, bytes] = {
            Opcode.SCHEMA: b"".join(map(bytes_of, self.schemas.values())),
            Opcode.CHANNEL: b"".join(map(bytes_of, self._channels)),
            Opcode.STATISTICS: bytes_of(statistics),
            Opcode.CHUNK_INDEX: bytes(self._chunk_indices),
            Opcode.METADATA_INDEX: b"".join(map(bytes_of, self.metadata)),
        }
        yield from ((opcode, group) for opcode, group in groups.items() if group)


def bytes_of(record: records.McapRecord) -> bytes:
    """Encode a record."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


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


_CHUNK_BYTES = 1 << 20


class McapFileWriter:
    """Writer of one MCAP file of profile ros2, compressed with zstd in chunks of about a megabyte, indexed.

    Schemas and channels are declared outside the chunks and again in the summary.

    Args:
        path: The file.
        named: Path in error messages, if the file is renamed later.

    Raises:
        OSError: The disk is full; the error has the name `named`.
    """

    def __init__(self, path: Path, named: Path | None = None) -> None:
        self.path, self._named = path, named or path
        self.bytes_written = 0
        self._file = path.open("xb")
        self._summary = Summary()
        self.counts: dict[int, int] = {}
        self._compressor = zstandard.ZstdCompressor()
        self._chunk = PendingChunk()
        self.span_ns: tuple[int, int] | None = None
        self._put(MAGIC)
        self._emit(records.Header(profile="ros2", library="textile-twin"))

    def _emit(self, record: records.McapRecord) -> tuple[int, int]:
        """Write a record to the file; return its position and length."""
        data = bytes_of(record)
        start = self._file.tell()
        self._put(data)
        return start, len(data)

    def _put(self, data: bytes | bytearray) -> None:
        with self._naming():
            self._file.write(data)
        self.bytes_written += len(data)

    @contextmanager
    def _naming(self) -> Iterator[None]:
        """Add the name of the file to an error of the system."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._named)) from error

    def add_channel(self, topic: str, msgtype: str, definition: MessageSchema, metadata: dict[str, str]) -> int:
        """Declare a topic; return its channel number."""
        self._end_chunk()
        schema = self._summary.schemas.get(msgtype)
        if schema is None:
            schema = self._summary.add_schema(msgtype, definition)
            self._emit(schema)
        channel = self._summary.add_channel(topic, schema, metadata)
        self.counts[channel.id] = 0
        self._emit(channel)
        return channel.id

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, cdr: bytes) -> None:
        """Append one message."""
        self._chunk.add(channel, self.counts[channel], log_time_ns, publish_time_ns, cdr)
        self.counts[channel] += 1
        if len(self._chunk.data) >= _CHUNK_BYTES:
            self._end_chunk()

    def write_rows(self, channel: int, log_times_ns: IntArray, publish_times_ns: IntArray, rows: Bytes) -> None:
        """Append messages of equal length: times (n,), CDR bytes (n, size)."""
        at_once = max(1, _CHUNK_BYTES // (MESSAGE_HEAD_BYTES + rows.shape[1]))
        for start in range(0, len(rows), at_once):
            part = slice(start, start + at_once)
            cdr = rows[part]
            self._chunk.add_rows(channel, self.counts[channel], log_times_ns[part], publish_times_ns[part], cdr)
            self.counts[channel] += len(cdr)
            if len(self._chunk.data) >= _CHUNK_BYTES // 2:
                self._end_chunk()

    def _end_chunk(self) -> None:
        """Write the pending messages as one chunk with its index."""
        chunk = self._chunk
        if chunk.span_ns is None:
            return
        data = bytes(chunk.data)
        packed = self._compressor.compress(data)
        first, last = chunk.span_ns
        start, length = self._emit(
            records.Chunk(
                message_start_time=first,
                message_end_time=last,
                uncompressed_size=len(data),
                uncompressed_crc=zlib.crc32(data),
                compression="zstd",
                data=packed,
            )
        )
        index_start = self._file.tell()
        offsets: dict[int, int] = {}
        for channel, index in chunk.indices():
            offsets[channel] = self._file.tell()
            self._put(index)
        chunk_index = records.ChunkIndex(
            message_start_time=first,
            message_end_time=last,
            chunk_start_offset=start,
            chunk_length=length,
            message_index_offsets=offsets,
            message_index_length=self._file.tell() - index_start,
            compression="zstd",
            compressed_size=len(packed),
            uncompressed_size=len(data),
        )
        self._summary.add_chunk(chunk_index)
        whole = self.span_ns or chunk.span_ns
        self.span_ns = (min(first, whole[0]), max(last, whole[1]))
        self._chunk = PendingChunk()

    @property
    def is_removed(self) -> bool:
        """True if the file was removed, so that further data would be lost."""
        return os.fstat(self._file.fileno()).st_nlink == 0

    def flush(self) -> None:
        """Sync everything written so far to disk, safe from a kill or a power loss."""
        self._end_chunk()
        self._sync()

    def _sync(self) -> None:
        with self._naming():
            self._file.flush()
            os.fdatasync(self._file.fileno())

    def add_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write a metadata record."""
        self._end_chunk()
        start, length = self._emit(records.Metadata(name=name, metadata=entries))
        self._summary.metadata.append(records.MetadataIndex(offset=start, length=length, name=name))

    def close(self) -> None:
        """Write the summary and the footer."""
        self._end_chunk()
        self._emit(records.DataEnd(data_section_crc=0))
        summary_start = self._file.tell()
        offsets = []
        for opcode, group in self._summary.groups(self.counts, self.span_ns):
            start = self._file.tell()
            offsets.append(records.SummaryOffset(group_opcode=opcode, group_start=start, group_length=len(group)))
            self._put(group)
        offset_start = self._file.tell()
        for offset in offsets:
            self._emit(offset)
        self._emit(records.Footer(summary_start=summary_start, summary_offset_start=offset_start, summary_crc=0))
        self._put(MAGIC)
        self._sync()
        self._file.close()

    def abandon(self) -> None:
        """Close the file as it is."""
        with suppress(OSError):  # the buffered data may not fit on the disk
            self._file.close()
