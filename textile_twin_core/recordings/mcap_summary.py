"""Summary of an MCAP file being written: declarations and chunk positions, repeated at its end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import mcap.records as records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

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
