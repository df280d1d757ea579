"""Writers of messages from arrays, by message type."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.recordings import cdr_encode
from textile_twin_core.recordings.cdr_decode import Bytes
from textile_twin_core.recordings.message_types import FLOAT64, HEADER, JOINT_STATE, POINT, WRENCH


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
