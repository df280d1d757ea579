"""Message types: their ROS names, and definitions with RIHS01 hashes as stored in a recording."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from textile_twin_core.errors import RecordingError

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
POINT = "geometry_msgs/msg/PointStamped"
FLOAT64 = "std_msgs/msg/Float64"
HEADER = "std_msgs/msg/Header"


_SEPARATOR = "=" * 80 + "\n"
_FIELD = re.compile(r"^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w", re.MULTILINE)
_NO_MESSAGES = {
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32", "uint32",
    "int64", "uint64", "string", "wstring",
}  # fmt: skip


@dataclass(frozen=True)
class MessageSchema:
    """Definition of a message type.

    Attributes:
        text: Definition with all nested ones, in the form `encoding`.
        type_hash: RIHS01 hash of the type.
        encoding: Form of the definition.
    """

    text: str
    type_hash: str
    encoding: str = "ros2msg"


@cache
def message_schema(msgtype: str) -> MessageSchema:
    """Return the schema of a type such as sensor_msgs/msg/JointState.

    Common types come with the rosbags library, as in ROS 2 Jazzy; others are read from the ROS packages listed in
    AMENT_PREFIX_PATH.

    Raises:
        RecordingError: The type is found in neither.
    """
    from rosbags.typesys import Stores, get_typestore

    sourced = f"ROS2_{os.environ.get('ROS_DISTRO', '').upper()}"
    store = get_typestore(getattr(Stores, sourced, Stores.ROS2_JAZZY))
    if msgtype in store.types:
        return MessageSchema(store.generate_msgdef(msgtype, ros_version=2)[0], store.hash_rihs01(msgtype))
    return installed_schema(msgtype)


def installed_schema(msgtype: str) -> MessageSchema:
    """Return the definition of a message type from the ROS packages beside this Python."""
    file = _installed_file(msgtype, "msg")
    hashes = json.loads(_installed_file(msgtype, "json").read_text(encoding="utf-8"))["type_hashes"]
    type_hash = next(entry["hash_string"] for entry in hashes if entry["type_name"] == msgtype)
    parts = [file.read_text(encoding="utf-8").rstrip("\n") + "\n"]
    needed = _needs(parts[0], msgtype)
    done = {msgtype}
    while needed:
        name = needed.pop(0)
        if name in done:
            continue
        done.add(name)
        text = _installed_file(name, "msg").read_text(encoding="utf-8").rstrip("\n") + "\n"
        package, _, kind = name.split("/")
        parts.append(f"MSG: {package}/{kind}\n{text}")
        needed += _needs(text, name)
    return MessageSchema(_SEPARATOR.join(parts), type_hash)


def _needs(text: str, msgtype: str) -> list[str]:
    """Return the message types named by the fields of a definition."""
    package = msgtype.split("/")[0]
    found = []
    for kind in _FIELD.findall(re.sub(r"#.*", "", text)):
        if kind in _NO_MESSAGES:
            continue
        parts = kind.split("/")
        found.append(f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}")
    return found


def _installed_file(msgtype: str, suffix: str) -> Path:
    package, _, kind = msgtype.split("/") if msgtype.count("/") == 2 else ("", "", msgtype)
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        file = Path(prefix) / "share" / package / "msg" / f"{kind}.{suffix}"
        if prefix and file.is_file():
            return file
    raise RecordingError(
        f"message type {msgtype}: no definition found; put the folder of its ROS package on AMENT_PREFIX_PATH"
    )
