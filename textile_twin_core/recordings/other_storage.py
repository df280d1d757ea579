"""Bags in other storage than plain MCAP (SQLite, compressed files), read by the rosbags library."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from textile_twin_core.errors import RecordingError, how_to_install
from textile_twin_core.recordings.cdr_decode import MessageBlock
from textile_twin_core.recordings.rosbag2_metadata import OfferedQos, TopicInfo
from textile_twin_core.recordings.schemas import MessageSchema

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Reader

_OF_A_URI = frozenset("#?%")
_BLOCK = 20_000
"""Messages gathered before a block is handed on."""


class OtherFile:
    """A rosbag2 folder that only rosbags can read, behind the same face as McapFile."""

    truncated = False

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._open() as reader:
            self.topics = {connection.id: _topic(connection) for connection in reader.connections}
            filled = reader.message_count > 0
            self._span = (reader.start_time, reader.end_time - 1) if filled else None

    @property
    def notices(self) -> list[str]:
        """Nothing that rosbags would not have raised."""
        return []

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and last message; None without messages."""
        return self._span

    @contextmanager
    def _open(self) -> Iterator[Reader]:
        try:
            from rosbags.rosbag2 import Reader, ReaderError
        except ImportError as error:
            raise RecordingError(f"{self.path}: not plain MCAP; {how_to_install('rosbags')}") from error
        try:
            with Reader(self.path) as reader:
                yield reader
        except (ReaderError, OSError) as error:
            raise RecordingError(f"{self.path}: cannot be read: {error}{self._hint()}") from error
        except Exception as error:  # SQLite and zstd have error classes of their own; a spoilt size fits no memory
            raise RecordingError(f"{self.path}: damaged: {str(error) or type(error).__name__}") from error

    def _hint(self) -> str:
        """rosbags opens SQLite files by a URI, in which some characters mean something."""
        found = _OF_A_URI & set(str(self.path)) if any(self.path.glob("*.db3")) else ()
        return (
            f"; an SQLite recording is not found where its path has {' '.join(sorted(found))}: rename" if found else ""
        )

    def blocks(self, channels: set[int], progress: Callable[[int], object] | None = None) -> Iterator[MessageBlock]:
        """Messages of the given channels in blocks, in log-time order."""
        with self._open() as reader:
            wanted = [c for c in reader.connections if c.id in channels]
            times: list[int] = []
            data: list[bytes] = []
            for _, time, cdr in reader.messages(wanted) if wanted else ():
                times.append(time)
                data.append(bytes(cdr))
                if len(times) == _BLOCK:
                    if progress is not None:
                        progress(len(times))
                    yield _pack(times, data)
                    times, data = [], []
            if times:
                if progress is not None:
                    progress(len(times))
                yield _pack(times, data)


def _topic(connection: Connection) -> TopicInfo:
    offered = [
        {"reliability": qos.reliability.name.lower(), "durability": qos.durability.name.lower(), "depth": qos.depth}
        for qos in getattr(connection.ext, "offered_qos_profiles", ())
    ]
    encoding = {"MSG": "ros2msg", "IDL": "ros2idl"}.get(connection.msgdef.format.name)
    text = connection.msgdef.data
    schema = MessageSchema(text, connection.digest, encoding) if encoding and text else None
    return TopicInfo(connection.topic, connection.msgtype, connection.msgcount, OfferedQos.of(offered), schema)


def _pack(times: list[int], data: list[bytes]) -> MessageBlock:
    sizes = np.array([len(cdr) for cdr in data], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    return MessageBlock(np.frombuffer(b"".join(data), np.uint8), starts, sizes, np.array(times, np.int64))
