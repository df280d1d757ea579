"""The topics of one machine in a recording, and its shaft's angles as the encoder measures them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.comparison.readings import other_unit
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Encoder
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.message_types import HEADER
from textile_twin_core.recordings.recorded_clock import set_back, stamps_ahead
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples
from textile_twin_core.twin.encoder_reference import Reading, Reference, reference_of

ANGLE_TOPIC = "main_shaft/angle"
SECOND_ANGLE_TOPIC = "main_shaft/second_angle"
MEASURED_TOPIC = "balancing_torque/measured"


def namespace_of(angle_topic: str) -> str:
    """The machine's namespace, which its angle's absolute topic begins with; empty for a topic of another name."""
    suffix = f"/{ANGLE_TOPIC}"
    return angle_topic.removesuffix(suffix) if angle_topic.endswith(suffix) else ""


def beside(bag: Bag, angle_topic: str, topic: str) -> str:
    """The topic of that name in the angle's own namespace where there is one, else the name as it is."""
    own = f"{namespace_of(angle_topic)}/{topic.strip('/')}"
    return own if own in bag.topics else topic


@dataclass(frozen=True)
class MachineTopics:
    """Where a recording holds a machine's shaft angle and measured torque, in which units, and if bad samples count.

    Attributes:
        angle, torque: their topics; the torque's is looked for in the angle's own namespace first.
        joint: the joint of JointState topics.
        index: pulses that tell where zero is, in the angle's own namespace first.
        angle_unit_rad, torque_unit_Nm: what one unit of each topic is.
        skip_bad: whether samples that are no numbers, or whose stamps leap ahead, are left out; else they are errors.
    """

    angle: str = ANGLE_TOPIC
    torque: str = MEASURED_TOPIC
    joint: str = "main_shaft"
    index: str | None = None
    angle_unit_rad: float = 1.0
    torque_unit_Nm: float = 1.0
    skip_bad: bool = False

    def read_angles(self, bag: Bag, encoder: Encoder) -> AngleSamples:
        """The recorded angles, as the encoder measures them; edges of its wheel (a topic of Header) are counted.

        Raises SceneError for edges that this encoder cannot count; RecordingError for an angle that is NaN or infinite
        or a stamp that leaps ahead. With `skip_bad` the shaft estimator rejects and counts these, as not finite; not a
        single finite angle is an error in any case.
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
            leap_s = (int(angles.stamps[first]) - int(angles.stamps[first + 1])) * 1e-9
            leap = f"the stamp of sample {first} is {leap_s:.3f} s later than that of the next"
            raise RecordingError(
                f"{bag.path}: topic {angles.topic}: {set_back(angles.stamps) or leap}, {len(ahead)} such of"
                f" {len(angles)}; leave them out with --skip-bad-samples"
            )
        kept = angles.angles_rad.copy()
        kept[ahead] = np.nan
        return replace(angles, angles_rad=kept)

    def read_second_angles(self, bag: Bag) -> AngleSamples | None:
        """The angles of the second encoder as it measures them; None where the recording has none."""
        topic = beside(bag, bag.find_topic(self.angle).name, SECOND_ANGLE_TOPIC)
        if topic not in bag.topics and f"/{topic}" not in bag.topics:
            return None
        seen = bag.read_angles(topic, self.joint)
        return replace(seen, angles_rad=seen.angles_rad * self.angle_unit_rad)

    def torque_in(self, bag: Bag) -> str:
        """The measured torque's topic in this recording."""
        return beside(bag, bag.find_topic(self.angle).name, self.torque)

    def read_torques(self, bag: Bag) -> TorqueSamples:
        """The measured torques; with `skip_bad` without those whose stamps leap ahead."""
        measured = bag.read_torques(self.torque_in(bag), self.joint, self.torque_unit_Nm)
        ahead = stamps_ahead(measured.stamps) if self.skip_bad else ()
        if not len(ahead):
            return measured
        kept = np.ones(len(measured), np.bool_)
        kept[ahead] = False
        return replace(measured, stamps=measured.stamps[kept], torque_Nm=measured.torque_Nm[kept])

    def _in_radians(self, bag: Bag, encoder: Encoder) -> AngleSamples:
        """The angles of the topic or of its edges, counted from zero where something tells it."""
        topic, unit = bag.find_topic(self.angle), self.angle_unit_rad
        edges = topic.msgtype == HEADER
        if edges:
            stamps = bag.read_events(self.angle)
            angles = AngleSamples(topic.name, stamps, np.zeros(len(stamps)), None)
        else:
            angles = bag.read_angles(self.angle, self.joint)
            speeds = None if angles.velocities is None else angles.velocities * unit
            angles = replace(angles, angles_rad=angles.angles_rad * unit, velocities=speeds)
        reference = reference_of(encoder, edges, self.index is not None)
        if reference is None:
            return angles
        no_pulses = np.empty(0, np.int64)
        pulses = no_pulses if self.index is None else bag.read_events(beside(bag, topic.name, self.index))
        return referred(angles, reference, pulses)


def unit_notes(angles: AngleSamples) -> list[str]:
    """What a person should know of the unit of recorded angles: a line where they look like another than radians."""
    seen = other_unit(angles.angles_rad)
    return [f"topic {angles.topic}: {seen.instead}: tell it with --angle-unit {seen.told}"] if seen else []


def referred(angles: AngleSamples, reference: Reference, pulses: IntArray) -> AngleSamples:
    """Angles as a reference tells them. Raises RecordingError when it tells none."""
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
            f"topic {angles.topic}: among {len(angles)} readings nothing told where the shaft stands: no gap of missing"
            " teeth, no index pulse"
        )
    stamps, angle, speed = zip(*known, strict=True)
    return replace(
        angles,
        stamps=np.array(stamps, np.int64),
        angles_rad=np.array(angle),
        velocities=None if angles.velocities is None else np.array(speed),
    )
