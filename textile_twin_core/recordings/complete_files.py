"""The complete files of a recording: what is in them, which goes first, and what metadata.yaml says of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from textile_twin_core.recordings import rosbag2_metadata
from textile_twin_core.recordings.rosbag2_metadata import FileInfo, TopicInfo


@dataclass(frozen=True)
class CompleteFile:
    """One file: its name, its first and last log time [ns], None without messages, and its messages by topic."""

    name: str
    span_ns: tuple[int, int] | None
    counts: dict[str, int]


class CompleteFiles:
    """Those of one recording, the oldest first."""

    def __init__(self) -> None:
        self.files: list[CompleteFile] = []
        self._bytes: list[int] = []

    def append(self, file: CompleteFile, size: int) -> None:
        """Add the newest, of this many bytes."""
        self.files.append(file)
        self._bytes.append(size)

    @property
    def bytes(self) -> int:
        """Bytes of all of them."""
        return sum(self._bytes)

    @property
    def counts(self) -> Counter[str]:
        """Their messages by topic."""
        return _total(self.files)

    def drop_oldest(self, folder: Path) -> bool:
        """Remove the oldest from its folder; False when there is none."""
        if not self.files:
            return False
        self._bytes.pop(0)
        (folder / self.files.pop(0).name).unlink(missing_ok=True)
        return True


def information(
    files: Iterable[CompleteFile], topics: Mapping[str, TopicInfo], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """The rosbag2 information of files."""
    files = list(files)
    totals = _total(files)
    infos = [FileInfo(file.name, file.span_ns, sum(file.counts.values())) for file in files]
    counted = [replace(topic, count=totals[name]) for name, topic in topics.items()]
    return rosbag2_metadata.information(infos, counted, dict(custom_data))


def _total(files: Iterable[CompleteFile]) -> Counter[str]:
    total: Counter[str] = Counter()
    for file in files:
        total.update(file.counts)
    return total
