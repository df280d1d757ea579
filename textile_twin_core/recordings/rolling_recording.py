"""Rolling recording: the last seconds of all topics on the disk, from which a recording of any part is cut."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from textile_twin_core.errors import RecordingError
from textile_twin_core.files import remove
from textile_twin_core.recordings.bag import Bag, open_bag
from textile_twin_core.recordings.bag_write import BagWriter

_FILE_S = 5.0


class RollingRecording:
    """A live recording in files of five seconds whose old files are removed.

    It lies on the disk and not in memory: a process that is killed loses only unflushed data, and the next process
    finds the others.

    Args:
        folder: place of one recording for each run of the process.

    Raises:
        OSError, OutputError: nothing can be written there.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.writer = BagWriter(folder / f"run_{time.time_ns()}", live=True, split_s=_FILE_S)

    def close(self) -> None:
        """Complete this run's recording.

        Raises:
            OutputError: the disk is full.
        """
        with self.writer:
            pass

    def abandon(self) -> None:
        """Leave this run's recording as it is on the disk, for a full disk."""
        with suppress(Exception):
            self.close()

    def drop_before(self, time_ns: int) -> None:
        """Remove files whose messages are all before this log time; those of earlier runs by their last change."""
        while self.writer.drop_oldest_file(time_ns):
            pass
        for run in self._runs():
            with suppress(OSError):
                if run != self.writer.path and run.stat().st_mtime_ns < time_ns and _last_change(run) < time_ns:
                    remove(run)

    def cut(
        self,
        begin_ns: int,
        end_ns: int,
        path: Path,
        first: Iterable[tuple[str, bytes]] = (),
        custom_data: Mapping[str, str] | None = None,
    ) -> int:
        """Write the messages of all runs between two log times as a recording; return the number of messages.

        The recording appears whole or not at all; one without a message is not written.

        Args:
            begin_ns, end_ns: log times.
            path: folder to write.
            first: topics and messages to write before all others, such as those of latched topics.
            custom_data: entries of its metadata.yaml.

        Raises:
            OSError, OutputError: it cannot be written.
        """
        bags = [bag for run in self._runs() if (bag := _opened(run)) is not None]
        bags = [bag for bag in bags if bag.message_count and bag.start_ns <= end_ns and bag.end_ns >= begin_ns]
        for partial in path.parent.glob(f".{path.name}.partial-*"):  # of a process that was killed while it wrote
            remove(partial)
        if not bags:
            return 0
        with BagWriter(path, custom_data) as out:
            for bag in bags:
                for topic in bag.topics.values():
                    with suppress(RecordingError):  # the topic has another type since
                        out.add_topic(topic.name, topic.msgtype, topic.qos, topic.schema)
            for name, message in first:
                with suppress(RecordingError):  # no run has recorded the topic
                    out.write(name, begin_ns, message)
            for bag in bags:
                for name, log_time_ns, published_ns, message in bag.timed_messages():
                    if begin_ns <= log_time_ns <= end_ns:
                        out.write(name, log_time_ns, message, published_ns)
            return sum(out.counts.values())

    def _runs(self) -> list[Path]:
        return sorted(self._folder.glob("run_*"))


def _opened(run: Path) -> Bag | None:
    """Open the intact parts of a run's recording; None if no part of it reached the disk."""
    try:
        return open_bag(run, salvage=True)
    except RecordingError:
        return None


def _last_change(run: Path) -> int:
    return max((entry.stat().st_mtime_ns for entry in run.iterdir()), default=0)
