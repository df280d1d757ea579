"""The topics of one machine in a recording, and its shaft's angles as the encoder measures them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.comparison.readings import other_unit
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Encoder
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.message_types import HEADER
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples
from textile_twin_core.twin.references import Reading, Reference, reference_of

ANGLE_TOPIC = "main_shaft/angle"
MEASURED_TOPIC = "balancing_torque/measured"
SET_BACK_S = 1.0
"""Stamps that go back by more, and go on from there, are of a clock that was set back."""
_FEW = 10
MANY_LATE = 0.01  # part of the samples, from which it matters that they come after a stamp that leapt ahead


def namespace_of(angle_topic: str) -> str:
    """The machine's namespace, which its angle's absolute topic begins with; empty for a topic of another name."""
    suffix = f"/{ANGLE_TOPIC}"
    return angle_topic.removesuffix(suffix) if angle_topic.endswith(suffix) else ""


def beside(bag: Bag, angle_topic: str, topic: str) -> str:
    """The topic of that name in the angle's own namespace where there is one, else the name as it is."""
    own = f"{namespace_of(angle_topic)}/{topic.strip('/')}"
    return own if own in bag.topics else topic


def usable_angles(
    bag: Bag,
    encoder: Encoder,
    topic: str = ANGLE_TOPIC,
    joint: str = "main_shaft",
    skip_bad: bool = False,
    index_topic: str | None = None,
    unit_rad: float = 1.0,
) -> AngleSamples:
    """The recorded angles, as the encoder measures them; edges of its wheel (a topic of Header) are counted.

    index_topic: pulses that tell where zero is. unit_rad: radians of one unit of the topic.

    Raises:
        SceneError: edges that this encoder cannot count.
        RecordingError: an angle is NaN or infinite, or a stamp leaps ahead, unless `skip_bad`: the shaft estimator then
            rejects and counts it, as not finite.
            Without a single finite angle it is an error in any case.
    """
    edges = bag.find_topic(topic).msgtype == HEADER
    if edges:
        stamps = bag.read_events(topic)
        angles = AngleSamples(bag.find_topic(topic).name, stamps, np.zeros(len(stamps)), None)
    else:
        angles = in_radians(bag.read_angles(topic, joint), unit_rad)
    reference = reference_of(encoder, edges, index_topic is not None)
    if reference is not None:
        pulses = (
            np.empty(0, np.int64) if index_topic is None else bag.read_events(beside(bag, angles.topic, index_topic))
        )
        angles = referred(angles, reference, pulses)
    bad = np.flatnonzero(~np.isfinite(angles.angles_rad))
    if len(bad) == len(angles):
        raise RecordingError(f"{bag.path}: topic {angles.topic}: no angle is a finite number; check the encoder")
    if len(bad) and not skip_bad:
        first = int(bad[0])
        after_s = (int(angles.stamps[first]) - int(angles.stamps[0])) * 1e-9
        raise RecordingError(
            f"{bag.path}: topic {angles.topic}: the angle of sample {first} ({after_s:.3f} s after the first) is"
            f" {angles.angles_rad[first]}, {len(bad)} such of {len(angles)}; leave them out with --skip-bad-samples"
        )
    ahead = stamps_ahead(angles.stamps)
    if len(ahead) and not skip_bad:
        first = int(ahead[0])
        leap_s = (int(angles.stamps[first]) - int(angles.stamps[first + 1])) * 1e-9
        what = _set_back(angles.stamps) or f"the stamp of sample {first} is {leap_s:.3f} s later than that of the next"
        raise RecordingError(
            f"{bag.path}: topic {angles.topic}: {what}, {len(ahead)} such of {len(angles)}; leave them out with"
            " --skip-bad-samples"
        )
    if len(ahead):
        kept = angles.angles_rad.copy()
        kept[ahead] = np.nan
        angles = replace(angles, angles_rad=kept)
    return angles


def in_radians(angles: AngleSamples, unit_rad: float) -> AngleSamples:
    """Angles and velocities of a topic, one unit of which is so many radians."""
    if unit_rad == 1.0:
        return angles
    speeds = None if angles.velocities is None else angles.velocities * unit_rad
    return replace(angles, angles_rad=angles.angles_rad * unit_rad, velocities=speeds)


def unit_notes(angles: AngleSamples) -> list[str]:
    """What a person should know of the unit of recorded angles: a line where they look like another than radians."""
    seen = other_unit(angles.angles_rad)
    return [f"topic {angles.topic}: {seen.instead}: tell it with --angle-unit {seen.told}"] if seen else []


def usable_torques(measured: TorqueSamples, skip_bad: bool = False) -> TorqueSamples:
    """The recorded torques; with `skip_bad` without those whose stamps leap ahead, as `usable_angles` does it."""
    ahead = stamps_ahead(measured.stamps) if skip_bad else ()
    if not len(ahead):
        return measured
    kept = np.ones(len(measured), np.bool_)
    kept[ahead] = False
    return replace(measured, stamps=measured.stamps[kept], torque_Nm=measured.torque_Nm[kept])


def clock_notes(samples: AngleSamples | TorqueSamples) -> list[str]:
    """What a person should know of the stamps of recorded samples: a line where a clock was set back within them."""
    values = samples.angles_rad if isinstance(samples, AngleSamples) else samples.torque_Nm
    topic, stamps = samples.topic, samples.stamps[np.isfinite(values)]
    late = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
    if late <= MANY_LATE * len(stamps):
        return []
    what = _set_back(stamps)
    return [f"topic {topic}: {what}; {late} of {len(stamps)} are not used until it is as late again"] if what else []


def _set_back(stamps: IntArray) -> str:
    """In words where stamps (n,) go back by more than a second and go on from there; empty where they do not."""
    step = np.diff(stamps)
    at = int(np.argmin(step)) + 1
    by_s, after_s = -int(step[at - 1]) * 1e-9, (int(stamps[at - 1]) - int(stamps[0])) * 1e-9
    # A single stamp that was ahead comes back at once.
    if by_s <= SET_BACK_S or at < _FEW or len(stamps) - at < _FEW or int(stamps[at - _FEW]) < int(stamps[at]):
        return ""
    return f"a clock was set back: the stamps go back by {by_s:.3f} s at sample {at}, {after_s:.3f} s after the first"


def stamps_ahead(stamps: IntArray) -> IntArray:
    """Samples whose stamps leap ahead of later ones, where without them many fewer come too late: (m,) indices.

    A clock that was wrong for one sample would otherwise cost all samples until it is that time.
    """
    late = np.count_nonzero(stamps < np.maximum.accumulate(stamps))
    ahead = np.flatnonzero(stamps > np.minimum.accumulate(stamps[::-1])[::-1])
    return ahead if len(ahead) < late and late > MANY_LATE * len(stamps) else ahead[:0]


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
