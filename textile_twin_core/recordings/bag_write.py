"""Writer of recordings: rosbag2 folders and single .mcap files, from raw messages or from arrays."""

from __future__ import annotations

import errno
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import OutputError, RecordingError
from textile_twin_core.files.atomic import partial_path, put_in_place, remove
from textile_twin_core.recordings import cdr_encode, rosbag2_metadata
from textile_twin_core.recordings.cdr_decode import Bytes, MessageBlock, gather
from textile_twin_core.recordings.mcap_write import McapFileWriter
from textile_twin_core.recordings.recording import Progress, Recording
from textile_twin_core.recordings.recording_paths import check_place, is_empty_folder
from textile_twin_core.recordings.rosbag2_metadata import CompleteFiles, FileInfo, OfferedQos, TopicInfo
from textile_twin_core.recordings.schemas import (
    FLOAT64,
    HEADER,
    JOINT_STATE,
    POINT,
    WRENCH,
    MessageSchema,
    message_schema,
)


class ArrayWriter(ABC):
    """Base of recording writers: methods that append arrays of samples."""

    @abstractmethod
    def _write_rows(self, topic: str, msgtype: str, log_times_ns: IntArray, rows: Bytes) -> None:
        """Append messages of equal length; declare the topic if necessary."""

    def write_joint_states(
        self,
        topic: str,
        stamps_ns: IntArray,
        names: Sequence[str],
        positions: FloatArray | None,
        velocities: FloatArray | None = None,
        efforts: FloatArray | None = None,
        frame_id: str = "",
        log_times_ns: IntArray | None = None,
    ) -> None:
        """Append JointStates: values (n, joints), or (n,) for one joint; None leaves a field empty.

        This method and those below declare the topic if necessary; log times default to the stamps.
        """
        rows = cdr_encode.encode_joint_states(stamps_ns, names, positions, velocities, efforts, frame_id)
        self._write_rows(topic, JOINT_STATE, stamps_ns if log_times_ns is None else log_times_ns, rows)

    def write_wrenches(
        self,
        topic: str,
        stamps_ns: IntArray,
        torque_z: FloatArray,
        frame_id: str = "main_shaft",
        log_times_ns: IntArray | None = None,
    ) -> None:
        """Append WrenchStamped messages with a torque about z, (n,) [N m]."""
        rows = cdr_encode.encode_wrenches(stamps_ns, torque_z, frame_id)
        self._write_rows(topic, WRENCH, stamps_ns if log_times_ns is None else log_times_ns, rows)

    def write_points(
        self,
        topic: str,
        stamps_ns: IntArray,
        points_m: FloatArray,
        frame_id: str = "base",
        log_times_ns: IntArray | None = None,
    ) -> None:
        """Append PointStamped messages, points (n, 3) [m]."""
        rows = cdr_encode.encode_points(stamps_ns, points_m, frame_id)
        self._write_rows(topic, POINT, stamps_ns if log_times_ns is None else log_times_ns, rows)

    def write_floats(self, topic: str, log_times_ns: IntArray, values: FloatArray) -> None:
        """Append Float64 messages, values (n,)."""
        self._write_rows(topic, FLOAT64, log_times_ns, cdr_encode.encode_floats(values))

    def write_events(self, topic: str, stamps_ns: IntArray, frame_id: str = "main_shaft") -> None:
        """Append Header messages, which mark events: an edge or an index pulse."""
        self._write_rows(topic, HEADER, stamps_ns, cdr_encode.encode_headers(stamps_ns, frame_id))


_FLUSH_SECONDS = 1.0


class BagWriter(ArrayWriter):
    """Writer of one recording; a context manager.

    A path that ends in .mcap gives a single file, any other a rosbag2 folder with metadata.yaml. The recording is
    written to a hidden sibling and renamed when complete; an exception removes it.

    With live=True the recording is written in place and synced to disk once a second (call flush() from a timer to
    ensure this while no messages arrive). A kill loses at most a second, open_bag reads the truncated recording, and an
    exception completes it.

    Args:
        path: Folder or .mcap file.
        custom_data: User entries of metadata.yaml.
        live: Write in place.
        overwrite: Replace an existing recording.
        split_bytes: Size at which the next file of the folder starts; 0 for never. A single file is never split.
        split_s: Time span at which the next file of the folder starts [s]; 0 for never.

    Raises:
        OutputError: The path cannot be written, or exists and `overwrite` is false.

    Examples:
        >>> import tempfile
        >>> import numpy as np
        >>> from textile_twin_core.recordings import BagWriter, open_bag
        >>> stamps = np.arange(1000) * 2_000_000  # [ns]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with BagWriter(f"{folder}/bag") as bag:
        ...         bag.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], stamps * 1.6e-8)  # [rad]
        ...     open_bag(f"{folder}/bag").message_count
        1000
    """

    def __init__(
        self,
        path: str | Path,
        custom_data: Mapping[str, str] | None = None,
        *,
        live: bool = False,
        overwrite: bool = False,
        split_bytes: int = 0,
        split_s: float = 0.0,
    ) -> None:
        self.path = Path(path)
        self._custom_data = {key: str(value) for key, value in (custom_data or {}).items()}
        self._live = live
        self._single = self.path.suffix == ".mcap"
        check_place(self.path, overwrite)
        self._place = self.path if live else partial_path(self.path)
        if not live or not is_empty_folder(self.path):
            remove(self._place)
        if not self._single:
            self._place.mkdir(exist_ok=live)
        self._split_bytes, self._split_ns = split_bytes, round(split_s * 1e9)
        self._complete = CompleteFiles()
        self._started = 0
        self._topics: dict[str, TopicInfo] = {}
        self._channels: dict[str, int] = {}
        self._begin_file()
        self._flushed = time.monotonic()

    def _begin_file(self) -> None:
        """Open the next file and declare all topics in it."""
        self._file_name = self.path.name if self._single else f"{self.path.name}_{self._started}.mcap"
        self._started += 1
        self._file = McapFileWriter(self._place if self._single else self._place / self._file_name, self.path)
        self._first_ns: int | None = None
        self._channels.clear()
        for topic in self._topics.values():
            self._declare(topic)

    def add_topic(
        self, topic: str, msgtype: str, qos: OfferedQos | None = None, schema: MessageSchema | None = None
    ) -> None:
        """Declare a topic before its first message.

        Args:
            topic: Name of the topic.
            msgtype: Message type.
            qos: Offered quality of service; reliable and volatile by default.
            schema: Definition of the type; looked up by default.

        Raises:
            RecordingError: The definition of the type is not found.
        """
        name = _absolute(topic)
        if name in self._topics:
            if self._topics[name].msgtype != msgtype:
                raise RecordingError(f"topic {name}: is {self._topics[name].msgtype} already, cannot be {msgtype} too")
            return
        schema = schema or message_schema(msgtype)
        self._topics[name] = TopicInfo(name, msgtype, 0, qos or OfferedQos(), schema)
        self._declare(self._topics[name])

    def _declare(self, topic: TopicInfo) -> None:
        assert topic.schema is not None
        metadata = {
            "offered_qos_profiles": rosbag2_metadata.dump(topic.qos.profiles()),
            "topic_type_hash": topic.schema.type_hash,
        }
        self._channels[topic.name] = self._file.add_channel(topic.name, topic.msgtype, topic.schema, metadata)

    def copy_topic(self, bag: Recording, name: str, progress: Progress | None = None) -> None:
        """Declare a topic as in another recording and append all its messages."""
        topic = bag.find_topic(name)
        self.add_topic(topic.name, topic.msgtype, topic.qos, topic.schema)
        for block in bag.blocks(name, progress):
            self.write_block(topic.name, block)

    def write(self, topic: str, log_time_ns: int, cdr: bytes, publish_time_ns: int | None = None) -> None:
        """Append one serialised message to a declared topic.

        Args:
            topic: Name of the topic.
            log_time_ns: Time of reception.
            cdr: The message.
            publish_time_ns: Time of publishing; the log time by default.
        """
        published_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        if min(log_time_ns, published_ns) < 0:
            raise RecordingError(
                f"topic {_absolute(topic)}: log time {log_time_ns} ns, publish time {published_ns} ns; neither may be"
                " negative"
            )
        if self._is_full(log_time_ns):
            self.split()
            self._first_ns = log_time_ns
        self._file.write(self._channel(topic), log_time_ns, published_ns, cdr)
        self._flush_when_due()

    def write_block(self, topic: str, block: MessageBlock) -> None:
        """Append a block of messages of another recording unchanged."""
        channel, published = self._channel(topic), block.published_ns
        if len(block) and (block.sizes == block.sizes[0]).all():
            rows = gather(block.buffer, block.starts, f"V{int(block.sizes[0])}")
            self._file.write_rows(channel, block.log_times_ns, published, rows.view(np.uint8).reshape(len(block), -1))
        else:
            for i in range(len(block)):
                self._file.write(channel, int(block.log_times_ns[i]), int(published[i]), block.message(i))
        self._flush_when_due()

    def _write_rows(self, topic: str, msgtype: str, log_times_ns: IntArray, rows: Bytes) -> None:
        times = np.asarray(log_times_ns, np.int64)
        if times.size and times.min() < 0:
            at = int(np.argmax(times < 0))
            raise RecordingError(
                f"topic {_absolute(topic)}: sample {at + 1} has the stamp {times[at]} ns; a recording's times are"
                " nanoseconds since 1970: none may be negative; add the same offset to all"
            )
        self.add_topic(topic, msgtype)
        self._file.write_rows(self._channel(topic), times, times, rows)
        self._flush_when_due()

    def _channel(self, topic: str) -> int:
        try:
            return self._channels[_absolute(topic)]
        except KeyError:
            raise RecordingError(f"topic {_absolute(topic)}: not declared; call add_topic before writing") from None

    def _flush_when_due(self) -> None:
        if self._live and time.monotonic() - self._flushed >= _FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Sync everything written so far to disk, for live recordings; does nothing for others.

        Raises:
            OSError: The disk is full, or the file was removed, in which case writing would silently succeed.
        """
        if self._live:
            self._file.flush()
            self._flushed = time.monotonic()
            if self._file.is_removed or not self._file.path.exists():
                raise self._gone()

    def _gone(self) -> FileNotFoundError:
        """Return the error that describes what happened to the file."""
        what = "overwritten by another recording" if self._file.path.exists() else "removed or renamed"
        return FileNotFoundError(errno.ENOENT, f"{what} while it was recorded", str(self.path))

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages in the remaining files, by absolute topic name."""
        counts = {name: self._file.counts[channel] for name, channel in self._channels.items()}
        return counts | {name: counts.get(name, 0) + count for name, count in self._complete.counts.items()}

    @property
    def bytes_kept(self) -> int:
        """Size of the remaining files, without data that waits for the next flush."""
        return self._file.bytes_written + self._complete.bytes

    def _is_full(self, log_time_ns: int) -> bool:
        if self._single or not (self._split_bytes or self._split_ns):
            return False
        if self._first_ns is None:
            self._first_ns = log_time_ns
        grown = self._split_bytes and self._file.bytes_written >= self._split_bytes
        return bool(grown or (self._split_ns and log_time_ns - self._first_ns >= self._split_ns))

    def split(self) -> None:
        """Complete this file and continue in the next one of the folder."""
        if self._single:
            raise RecordingError(f"{self.path}: a single file cannot be split; give a folder")
        self._end_file()
        self._begin_file()

    def drop_oldest_file(self, before_ns: int | None = None) -> bool:
        """Remove the oldest complete file; return false without one."""
        return self._complete.drop_oldest(self._place, before_ns)

    def _end_file(self) -> None:
        """Complete the current file and store a copy of its metadata in it."""
        self._file.flush()
        if self._live and self._file.is_removed:
            raise self._gone()  # avoid writing metadata beside the file of another recording
        counts = {name: self._file.counts[channel] for name, channel in self._channels.items()}
        written = FileInfo(self._file_name, self._file.span_ns, counts)
        own = self._information([written])
        self._file.add_metadata("rosbag2", {"serialized_metadata": rosbag2_metadata.dump(own)})
        self._file.close()
        self._complete.append(written, self._file.bytes_written)

    def _information(self, files: list[FileInfo]) -> dict[str, Any]:
        return rosbag2_metadata.information(files, self._topics.values(), self._custom_data)

    def close(self) -> None:
        """Complete the recording and give it its final name.

        Raises:
            OSError: The disk is full, or the file of a live recording was removed.
        """
        self._end_file()
        if not self._single:
            rosbag2_metadata.write(self._place, self._information(self._complete.files))
        if not self._live:
            put_in_place(self._place, self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None or self._live:
                self.close()
        except OSError as failure:
            raise OutputError(f"output {self.path}: {failure.strerror or failure}") from failure
        finally:
            self._file.abandon()
            if not self._live:
                remove(self._place)


def _absolute(topic: str) -> str:
    return "/" + topic.strip("/")
