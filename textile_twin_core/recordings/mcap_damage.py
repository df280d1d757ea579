"""Description of the damage in an MCAP file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from textile_twin_core.recordings.mcap_parts import Part


class Damage:
    """Collection of the skipped parts of a file.

    Args:
        lost: Ranges, start and end, in which no record is found.
    """

    def __init__(self, lost: Sequence[tuple[int, int]]) -> None:
        self._lost = lost
        self._chunks: list[Part] = []
        self._why = ""
        self.undeclared = 0
        """Number of messages of undeclared channels."""

    def add(self, chunk: Part, why: str) -> None:
        """Add a chunk with its stated time span; only the first reason is reported, as the others rarely differ."""
        self._chunks.append(replace(chunk))
        self._why = self._why or why

    def words(self, found: int, stated: int | None, span_ns: tuple[int, int] | None) -> str:
        """Describe the missing data in one line; empty if nothing is missing.

        Args:
            found: Number of readable messages.
            stated: Number of messages by the summary of the file; None without one.
            span_ns: Log times of the first and last readable message; None without one.
        """
        words = []
        if self._chunks:
            n, size = len(self._chunks), sum(chunk.end - chunk.start for chunk in self._chunks)
            chunks = "a chunk" if n == 1 else f"{n} chunks"
            at = f"at byte {self._chunks[0].start}" + (" and after it" if n > 1 else "")
            words.append(f"{chunks} {at} ({size} bytes{self._span(span_ns)}): {self._why}")
        if self._lost:
            size = sum(end - start for start, end in self._lost)
            words.append(f"{size} bytes from byte {self._lost[0][0]} on are no records")
        if self.undeclared:
            words.append(f"{self.undeclared} messages are of channels that it does not declare")
        if stated is not None and found != stated:
            words.append(f"{found} of {stated} messages are found")
        elif words:
            words.append(f"{found} messages are found")
        return "; ".join(words)

    def _span(self, span_ns: tuple[int, int] | None) -> str:
        """Describe the time span of the chunks; empty if their stated times are damaged, too."""
        if span_ns is None:
            return ""
        first, last = min(chunk.first_ns for chunk in self._chunks), max(chunk.last_ns for chunk in self._chunks)
        length = span_ns[1] - span_ns[0] + 1
        if not span_ns[0] - length <= first <= last <= span_ns[1] + length:
            return ""
        begin, end = (first - span_ns[0]) * 1e-9, (last - span_ns[0]) * 1e-9
        return f", {begin:.3f} s to {end:.3f} s after the first message"
