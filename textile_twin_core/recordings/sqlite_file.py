"""Reader of SQLite files of rosbag2 (.db3) into blocks of messages, with or without the metadata of the folder."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.cdr_decode import MessageBlock
from textile_twin_core.recordings.rosbag2_metadata import OfferedQos, TopicInfo
from textile_twin_core.recordings.schemas import MessageSchema
from textile_twin_core.recordings.zstd_storage import packed, plain_messages

SQLITE_MAGIC = b"SQLite format 3\0"
_BLOCK = 20_000
"""Number of messages per block."""


class SqliteFile:
    """Opened .db3 file: its topics and its messages in blocks, with the interface of McapFile.

    Args:
        path: The file.
        content: Decompressed content, if the file itself is compressed.

    Raises:
        RecordingError: The file is damaged or not a recording (here or when the damage is reached).
    """

    truncated = False

    def __init__(self, path: Path, content: BinaryIO | None = None) -> None:
        self.path, self._place = path, path
        if content is not None:
            # SQLite opens files only by name.
            self._temporary = tempfile.NamedTemporaryFile(suffix=".db3")  # noqa: SIM115
            shutil.copyfileobj(content, self._temporary)
            self._temporary.flush()
            self._place = Path(self._temporary.name)
        with self._open() as database:
            self.topics = _topics(database)
            first, last = database.execute("SELECT MIN(timestamp), MAX(timestamp) FROM messages").fetchone()
        self._span = None if first is None else (int(first), int(last))

    @property
    def notices(self) -> list[str]:
        """Notices: none, since damage raises an error."""
        return []

    def span_ns(self) -> tuple[int, int] | None:
        """Return the log times of the first and last message; None without messages."""
        return self._span

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        try:
            with closing(sqlite3.connect(f"file:{quote(str(self._place.resolve()))}?mode=ro", uri=True)) as database:
                yield database
        except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
            raise RecordingError(f"{self.path}: damaged, or no SQLite file of rosbag2: {error}") from error

    def blocks(self, channels: set[int], progress: Callable[[int], object] | None = None) -> Iterator[MessageBlock]:
        """Iterate over the messages of the given channels in blocks, in log-time order."""
        chosen = ",".join(map(str, sorted(channels)))
        query = f"SELECT timestamp, data FROM messages WHERE topic_id IN ({chosen}) ORDER BY timestamp"
        with self._open() as database:
            rows = database.execute(query)
            while some := rows.fetchmany(_BLOCK):
                if progress is not None:
                    progress(len(some))
                block = packed([int(time) for time, _ in some], [bytes(data) for _, data in some])
                yield plain_messages(block, self.path)


def _topics(database: sqlite3.Connection) -> dict[int, TopicInfo]:
    """Return the topic of each channel; older files have fewer columns, and no definitions."""
    counts = dict(database.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id").fetchall())
    schemas = _schemas(database)
    columns = [name for _, name, *_ in database.execute("PRAGMA table_info(topics)")]
    topics = {}
    for row in database.execute("SELECT * FROM topics").fetchall():
        entry = dict(zip(columns, row, strict=True))
        name, kind = str(entry["name"]), str(entry["type"])
        qos = OfferedQos.of(str(entry.get("offered_qos_profiles") or ""))
        encoding = str(entry.get("serialization_format") or "cdr")
        number = int(entry["id"])
        topics[number] = TopicInfo(name, kind, int(counts.get(number, 0)), qos, schemas.get(kind), encoding)
    return topics


def _schemas(database: sqlite3.Connection) -> dict[str, MessageSchema]:
    table = database.execute("SELECT name FROM sqlite_master WHERE name = 'message_definitions'").fetchone()
    if table is None:
        return {}
    rows = database.execute(
        "SELECT topic_type, encoding, encoded_message_definition, type_description_hash FROM message_definitions"
    )
    return {kind: MessageSchema(text, digest or "", encoding) for kind, encoding, text, digest in rows if text}
