"""metadata.yaml of a rosbag2 folder, version 9: read, and written as rosbag2 of Jazzy writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from textile_twin_core.errors import RecordingError

_KEY = "rosbag2_bagfile_information"
_FOREVER = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True)
class OfferedQos:
    """Quality of service that a recorded topic was offered with, and will be replayed with."""

    reliability: str = "reliable"
    durability: str = "volatile"
    depth: int = 10

    def profiles(self) -> list[dict[str, Any]]:
        """The list that stands in metadata.yaml and in the channel's metadata."""
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


LATCHED = OfferedQos(durability="transient_local", depth=1)


@dataclass
class RecordedTopic:
    """What metadata.yaml tells of a topic."""

    name: str
    msgtype: str
    type_hash: str
    qos: OfferedQos
    count: int = 0


def dump(value: object) -> str:
    """YAML text, keys in the given order."""
    text: str = yaml.dump(value, Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper), sort_keys=False)
    return text


def information(
    file_name: str,
    topics: Sequence[RecordedTopic],
    span_ns: tuple[int, int] | None,
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """The rosbag2 information of one file; span_ns: log times of its first and last messages."""
    first, last = span_ns or (0, 0)
    start = {"nanoseconds_since_epoch": int(first)}
    duration = {"nanoseconds": int(last - first)}
    count = sum(topic.count for topic in topics)
    return {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": dict(duration),
        "starting_time": dict(start),
        "message_count": count,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.msgtype,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.qos.profiles(),
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, "starting_time": start, "duration": duration, "message_count": count}],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "jazzy",
    }


def write(folder: Path, info: dict[str, Any]) -> None:
    """Write metadata.yaml into the folder."""
    (folder / "metadata.yaml").write_text(dump({_KEY: info}), encoding="utf-8")


def read(folder: Path) -> dict[str, Any]:
    """The rosbag2 information of metadata.yaml; empty when there is none, as after a kill.

    Raises RecordingError when the file is there but is not of rosbag2.
    """
    file = folder / "metadata.yaml"
    if not file.exists():
        return {}
    loaded = _load(file.read_bytes(), file)
    return _mapping(loaded.get(_KEY), file)


def read_embedded(text: str, file: Path) -> dict[str, Any]:
    """The same from the copy that rosbag2 leaves in the .mcap file; empty text gives an empty one."""
    return _load(text, file) if text else {}


def custom_data(info: dict[str, Any]) -> dict[str, str]:
    """The user's own entries."""
    return {str(key): str(value) for key, value in (info.get("custom_data") or {}).items()}


def _load(text: str | bytes, file: Path) -> dict[str, Any]:
    try:
        loaded = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, UnicodeDecodeError):
        loaded = None
    return _mapping(loaded, file)


def _mapping(value: object, file: Path) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise RecordingError(f"{file}: no metadata of rosbag2 in it; remove the file to read the .mcap alone")
    return value
