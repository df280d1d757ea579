"""Topics of one machine in a recording, and its shaft angles as measured by the encoder."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.comparison.readings import other_unit
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Encoder
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.counter import find_angle_counter, unwrap_counter
from textile_twin_core.recordings.recorded_clock import set_back, stamps_ahead
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples
from textile_twin_core.recordings.schemas import HEADER
from textile_twin_core.twin.encoder_reference import Reading, Reference, reference_of

ANGLE_TOPIC = "main_shaft/angle"
SECOND_ANGLE_TOPIC = "main_shaft/second_angle"
MEASURED_TOPIC = "balancing_torque/measured"


def namespace_of(angle_topic: str) -> str:
    """Return the namespace of the machine, the prefix of its angle topic; empty for a topic of another name."""
    suffix = f"/{ANGLE_TOPIC}"
    return angle_topic.removesuffix(suffix) if angle_topic.endswith(suffix) else ""


def beside(bag: Bag, angle_topic: str, topic: str) -> str:
    """Return the topic of that name in the namespace of the angle if it exists, else the name unchanged."""
    own = f"{namespace_of(angle_topic)}/{topic.strip('/')}"
    return own if own in bag.topics else topic


@dataclass(frozen=True)
class MachineTopics:
    """Topics and units of a machine's shaft angle and measured torque in a recording.

    Attributes:
        angle, torque: Topics; the torque is first looked up in the namespace of the angle.
        joint: Joint of JointState topics.
        index: Topic of index pulses, first looked up in the namespace of the angle; None without pulses.
        angle_unit_rad, torque_unit_Nm: Value of one unit of each topic [rad], [N m].
        skip_bad: Discard samples that are not finite or have stamps far ahead; otherwise they are errors.
    """

    angle: str = ANGLE_TOPIC
    torque: str = MEASURED_TOPIC
    joint: str = "main_shaft"
    index: str | None = None
    angle_unit_rad: float = 1.0
    torque_unit_Nm: float = 1.0
    skip_bad: bool = False

    def read_angles(self, bag: Bag, encoder: Encoder) -> AngleSamples:
        """Read the angles as measured by the encoder; edges of its wheel (a topic of Header) are counted.

        With `skip_bad`, bad samples become NaN, which the shaft estimator rejects and counts.

        Raises:
            SceneError: The encoder cannot count these edges.
            RecordingError: An angle is not finite or a stamp far ahead, unless `skip_bad`; or no angle is finite.
        """
        angles = self._in_radians(bag, encoder)
        bad = np.flatnonzero(~np.isfinite(angles.angles_rad))
        if len(bad) == len(angles):
            raise RecordingError(f"{bag.path}: topic {angles.topic}: no angle is a finite number; check the encoder")
        if len(bad) and not self.skip_bad:
            first = int(bad[0])
            after_s = (int(angles.stamps[first]) - int(angles.stamps[0])) * 1e-9
            raise RecordingError(
                f"{bag.path}: topic {angles.topic}: the angle of sample {first} ({after_s:.3f} s after the first) is"
                f" {angles.angles_rad[first]}, {len(bad)} such of {len(angles)}; leave them out with --skip-bad-samples"
            )
        ahead = stamps_ahead(angles.stamps)
        if not len(ahead):
            return angles
        if not self.skip_bad:
            first = int(ahead[0])
            ahead_s = (int(angles.stamps[first]) - int(angles.stamps[first + 1])) * 1e-9
            jump = f"the stamp of sample {first} is {ahead_s:.3f} s later than that of the next"
            raise RecordingError(
                f"{bag.path}: topic {angles.topic}: {set_back(angles.stamps) or jump}, {len(ahead)} such of"
                f" {len(angles)}; leave them out with --skip-bad-samples"
            )
        angles_rad = angles.angles_rad.copy()
        angles_rad[ahead] = np.nan
        return replace(angles, angles_rad=angles_rad)

    def read_second_angles(self, bag: Bag) -> AngleSamples | None:
        """Read the angles as measured by the second encoder; None if the recording has none."""
        topic = beside(bag, bag.find_topic(self.angle).name, SECOND_ANGLE_TOPIC)
        if topic not in bag.topics and f"/{topic}" not in bag.topics:
            return None
        seen = bag.read_angles(topic, self.joint)
        return replace(seen, angles_rad=seen.angles_rad * self.angle_unit_rad)

    def torque_in(self, bag: Bag) -> str:
        """Return the topic of the measured torque in this recording."""
        return beside(bag, bag.find_topic(self.angle).name, self.torque)

    def read_torques(self, bag: Bag) -> TorqueSamples:
        """Read the measured torques; `skip_bad` discards those with stamps far ahead."""
        measured = bag.read_torques(self.torque_in(bag), self.joint, self.torque_unit_Nm)
        ahead = stamps_ahead(measured.stamps) if self.skip_bad else ()
        if not len(ahead):
            return measured
        good = np.ones(len(measured), np.bool_)
        good[ahead] = False
        return measured.rows(good)

    def _in_radians(self, bag: Bag, encoder: Encoder) -> AngleSamples:
        """Return the angles of the topic or of its edges, counted from the reference where there is one."""
        topic, unit = bag.find_topic(self.angle), self.angle_unit_rad
        edges = topic.msgtype == HEADER
        if edges:
            stamps = bag.read_events(self.angle)
            angles = AngleSamples(topic.name, stamps, np.zeros(len(stamps)), None)
        else:
            angles = bag.read_angles(self.angle, self.joint)
            speeds = None if angles.velocities is None else angles.velocities * unit
            angles = replace(angles, angles_rad=angles.angles_rad * unit, velocities=speeds)
            angles = without_angle_wraps(angles, encoder.resolution_rad)
        reference = reference_of(encoder, edges, self.index is not None)
        if reference is None:
            return angles
        no_pulses = np.empty(0, np.int64)
        pulses = no_pulses if self.index is None else bag.read_events(beside(bag, topic.name, self.index))
        return referred(angles, reference, pulses)


def unit_notes(angles: AngleSamples) -> list[str]:
    """Warn if recorded angles seem to have another unit than radians; at most one line."""
    seen = other_unit(angles.angles_rad)
    return [f"topic {angles.topic}: {seen.instead}: give --angle-unit {seen.option}"] if seen else []


def without_angle_wraps(angles: AngleSamples, step_rad: float | None) -> AngleSamples:
    """Undo the wraps of an encoder's counter whose range is no multiple of a turn.

    Args:
        angles: as measured. step_rad: of the encoder; None to take the least difference of two moves.
    """
    counter = find_angle_counter(angles.angles_rad[np.isfinite(angles.angles_rad)], step_rad)
    if counter is None:
        return angles
    note = f"topic {angles.topic}: the angle is {counter.text}, no multiple of a turn: continued from there"
    undone = unwrap_counter(angles.angles_rad, counter.width)
    return replace(angles, angles_rad=undone, notes=(*angles.notes, note))


def referred(angles: AngleSamples, reference: Reference, pulses: IntArray) -> AngleSamples:
    """Count angles from a reference.

    Raises:
        RecordingError: The readings contain no reference.
    """
    speeds = np.full(len(angles), np.nan) if angles.velocities is None else angles.velocities
    rows = list(zip(angles.stamps.tolist(), angles.angles_rad.tolist(), speeds.tolist(), strict=True))
    known: list[Reading] = []
    begin = 0
    for pulse in pulses.tolist():
        end = int(np.searchsorted(angles.stamps, pulse, side="right"))
        known += reference.take(rows[begin:end])
        known += reference.index(pulse)
        begin = max(begin, end)
    known += reference.take(rows[begin:])
    if not known:
        raise RecordingError(
            f"topic {angles.topic}: none of {len(angles)} readings gives a reference: no gap of missing teeth"
            " and no index pulse"
        )
    stamps, angle, speed = zip(*known, strict=True)
    return replace(
        angles,
        stamps=np.array(stamps, np.int64),
        angles_rad=np.array(angle),
        velocities=None if angles.velocities is None else np.array(speed),
        recorded_ns=None,
    )
