"""Bulk writer of MCAP files: chunks of messages, and the records around them by the mcap library."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import mcap.records as records
import zstandard

from textile_twin_core.arrays import IntArray
from textile_twin_core.recordings.cdr_decode import Bytes
from textile_twin_core.recordings.mcap_chunk import MESSAGE_HEAD_BYTES, PendingChunk
from textile_twin_core.recordings.mcap_parts import MAGIC
from textile_twin_core.recordings.mcap_summary import Summary, bytes_of
from textile_twin_core.recordings.schemas import MessageSchema

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
