# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Messages as the bytes that go over the wire: single values read from them and written into them (CDR).

Typed (de)serialisation in Python costs more than everything else a node does with a sample. Messages of one layout are
therefore read at the places found in the first of them, and sent as patched copies of one template.
"""

from __future__ import annotations

import importlib
import math
import struct
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from textile_twin_core.recordings.cdr_decode import LAYOUT_READERS, Bytes, MessageLayout
from textile_twin_core.recordings.cdr_encode import encode_headers, encode_joint_states, encode_points, encode_wrenches
from textile_twin_core.recordings.schemas import FLOAT64, HEADER, JOINT_STATE, POINT, WRENCH

SECOND_NS = 1_000_000_000
TORQUE_Z = 5

_ONE = np.zeros(1, np.int64)
_STAMP = struct.Struct("<iI")
_FLOAT64 = struct.Struct("<4sd")


class MessageError(ValueError):
    """Error for a message of the wrong kind; the text names its kind."""


def message_class(name: str) -> Any:
    """The Python class of `package/msg/Type`.

    Raises:
        LookupError: its package is not installed here.
    """
    try:
        package, kind, type_name = name.split("/")
        return getattr(importlib.import_module(f"{package}.{kind}"), type_name)
    except (ValueError, ImportError, AttributeError) as error:
        raise LookupError(f"message type '{name}' is not installed here") from error


class ForeignJointsError(MessageError):
    """The message is of other joints, or of other fields of the joint: it does not concern who reads this one.

    Args:
        text: what the message has instead.
        joints: names of its joints.
    """

    def __init__(self, text: str, joints: Sequence[str]) -> None:
        super().__init__(text)
        self.joints = tuple(joints)


class FieldReader:
    """Reads the stamp and single float64 fields of messages of one type, all in one look at the bytes.

    Args:
        msgtype: JOINT_STATE, WRENCH or POINT.
        places: returns field and number of each value to read, in their order in the message, or raises MessageError.
    """

    def __init__(self, msgtype: str, places: Callable[[MessageLayout], Sequence[tuple[str, int]]]) -> None:
        self._msgtype, self._places = msgtype, places
        self._size = sys.maxsize
        self._fixed: list[tuple[int, int, bytes]] = []
        self._filled: list[bool] = []
        self._values = _STAMP

    def read(self, raw: bytes) -> tuple[int, Sequence[float]]:
        """Stamp [ns] and the values asked for, NaN for each that the message does not have.

        Raises:
            MessageError: the bytes are no message of this type, or lack what is to be read.
        """
        if len(raw) < self._size:
            self._learn(raw)
        for start, end, fixed in self._fixed:
            if raw[start:end] != fixed:
                self._learn(raw)
                break
        seconds, nanoseconds, *values = self._values.unpack_from(raw)
        if nanoseconds >= SECOND_NS:
            raise MessageError("has a stamp of a whole second or more in its nanoseconds")
        if self._filled:
            found = iter(values)
            values = [next(found) if filled else math.nan for filled in self._filled]
        return seconds * SECOND_NS + nanoseconds, values

    def _learn(self, raw: bytes) -> None:
        """Take over the layout of a message that differs from those before; that of one that is refused is not."""
        try:
            layout = LAYOUT_READERS[self._msgtype](raw)
        except (ValueError, struct.error) as error:
            raise MessageError(f"is no {self._msgtype}: {error}") from error
        text, at, filled = f"{layout.order}4xiI", 12, []
        for name, number in self._places(layout):
            start, count = layout.fields[name]
            filled.append(number < count)
            if number < count:
                text += f"{start + 8 * number - at}xd"
                at = start + 8 * number + 8
        self._values = struct.Struct(text)
        self._filled = [] if all(filled) else filled
        self._fixed = []
        for start, fixed in layout.fixed:  # stretches that touch are compared as one
            if self._fixed and self._fixed[-1][1] == start:
                start, _, before = self._fixed.pop()
                fixed = before + fixed
            self._fixed.append((start, start + len(fixed), fixed))
        self._size = layout.size


class JointReader(FieldReader):
    """Reads one joint of JointState messages.

    Args:
        joint: the joint's name.
        fields: what to read of it, of "position", "velocity" and "effort" in this order; a message has to have the
            first of them.
    """

    def __init__(self, joint: str, fields: Sequence[str]) -> None:
        def places(layout: MessageLayout) -> list[tuple[str, int]]:
            names = layout.names
            if joint not in names:
                raise ForeignJointsError(f"has no joint '{joint}', only: {', '.join(names) or 'none at all'}", names)
            number = names.index(joint)
            if number >= layout.fields[fields[0]][1]:
                raise ForeignJointsError(f"has no {fields[0]} of joint '{joint}'", names)
            return [(name, number) for name in fields]

        super().__init__(JOINT_STATE, places)


class PositionsReader(FieldReader):
    """Reads the positions [rad or m] of several joints of JointState messages, in the order of `joints`."""

    def __init__(self, joints: Sequence[str]) -> None:
        self._order: list[int] = []

        def places(layout: MessageLayout) -> list[tuple[str, int]]:
            names = layout.names
            for joint in joints:
                if joint not in names or names.index(joint) >= layout.fields["position"][1]:
                    raise ForeignJointsError(f"has no position of joint '{joint}'", names)
            numbers = [names.index(joint) for joint in joints]
            self._order = [sorted(numbers).index(number) for number in numbers]
            return [("position", number) for number in sorted(numbers)]

        super().__init__(JOINT_STATE, places)

    def positions(self, raw: bytes) -> tuple[int, list[float]]:
        """Stamp [ns] and positions. Raises MessageError for a message that lacks one."""
        stamp, found = self.read(raw)
        return stamp, [found[k] for k in self._order]


class TorqueReader(FieldReader):
    """Reads torque.z [N m] of WrenchStamped messages."""

    def __init__(self) -> None:
        super().__init__(WRENCH, lambda _: [("wrench", TORQUE_Z)])


class HeaderReader(FieldReader):
    """Reads the stamps of Header messages."""

    def __init__(self) -> None:
        super().__init__(HEADER, lambda _: [])


def read_float64(raw: bytes) -> tuple[None, tuple[float]]:
    """No stamp, and the number in a std_msgs/Float64.

    Raises:
        MessageError: the bytes are no such message.
    """
    if len(raw) < 12:
        raise MessageError(f"is no {FLOAT64}: it ends too early")
    return None, struct.unpack_from("<d" if raw[1] else ">d", raw, 4)


#: Returns stamp [ns], None in a message without one, and values.
Read: TypeAlias = Callable[[bytes], tuple[int | None, Sequence[float]]]
#: Message type, and what makes a reader of it for a joint.
Kind: TypeAlias = tuple[str, Callable[[str], Read]]
#: Events that have a stamp alone: edges of a toothed wheel, index pulses.
EDGES: Kind = (HEADER, lambda _: HeaderReader().read)
#: Readers of a value and, where the message has it, its rate, by the value of the parameter.
ANGLE_READERS: dict[str, Kind] = {
    "joint_state": (JOINT_STATE, lambda joint: JointReader(joint, ("position", "velocity")).read),
    "float64": (FLOAT64, lambda _: read_float64),
    "edges": EDGES,
}
TORQUE_READERS: dict[str, Kind] = {
    "wrench": (WRENCH, lambda _: TorqueReader().read),
    "joint_state": (JOINT_STATE, lambda joint: JointReader(joint, ("effort",)).read),
    "float64": (FLOAT64, lambda _: read_float64),
}


class _Template:
    """One message as bytes, in which the stamp and the values of some fields are patched for each sending."""

    def __init__(self, msgtype: str, rows: Bytes, field: str, first: int = 0, count: int | None = None) -> None:
        self._bytes = bytearray(rows[0].tobytes())
        self._layout = LAYOUT_READERS[msgtype](bytes(self._bytes))
        self._values, self._start = self._place(field, first, count)

    def _place(self, field: str, first: int = 0, count: int | None = None) -> tuple[struct.Struct, int]:
        start, length = self._layout.fields[field]
        return struct.Struct(f"<{length - first if count is None else count}d"), start + 8 * first

    def message(self, stamp_ns: int, *values: float) -> bytes:
        """The message's bytes with this stamp and these values."""
        _STAMP.pack_into(self._bytes, 4, stamp_ns // SECOND_NS, stamp_ns % SECOND_NS)
        self._values.pack_into(self._bytes, self._start, *values)
        return bytes(self._bytes)


class WrenchTemplate(_Template):
    """WrenchStamped with nothing but a torque about z [N m], the one value of `message`."""

    def __init__(self, frame: str) -> None:
        super().__init__(WRENCH, encode_wrenches(_ONE, np.zeros(1), frame), "wrench", TORQUE_Z)


class PointTemplate(_Template):
    """PointStamped in a plane z [m]: `message` takes x and y [m]."""

    def __init__(self, frame: str, z_m: float = 0.0) -> None:
        super().__init__(POINT, encode_points(_ONE, np.array([[0.0, 0.0, z_m]]), frame), "point", count=2)


class JointTemplate(_Template):
    """JointState: `message` takes the positions [rad or m] of all joints in order, `full_message` velocities, too.

    Efforts stay empty, as there is nothing to say of them.
    """

    def __init__(self, joints: Sequence[str], velocities: bool = True) -> None:
        zeros = np.zeros((1, len(joints)))
        rows = encode_joint_states(_ONE, joints, zeros, zeros if velocities else None)
        super().__init__(JOINT_STATE, rows, "position")
        self._speeds, self._speeds_start = self._place("velocity")

    def full_message(self, stamp_ns: int, positions: Sequence[float], velocities: Sequence[float]) -> bytes:
        """The message's bytes with positions [rad or m] and velocities [rad/s or m/s]."""
        self._speeds.pack_into(self._bytes, self._speeds_start, *velocities)
        return self.message(stamp_ns, *positions)


class HeaderTemplate:
    """Header: `message` takes the stamp alone."""

    def __init__(self, frame: str) -> None:
        self._bytes = bytearray(encode_headers(_ONE, frame)[0].tobytes())

    def message(self, stamp_ns: int) -> bytes:
        """The message's bytes with this stamp [ns]."""
        _STAMP.pack_into(self._bytes, 4, stamp_ns // SECOND_NS, stamp_ns % SECOND_NS)
        return bytes(self._bytes)


def float_message(value: float) -> bytes:
    """The bytes of a std_msgs/Float64."""
    return _FLOAT64.pack(b"\x00\x01\x00\x00", value)


def has_header(message_type: Any) -> bool:
    """Return whether messages of this class begin with a std_msgs/Header."""
    first = next(iter(message_type.get_fields_and_field_types().values()), "")
    return bool(first == "std_msgs/Header")


def stamp_of(raw: bytes) -> int:
    """The stamp [ns] of a message that begins with a header."""
    seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] else ">iI", raw, 4)
    return int(seconds * SECOND_NS + nanoseconds)


def shift_stamp(raw: bytes, by_ns: int) -> bytes:
    """The same message, which must begin with a header, with its stamp moved by a number of nanoseconds."""
    stamp = struct.Struct("<iI" if raw[1] else ">iI")
    seconds, nanoseconds = stamp.unpack_from(raw, 4)
    moved = stamp.pack(*divmod(seconds * SECOND_NS + nanoseconds + by_ns, SECOND_NS))
    return raw[:4] + moved + raw[12:]
