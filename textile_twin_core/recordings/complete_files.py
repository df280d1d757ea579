"""Complete files of a recording that is being written."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from textile_twin_core.recordings.rosbag2_metadata import FileInfo, total


class CompleteFiles:
    """List of the complete files, the oldest first."""

    def __init__(self) -> None:
        self.files: list[FileInfo] = []
        self._bytes: list[int] = []

    def append(self, file: FileInfo, size: int) -> None:
        """Add the newest file and its size in bytes."""
        self.files.append(file)
        self._bytes.append(size)

    @property
    def bytes(self) -> int:
        """Total size in bytes."""
        return sum(self._bytes)

    @property
    def counts(self) -> Counter[str]:
        """Total number of messages by topic."""
        return total(self.files)

    def drop_oldest(self, folder: Path, before_ns: int | None = None) -> bool:
        """Remove the oldest file from its folder; return false without files."""
        if not self.files:
            return False
        span_ns = self.files[0].span_ns
        if before_ns is not None and span_ns is not None and span_ns[1] >= before_ns:
            return False
        self._bytes.pop(0)
        (folder / self.files.pop(0).name).unlink(missing_ok=True)
        return True
