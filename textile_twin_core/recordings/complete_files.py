"""The complete files of a recording: what is in them, and which goes first."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from textile_twin_core.recordings.rosbag2_metadata import FileInfo, total


class CompleteFiles:
    """Those of one recording, the oldest first."""

    def __init__(self) -> None:
        self.files: list[FileInfo] = []
        self._bytes: list[int] = []

    def append(self, file: FileInfo, size: int) -> None:
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
        return total(self.files)

    def drop_oldest(self, folder: Path, before_ns: int | None = None) -> bool:
        """Remove the oldest from its folder; False when there is none, or its last message is not before this time."""
        if not self.files:
            return False
        span_ns = self.files[0].span_ns
        if before_ns is not None and span_ns is not None and span_ns[1] >= before_ns:
            return False
        self._bytes.pop(0)
        (folder / self.files.pop(0).name).unlink(missing_ok=True)
        return True
