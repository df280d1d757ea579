"""Bulk conversion of numpy arrays to ROS messages: little-endian CDR of equal length, one row of bytes per message."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.cdr_decode import Bytes

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


class _Template:
    """Bytes shared by all messages, and the columns that differ."""

    def __init__(self) -> None:
        self.shared = bytearray(_LITTLE_ENDIAN)
        self.columns: list[tuple[int, Bytes]] = []

    def align(self, to: int) -> None:
        self.shared += bytes(-(len(self.shared) - 4) % to)

    def uint32(self, value: int) -> None:
        self.align(4)
        self.shared += struct.pack("<I", value)

    def string(self, text: str) -> None:
        data = text.encode() + b"\x00"
        self.uint32(len(data))
        self.shared += data

    def column(self, values: Bytes, align: int) -> None:
        """Append a column of bytes (n, k)."""
        self.align(align)
        self.columns.append((len(self.shared), values))
        self.shared += bytes(values.shape[1])

    def doubles(self, values: FloatArray) -> None:
        """Append doubles (n, k); k = 0 appends nothing, not even padding."""
        if values.shape[1]:
            little = np.ascontiguousarray(values, "<f8")
            self.column(little.view(np.uint8).reshape(len(values), -1), 8)

    def header(self, stamps_ns: IntArray, frame_id: str) -> None:
        seconds, nanoseconds = np.divmod(np.asarray(stamps_ns, np.int64), 1_000_000_000)
        if len(seconds) and (seconds.min() < 0 or seconds.max() >= 2**31):
            at = int(np.argmax((seconds < 0) | (seconds >= 2**31)))
            raise RecordingError(
                f"sample {at + 1}: a stamp of {int(stamps_ns[at])} ns lies outside 1970..2038, which a ROS header"
                " cannot carry; check the clock, or add the same offset to all: stamps are nanoseconds since 1970"
            )
        words = np.stack([seconds, nanoseconds], axis=1).astype("<i4")
        self.column(words.view(np.uint8).reshape(len(words), 8), 4)
        self.string(frame_id)

    def rows(self, count: int) -> Bytes:
        """Return all messages, shape (count, message size)."""
        rows = np.empty((count, len(self.shared)), np.uint8)
        rows[:] = np.frombuffer(bytes(self.shared), np.uint8)
        for start, values in self.columns:
            rows[:, start : start + values.shape[1]] = values
        return rows


def _two_dimensional(values: FloatArray | None, count: int) -> FloatArray:
    if values is None:
        return np.empty((count, 0))
    array = np.asarray(values, np.float64)
    return array[:, None] if array.ndim == 1 else array


def encode_joint_states(
    stamps_ns: IntArray,
    names: Sequence[str],
    positions: FloatArray | None,
    velocities: FloatArray | None = None,
    efforts: FloatArray | None = None,
    frame_id: str = "",
) -> Bytes:
    """Encode sensor_msgs/JointState: values (n, joints), or (n,) for one joint; None leaves a field empty."""
    count = len(stamps_ns)
    message = _Template()
    message.header(stamps_ns, frame_id)
    message.uint32(len(names))
    for name in names:
        message.string(name)
    for values in (positions, velocities, efforts):
        array = _two_dimensional(values, count)
        if array.shape not in ((count, len(names)), (count, 0)):
            raise ValueError(f"{array.shape} values for {count} messages of {len(names)} joints")
        message.uint32(array.shape[1])
        message.doubles(array)
    return message.rows(count)


def encode_wrenches(stamps_ns: IntArray, torque_z_Nm: FloatArray, frame_id: str) -> Bytes:
    """Encode geometry_msgs/WrenchStamped with a torque about z (n,) [N m] and zero elsewhere."""
    wrench = np.zeros((len(stamps_ns), 6))
    wrench[:, 5] = torque_z_Nm
    return _stamped(stamps_ns, wrench, frame_id)


def encode_points(stamps_ns: IntArray, points_m: FloatArray, frame_id: str) -> Bytes:
    """Encode geometry_msgs/PointStamped from points (n, 3) [m]."""
    return _stamped(stamps_ns, np.asarray(points_m, np.float64).reshape(len(stamps_ns), 3), frame_id)


def encode_floats(values: FloatArray) -> Bytes:
    """Encode std_msgs/Float64 from values (n,)."""
    message = _Template()
    message.doubles(_two_dimensional(values, len(values)))
    return message.rows(len(values))


def encode_headers(stamps_ns: IntArray, frame_id: str) -> Bytes:
    """Encode std_msgs/Header."""
    message = _Template()
    message.header(stamps_ns, frame_id)
    return message.rows(len(stamps_ns))


def encode_string(text: str) -> bytes:
    """Encode std_msgs/String."""
    message = _Template()
    message.string(text)
    return bytes(message.shared)


def _stamped(stamps_ns: IntArray, values: FloatArray, frame_id: str) -> Bytes:
    message = _Template()
    message.header(stamps_ns, frame_id)
    message.doubles(values)
    return message.rows(len(stamps_ns))
