"""Bulk conversion of ROS messages to numpy: fields of CDR messages of one layout are gathered without a loop."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import RecordingError

Bytes = npt.NDArray[np.uint8]

_MOST_LAYOUTS = 16
"""Number of layouts tried in bulk per block; messages of other layouts are read one by one."""


@dataclass(frozen=True)
class MessageBlock:
    """Messages of one channel in the order of the file.

    Attributes:
        buffer: Bytes that contain the messages.
        starts, sizes: Position and size of each CDR message in `buffer`.
        log_times_ns: Times of recording [ns].
        publish_times_ns: Times of publishing [ns], if the file has them.
    """

    buffer: Bytes
    starts: IntArray
    sizes: IntArray
    log_times_ns: IntArray
    publish_times_ns: IntArray | None = None

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def published_ns(self) -> IntArray:
        """Times of publishing [ns], the log times where the file has no valid ones."""
        published = self.publish_times_ns
        return self.log_times_ns if published is None else np.where(published > 0, published, self.log_times_ns)

    def message(self, i: int) -> bytes:
        """Return the CDR bytes of message i, with the 4 bytes of encapsulation."""
        start = int(self.starts[i])
        return self.buffer[start : start + int(self.sizes[i])].tobytes()


def gather(buffer: Bytes, starts: IntArray, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return the values of `dtype` at the byte positions `starts` of `buffer`, aligned or not; shape (len(starts),)."""
    kind = np.dtype(dtype)
    if len(starts) == 0:
        return np.empty(0, kind)
    overlapping: npt.NDArray[Any] = np.ndarray((len(buffer) - kind.itemsize + 1,), kind, buffer, 0, (1,))
    return overlapping[starts]


@dataclass
class MessageLayout:
    """Layout of a message: bytes shared by all messages of this layout, and the fields to read."""

    size: int = 0
    order: str = "<"
    fixed: list[tuple[int, bytes]] = field(default_factory=list)
    fields: dict[str, tuple[int, int]] = field(default_factory=dict)
    names: tuple[str, ...] = ()

    def follows(self, block: MessageBlock, chosen: IntArray) -> npt.NDArray[np.bool_]:
        """Return (len(chosen),) true for the chosen messages that have this layout."""
        fits = block.sizes[chosen] >= self.size
        inside = chosen if fits.all() else chosen[fits]
        same = np.ones(len(inside), np.bool_)
        for offset, kind, expected in self._words():
            same &= gather(block.buffer, block.starts[inside] + offset, kind) == expected
        fits[fits] = same
        return fits

    def _words(self) -> Iterator[tuple[int, str, int]]:
        """Combine the fixed bytes into few unsigned words: (offset, type, value); the last word of a run may
        overlap.
        """
        stretches: list[tuple[int, bytes]] = []
        for offset, expected in self.fixed:
            if stretches and stretches[-1][0] + len(stretches[-1][1]) == offset:
                stretches[-1] = (stretches[-1][0], stretches[-1][1] + expected)
            else:
                stretches.append((offset, expected))
        for offset, expected in stretches:
            width = next(size for size in (8, 4, 2, 1) if size <= len(expected))
            for start in (*range(0, len(expected) - width, width), len(expected) - width):
                word = int.from_bytes(expected[start : start + width], "little")
                yield offset + start, f"<u{width}", word

    def read(self, block: MessageBlock, chosen: IntArray, name: str, element: int) -> FloatArray:
        """Return one element of a float64 field of the chosen messages, NaN where it is missing; shape (n,)."""
        offset, length = self.fields[name]
        if element >= length:
            return np.full(len(chosen), np.nan)
        return gather(block.buffer, block.starts[chosen] + offset + 8 * element, f"{self.order}f8").astype(np.float64)

    def stamps(self, block: MessageBlock, chosen: IntArray) -> IntArray:
        """Return the header stamps [ns]; shape (len(chosen),)."""
        seconds = gather(block.buffer, block.starts[chosen] + 4, f"{self.order}i4").astype(np.int64)
        nanoseconds: IntArray = gather(block.buffer, block.starts[chosen] + 8, f"{self.order}u4").astype(np.int64)
        return seconds * 1_000_000_000 + nanoseconds


class _Cursor:
    """Position in one message, and the layout found so far."""

    def __init__(self, cdr: bytes) -> None:
        if len(cdr) < 4 or cdr[0] != 0 or cdr[1] > 1:
            raise ValueError("its encapsulation is not plain CDR")
        self.cdr, self.position = cdr, 4
        self.layout = MessageLayout(order="<" if cdr[1] else ">", fixed=[(0, cdr[:2])])

    def align(self, to: int) -> None:
        self.position += -(self.position - 4) % to

    def take(self, count: int) -> int:
        start, self.position = self.position, self.position + count
        if self.position > len(self.cdr):
            raise ValueError("it ends too early")
        return start

    def length(self) -> int:
        self.align(4)
        start = self.take(4)
        self.layout.fixed.append((start, self.cdr[start : start + 4]))
        return int(struct.unpack_from(f"{self.layout.order}I", self.cdr, start)[0])

    def string(self) -> str:
        count = self.length()
        start = self.take(count)
        if count:
            self.layout.fixed.append((start, self.cdr[start : start + count]))
        return self.cdr[start : start + max(count - 1, 0)].decode(errors="replace")

    def doubles(self, name: str, count: int) -> None:
        if count:
            self.align(8)
        self.layout.fields[name] = (self.take(8 * count), count)

    def header(self) -> None:
        self.take(8)
        self.string()

    def end(self) -> MessageLayout:
        self.layout.size = self.position
        return self.layout


def _joint_state(cdr: bytes) -> MessageLayout:
    cursor = _Cursor(cdr)
    cursor.header()
    cursor.layout.names = tuple(cursor.string() for _ in range(cursor.length()))
    for name in ("position", "velocity", "effort"):
        cursor.doubles(name, cursor.length())
    return cursor.end()


def _stamped(name: str, count: int) -> Callable[[bytes], MessageLayout]:
    def read(cdr: bytes) -> MessageLayout:
        cursor = _Cursor(cdr)
        cursor.header()
        cursor.doubles(name, count)
        return cursor.end()

    return read


def _header(cdr: bytes) -> MessageLayout:
    cursor = _Cursor(cdr)
    cursor.header()
    return cursor.end()


def _float64(cdr: bytes) -> MessageLayout:
    cursor = _Cursor(cdr)
    cursor.doubles("data", 1)
    return cursor.end()


LAYOUT_READERS: dict[str, Callable[[bytes], MessageLayout]] = {
    "sensor_msgs/msg/JointState": _joint_state,
    "geometry_msgs/msg/WrenchStamped": _stamped("wrench", 6),
    "geometry_msgs/msg/PointStamped": _stamped("point", 3),
    "std_msgs/msg/Float64": _float64,
    "std_msgs/msg/Header": _header,
}
"""Reader of the layout from one message, by decoded message type."""


def layouts(block: MessageBlock, msgtype: str, topic: str) -> Iterator[tuple[MessageLayout, IntArray]]:
    """Split a block into groups of one layout: (layout, indices of its messages), each message in one group.

    Raises:
        RecordingError: A message cannot be decoded; the text has its time of recording.
    """
    read_layout = LAYOUT_READERS[msgtype]
    remaining = np.arange(len(block))
    tried = 0
    while len(remaining):
        first = int(remaining[0])
        try:
            layout = read_layout(block.message(first))
        except (ValueError, struct.error) as error:
            raise RecordingError(
                f"topic {topic}: the message recorded at {int(block.log_times_ns[first])} ns is not a {msgtype}:"
                f" {error}; the recording is damaged there"
            ) from error
        tried += 1
        same = layout.follows(block, remaining) if tried <= _MOST_LAYOUTS else remaining == first
        yield layout, remaining[same]
        remaining = remaining[~same]
