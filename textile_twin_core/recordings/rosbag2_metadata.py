"""metadata.yaml of a rosbag2 folder, version 9: reader, writer in the style of rosbag2 in Jazzy, complete files."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from textile_twin_core.errors import RecordingError
from textile_twin_core.files.atomic import partial_path
from textile_twin_core.recordings.schemas import MessageSchema

_KEY = "rosbag2_bagfile_information"
_FOREVER = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True)
class OfferedQos:
    """Quality of service that a recorded topic was offered with, and is replayed with."""

    reliability: str = "reliable"
    durability: str = "volatile"
    depth: int = 10

    def profiles(self) -> list[dict[str, Any]]:
        """Return the list for metadata.yaml and the metadata of the channel."""
        return [
            {
                "history": "keep_last",
                "depth": self.depth,
                "reliability": self.reliability,
                "durability": self.durability,
                "deadline": dict(_FOREVER),
                "lifespan": dict(_FOREVER),
                "liveliness": "automatic",
                "liveliness_lease_duration": dict(_FOREVER),
                "avoid_ros_namespace_conventions": False,
            }
        ]

    @classmethod
    def of(cls, profiles: str | Sequence[Any]) -> OfferedQos:
        """Read the first profile of a recording (a list, or its YAML text); the default if it is not valid."""
        try:
            listed = yaml.safe_load(profiles) if isinstance(profiles, str) else profiles
        except (yaml.YAMLError, ValueError):
            listed = None
        first = listed[0] if isinstance(listed, list) and listed and isinstance(listed[0], dict) else {}
        usual = cls()
        return cls(
            _named(first.get("reliability"), ("reliable", "best_effort"), usual.reliability),
            _named(first.get("durability"), ("transient_local", "volatile"), usual.durability),
            depth if isinstance(depth := first.get("depth"), int) and depth > 0 else usual.depth,
        )


def _named(value: object, names: tuple[str, str], usual: str) -> str:
    """Return a policy by name, or by the number (1, 2) that rosbag2 wrote before version 9."""
    if value in names:
        return str(value)
    return names[int(value) - 1] if value in (1, 2) and isinstance(value, int) else usual


LATCHED = OfferedQos(durability="transient_local", depth=1)


@dataclass(frozen=True)
class TopicInfo:
    """Topic of a recording.

    Attributes:
        name: Absolute name.
        msgtype: Message type.
        count: Number of messages.
        qos: Offered quality of service.
        schema: Definition of the type in the recording; None if missing.
        encoding: Encoding of the messages.
    """

    name: str
    msgtype: str
    count: int
    qos: OfferedQos = OfferedQos()
    schema: MessageSchema | None = None
    encoding: str = "cdr"


def dump(value: object) -> str:
    """Format as YAML, with keys in the given order."""
    text: str = yaml.dump(value, Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper), sort_keys=False)
    return text


@dataclass(frozen=True)
class FileInfo:
    """Complete file: name, first and last log time [ns] (None without messages), and number of messages by topic."""

    name: str
    span_ns: tuple[int, int] | None
    counts: Mapping[str, int]


def total(files: Sequence[FileInfo]) -> Counter[str]:
    """Sum the messages of several files by topic."""
    return sum((Counter(file.counts) for file in files), Counter())


def _entries(files: Sequence[FileInfo]) -> dict[str, Any]:
    """Return start, duration and count of one or several files in the format of rosbag2."""
    spans = [file.span_ns for file in files if file.span_ns is not None]
    start = min((first for first, _ in spans), default=0)
    return {
        "starting_time": {"nanoseconds_since_epoch": int(start)},
        "duration": {"nanoseconds": int(max((last for _, last in spans), default=0) - start)},
        "message_count": total(files).total(),
    }


def information(
    files: Sequence[FileInfo], topics: Iterable[TopicInfo], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """Build the rosbag2 information of a recording in one or several files, whose message counts are added."""
    counts = total(files)
    return {
        "version": 9,
        "storage_identifier": "mcap",
        **_entries(files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.msgtype,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.qos.profiles(),
                    "type_description_hash": topic.schema.type_hash if topic.schema else "",
                },
                "message_count": counts[topic.name],
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **_entries([file])} for file in files],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "jazzy",
    }


def write(folder: Path, info: dict[str, Any]) -> None:
    """Write metadata.yaml into the folder: whole and on the disk, also before a power loss, or not at all.

    Raises OSError when the disk is full.
    """
    file = folder / "metadata.yaml"
    partial = partial_path(file)
    try:
        with partial.open("w", encoding="utf-8") as stream:
            stream.write(dump({_KEY: info}))
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)


def read(folder: Path) -> dict[str, Any]:
    """Read the rosbag2 information of metadata.yaml; empty if the file is missing, as after a kill.

    Raises:
        RecordingError: The file exists but is not of rosbag2.
    """
    file = folder / "metadata.yaml"
    if not file.exists():
        return {}
    try:
        text = file.read_bytes()
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror})") from error
    loaded = _load(text, file)
    return _mapping(loaded.get(_KEY), file)


def read_embedded(text: str, file: Path) -> dict[str, Any]:
    """Read the copy that rosbag2 stores in the .mcap file; empty for an empty text."""
    return _load(text, file) if text else {}


def custom_data(info: dict[str, Any], path: Path) -> dict[str, str]:
    """Return the user entries."""
    return {str(key): str(value) for key, value in _mapping(info.get("custom_data") or {}, path).items()}


def file_names(info: dict[str, Any], path: Path) -> list[str]:
    """Return the file names of the recording as listed."""
    names = info.get("relative_file_paths") or []
    if not isinstance(names, list):
        raise _unknown(path)
    return [str(name) for name in names]


def _load(text: str | bytes, file: Path) -> dict[str, Any]:
    try:
        loaded = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, UnicodeDecodeError):
        loaded = None
    return _mapping(loaded, file)


def _mapping(value: object, file: Path) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise _unknown(file)
    return value


def _unknown(file: Path) -> RecordingError:
    return RecordingError(f"{file}: no metadata of rosbag2 in it; remove metadata.yaml to read the .mcap alone")


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
