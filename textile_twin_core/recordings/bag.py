"""Recordings read into numpy arrays: rosbag2 folders and single .mcap and .db3 files."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import rosbag2_metadata
from textile_twin_core.recordings.cdr_decode import MessageLayout, layouts
from textile_twin_core.recordings.mcap_parts import DamageError
from textile_twin_core.recordings.mcap_read import McapFile
from textile_twin_core.recordings.recorded_clock import better_clock, without_stamp_wraps
from textile_twin_core.recordings.recording import RecordedFile, Recording
from textile_twin_core.recordings.rosbag2_metadata import TopicInfo
from textile_twin_core.recordings.samples import AngleSamples, PointSamples, TorqueSamples
from textile_twin_core.recordings.schemas import FLOAT64, HEADER, JOINT_STATE, POINT, WRENCH
from textile_twin_core.recordings.sqlite_file import SQLITE_MAGIC, SqliteFile
from textile_twin_core.recordings.zstd_storage import SUFFIXES, ZSTD_MAGIC, opened

_Take = Callable[[str, int], FloatArray]
"""Reader of element k of a field in all messages of one layout: (field, k) -> (n,), NaN where it is missing."""


class Bag(Recording):
    """Opened recording with its samples as arrays; created by `open_bag`. See `Recording` for its topics.

    The read functions raise RecordingError if the topic is missing, empty or of another type, or never names the joint.
    Values are returned as recorded: NaN stays NaN.

    Args:
        path: Folder or file of the recording.
        files: Its opened files.
        metadata: User entries of metadata.yaml.
        notices: Remarks on what was skipped.

    Examples:
        >>> from textile_twin_core.recordings import open_bag
        >>> angle = open_bag("bags/tufting_160rpm_synthetic").read_angles()
        >>> angle.angles_rad.size  # [rad], with stamps [ns]
        22684
    """

    def read_angles(self, topic: str = "main_shaft/angle", joint: str = "main_shaft") -> AngleSamples:
        """Read shaft angles of a JointState topic (position of `joint`) or a Float64 topic."""
        info = self._readable(topic, JOINT_STATE, FLOAT64)
        if info.msgtype == FLOAT64:
            times, values = self._columns(info, lambda _, take: [take("data", 0)])
            return AngleSamples(info.name, times, values[0], None)

        def fields(layout: MessageLayout, take: _Take) -> list[FloatArray] | None:
            place = _place(layout, joint, "position")
            return None if place is None else [take("position", place), take("velocity", place)]

        stamps, (angles, velocities) = self._columns(info, fields, joint)
        velocities[np.isinf(velocities)] = np.nan  # a speed over a time step of zero is not valid
        has_velocities = not np.isnan(velocities).all()
        read = AngleSamples(info.name, stamps, angles, velocities if has_velocities else None)
        return without_stamp_wraps(read)

    def read_torques(
        self, topic: str = "balancing_torque/measured", joint: str = "main_shaft", unit_Nm: float = 1.0
    ) -> TorqueSamples:
        """Read torques of a topic of WrenchStamped (torque.z), JointState (effort of `joint`) or Float64.

        Args:
            topic: Name of the topic.
            joint: Joint of a JointState topic.
            unit_Nm: Value of one recorded unit [N m]; for a motor current, its torque constant times the gear ratio.

        Returns:
            The torques [N m] with their stamps.
        """
        info = self._readable(topic, WRENCH, JOINT_STATE, FLOAT64)

        def fields(layout: MessageLayout, take: _Take) -> list[FloatArray] | None:
            if info.msgtype == WRENCH:
                return [take("wrench", 5)]
            if info.msgtype == FLOAT64:
                return [take("data", 0)]
            place = _place(layout, joint, "effort")
            return None if place is None else [take("effort", place)]

        stamps, (torque,) = self._columns(info, fields, joint, "effort")
        return without_stamp_wraps(TorqueSamples(info.name, stamps, torque * unit_Nm))

    def read_events(self, topic: str) -> IntArray:
        """Read the stamps (n,) [ns] of a topic of Header, whose messages mark events: an edge or an index pulse."""
        return self._columns(self._readable(topic, HEADER), lambda *_: [])[0]

    def read_points(self, topic: str) -> PointSamples:
        """Read the points of a PointStamped topic."""
        info = self._readable(topic, POINT)
        stamps, columns = self._columns(info, lambda _, take: [take("point", k) for k in range(3)])
        return PointSamples(info.name, stamps, np.stack(columns, axis=1))

    def read_joint_states(self, topic: str = "joint_states") -> tuple[IntArray, dict[str, FloatArray]]:
        """Read the positions of every joint of a JointState topic: stamps (n,) [ns], joint -> (n,), NaN where
        missing.
        """
        info = self._readable(topic, JOINT_STATE)
        named = (layout.names for block in self.blocks(topic) for layout, _ in layouts(block, JOINT_STATE, info.name))
        names = sorted({name for names in named for name in names})

        def fields(layout: MessageLayout, take: _Take) -> list[FloatArray]:
            absent = layout.fields["position"][1]
            return [take("position", layout.names.index(name) if name in layout.names else absent) for name in names]

        stamps, columns = self._columns(info, fields)
        return stamps, dict(zip(names, columns, strict=True))

    def _readable(self, topic: str, *types: str) -> TopicInfo:
        if self.message_count == 0:
            raise RecordingError(f"{self.path}: the bag is empty, no topic has a message; record again")
        info = self.find_topic(topic)
        if info.encoding != "cdr":
            raise RecordingError(
                f"{self.path}: topic {info.name} holds {info.encoding or 'unknown'} messages, not CDR as ROS 2 writes"
                " them; record the ROS 2 topic, or export a table and give it to textile-twin import"
            )
        if info.msgtype not in types:
            needed = " or ".join(types)
            raise RecordingError(f"{self.path}: topic {info.name} is {info.msgtype}; name one of type {needed}")
        if info.count == 0:
            raise RecordingError(f"{self.path}: topic {info.name} has no message; was its publisher running?")
        return info

    def _columns(
        self,
        info: TopicInfo,
        fields: Callable[[MessageLayout, _Take], list[FloatArray] | None],
        joint: str = "",
        what: str = "position",
    ) -> tuple[IntArray, list[FloatArray]]:
        """Return stamps (log or publish times for Float64) and the columns that `fields` picks, of all messages
        as recorded.

        `joint` and `what` describe the missing value in the error if `fields` picks nothing.
        """
        pieces: list[list[FloatArray | IntArray]] = []
        joints: set[str] = set()
        for block in self.blocks(info.name):
            in_block: list[tuple[IntArray, list[FloatArray | IntArray]]] = []
            for layout, chosen in layouts(block, info.msgtype, info.name):
                joints.update(layout.names)
                columns = fields(layout, partial(layout.read, block, chosen))
                if columns is not None:
                    stamped = info.msgtype != FLOAT64
                    stamps = layout.stamps(block, chosen) if stamped else block.log_times_ns[chosen]
                    row: list[FloatArray | IntArray] = [stamps, *columns]
                    in_block.append((chosen, row if stamped else [*row, block.published_ns[chosen]]))
            if len(in_block) > 1:
                order = np.argsort(np.concatenate([chosen for chosen, _ in in_block]))
                joined = zip(*(columns for _, columns in in_block), strict=True)
                pieces.append([np.concatenate(column)[order] for column in joined])
            elif in_block:
                pieces.append(in_block[0][1])
        if not pieces:
            present = ", ".join(sorted(joints)) or "none"
            raise RecordingError(
                f"{self.path}: topic {info.name} has no {what} of joint '{joint}'; joints there: {present}"
            )
        stamps, *values = (np.concatenate(column) for column in zip(*pieces, strict=True))
        if info.msgtype == FLOAT64:
            stamps = better_clock(stamps, values.pop())
        if not stamps.any():
            raise RecordingError(f"{self.path}: every stamp on topic {info.name} is 0; its publisher must fill them in")
        return stamps, values


def _place(layout: MessageLayout, joint: str, field: str) -> int | None:
    """Return the index of the joint's value in a JointState of this layout; None if it has no value."""
    if joint not in layout.names:
        return None
    place = layout.names.index(joint)
    return place if place < layout.fields[field][1] else None


def _files_by_number(folder: Path) -> list[str]:
    """Return the file names of a recording in a folder in the order of writing: _2 before _10."""
    kinds = [f"*{kind}{packing}" for kind in (".mcap", ".db3") for packing in ("", *SUFFIXES)]
    names = {entry.name for kind in kinds for entry in folder.glob(kind)}
    unpacked = {name for name in names if not name.endswith(SUFFIXES)}
    names -= {name for name in names if Path(name).stem in unpacked}  # compressed copies
    return sorted(names, key=lambda name: (len(name), name))


def _existing(file: Path) -> Path | None:
    """Find a file under its name, or compressed or decompressed by hand; None if it is missing."""
    others = [file.with_name(file.name + end) for end in SUFFIXES]
    if file.name.endswith(SUFFIXES):
        others = [file.with_suffix("")]
    return next((each for each in (file, *others) if each.exists()), None)


def _file(path: Path, recording: Path | None, salvage: bool) -> RecordedFile:
    """Open a file of a recording by its first bytes. Raises RecordingError."""
    try:
        with path.open("rb") as file:
            head = file.read(len(SQLITE_MAGIC))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
    if head == SQLITE_MAGIC:
        return SqliteFile(path)
    if head.startswith(ZSTD_MAGIC):
        content, head = opened(path)
        with content:
            if head == SQLITE_MAGIC:
                return SqliteFile(path, content)
    return McapFile(path, recording, salvage)


def _by_time(files: list[RecordedFile]) -> list[RecordedFile]:
    """Sort files by their first message; a recorder may list them in another order."""
    spans = {id(file): file.span_ns() for file in files}
    return sorted(files, key=lambda file: (spans[id(file)] is None, spans[id(file)]))


def open_bag(path: str | Path, salvage: bool = False) -> Bag:
    """Open a rosbag2 folder or a single .mcap or .db3 file, compressed by zstd or not, also a truncated one.

    Args:
        path: Folder or file.
        salvage: Read everything at once and skip damaged parts, which the notices then list.

    Returns:
        The opened recording.

    Raises:
        RecordingError: The recording is missing, damaged or of an unknown kind.

    Examples:
        >>> from textile_twin_core.recordings import open_bag
        >>> open_bag("bags/tufting_160rpm_synthetic").has_topic("main_shaft/angle")
        True
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder; give a rosbag2 folder or an .mcap file")
    ignored: list[str] = []
    custom_data: dict[str, str] = {}
    if path.is_file():
        file = _file(path, None, salvage)
        metadata = file.metadata if isinstance(file, McapFile) else {}
        embedded = metadata.get("rosbag2", {}).get("serialized_metadata", "")
        with _ignoring(RecordingError, ignored, salvage):
            custom_data = rosbag2_metadata.custom_data(rosbag2_metadata.read_embedded(embedded, path), path)
        return Bag(path, [file], custom_data, ignored)
    info: dict[str, Any] = {}
    names: list[str] = []
    with _ignoring(RecordingError, ignored, salvage):
        info = rosbag2_metadata.read(path)
        names = rosbag2_metadata.file_names(info, path)
        custom_data = rosbag2_metadata.custom_data(info, path)
    names = names or _files_by_number(path)
    if not names:
        raise RecordingError(f"{path}: not a bag, neither metadata.yaml nor an .mcap or .db3 file is in this folder")
    files: list[RecordedFile] = []
    for name in names:
        place = _existing(path / Path(name).name)
        if place is None:
            missing = f"metadata.yaml names {name}, which is not in the folder"
            if salvage:
                ignored.append(f"left out: {path}: {missing}")
                continue
            recover = f"textile-twin recover {shlex.quote(str(path))} --out DIR"
            raise RecordingError(f"{path}: {missing}; copy it there, or make a recording of the others: {recover}")
        with _ignoring(DamageError, ignored, salvage):
            files.append(_file(place, path, salvage))
    return Bag(path, _by_time(files), custom_data, ignored)


@contextmanager
def _ignoring(kind: type[RecordingError], ignored: list[str], salvage: bool) -> Iterator[None]:
    """Turn an error of this kind into a notice if `salvage`, so that only the unreadable part is lost."""
    try:
        yield
    except kind as error:
        if not salvage:
            raise
        ignored.append(f"left out: {str(error).partition(';')[0]}")
