"""Messages of a recording, independent of its files: topics, counts, raw messages in blocks or by time."""

from __future__ import annotations

import heapq
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Protocol

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.cdr_decode import MessageBlock
from textile_twin_core.recordings.rosbag2_metadata import TopicInfo

Progress = Callable[[int], object]
"""Callback with the number of messages just read."""


class RecordedFile(Protocol):
    """Readable file of a recording."""

    path: Path
    truncated: bool

    @property
    def notices(self) -> list[str]:
        """Notices on the file for the user, one line each."""

    @property
    def topics(self) -> dict[int, TopicInfo]:
        """Topic of each channel."""

    def span_ns(self) -> tuple[int, int] | None:
        """Return the log times of the first and last message; None without messages."""

    def blocks(self, channels: set[int], progress: Progress | None = None) -> Iterator[MessageBlock]:
        """Iterate over the messages of the given channels in blocks."""


class Recording:
    """Topics and raw messages of one recording.

    Attributes:
        topics: Absolute name -> TopicInfo.
        start_ns, end_ns: Log times of the first and last message [ns].
        metadata: custom_data of the recording.
        truncated: True if the recording was cut off (kill, power loss).
        notices: Notices on the recording for the user, one line each.
    """

    def __init__(
        self, path: Path, files: Sequence[RecordedFile], metadata: dict[str, str], notices: Sequence[str] = ()
    ) -> None:
        self.path = path
        self.metadata = metadata
        self.truncated = any(file.truncated for file in files)
        self.notices = [*notices] + [notice for file in files for notice in file.notices]
        self._files = files
        self._channels: dict[str, list[set[int]]] = {}
        self.topics: dict[str, TopicInfo] = {}
        spans = [span for file in files if (span := file.span_ns()) is not None]
        for number, file in enumerate(files):
            for channel, topic in file.topics.items():
                name = "/" + topic.name.strip("/")
                before = self.topics.get(name)
                if before is not None and before.msgtype != topic.msgtype:
                    types = f"{before.msgtype} and {topic.msgtype}"
                    raise RecordingError(f"{path}: topic {name} carries two types, {types}; split the recording")
                count = topic.count + (before.count if before else 0)
                self.topics[name] = replace(topic, name=name, count=count)
                self._channels.setdefault(name, [set() for _ in files])[number].add(channel)
        self.start_ns = min((first for first, _ in spans), default=0)
        self.end_ns = max((last for _, last in spans), default=0)

    @property
    def message_count(self) -> int:
        """Number of messages of all topics."""
        return sum(topic.count for topic in self.topics.values())

    def find_topic(self, name: str) -> TopicInfo:
        """Find the topic of that name, with or without leading slash, or the only topic with this ending.

        Raises:
            RecordingError: No topic or several topics match; the text lists the topics.
        """
        absolute = "/" + name.strip("/")
        if absolute in self.topics:
            return self.topics[absolute]
        matches = [topic for topic in self.topics.values() if topic.name.endswith(absolute)]
        if len(matches) == 1:
            return matches[0]
        if matches:
            names = ", ".join(sorted(topic.name for topic in matches))
            raise RecordingError(f"{self.path}: topic {name} is there more than once: {names}; name one in full")
        there = ", ".join(f"{t.name} ({t.msgtype}, {t.count})" for _, t in sorted(self.topics.items()))
        raise RecordingError(f"{self.path}: no topic {absolute}; topics there: {there or 'none'}")

    def has_topic(self, name: str) -> bool:
        """Return true if find_topic gives a topic with messages."""
        try:
            return self.find_topic(name).count > 0
        except RecordingError:
            return False

    def blocks(self, topic: str, progress: Progress | None = None) -> Iterator[MessageBlock]:
        """Iterate over the messages of one topic in blocks of raw bytes, file by file."""
        found = self.find_topic(topic)
        for file, channels in zip(self._files, self._channels[found.name], strict=True):
            if channels:
                yield from file.blocks(channels, progress)

    def raw_messages(self, topics: list[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """Iterate over all messages as (topic, log time [ns], CDR bytes), by log time, with one block per topic
        in memory.
        """
        for name, log_time_ns, _, cdr in self.timed_messages(topics):
            yield name, log_time_ns, cdr

    def timed_messages(self, topics: list[str] | None = None) -> Iterator[tuple[str, int, int, bytes]]:
        """Iterate like `raw_messages` over (topic, log time [ns], publish time [ns], CDR bytes)."""
        names = list(self.topics) if topics is None else [self.find_topic(topic).name for topic in topics]
        yield from heapq.merge(*(self._one_topic(name) for name in names), key=itemgetter(1))

    def _one_topic(self, name: str) -> Iterator[tuple[str, int, int, bytes]]:
        # Blocks may overlap in time: messages later than the start of the next block wait for it.
        waiting: list[tuple[str, int, int, bytes]] = []
        for block in self.blocks(name):
            ready = bisect_left(waiting, int(block.log_times_ns.min()), key=itemgetter(1))
            yield from waiting[:ready]
            times = zip(block.log_times_ns.tolist(), block.published_ns.tolist(), strict=True)
            fresh = [(name, logged, published, block.message(i)) for i, (logged, published) in enumerate(times)]
            waiting = sorted(waiting[ready:] + fresh, key=itemgetter(1))
        yield from waiting
