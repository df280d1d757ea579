"""Predicted torque of a recording: recomputed from its shaft angles, or as published by the live twin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.readings import SecondAngle
from textile_twin_core.comparison.shaft_track import ShaftTrack, track_of
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.machine_topics import SECOND_ANGLE_TOPIC, MachineTopics, beside
from textile_twin_core.recordings.predicted_topics import TORQUE
from textile_twin_core.recordings.recorded_clock import one_record
from textile_twin_core.recordings.recording import Progress
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples
from textile_twin_core.twin import Samples, Session, compile_machine
from textile_twin_core.twin.session import has_second_encoder

_BLOCK = 8192
_OTHER_MACHINE = 0.05
"""Median difference of predictions, over the peak, that indicates another machine."""


@dataclass(frozen=True)
class PredictedTorque:
    """Predictions in order of time; arrays of shape (n,).

    Attributes:
        stamps_ns: Stamps [ns].
        torque_Nm: Predicted torque [N m].
        theta_rad: Shaft angle [rad].
        sigma_Nm: Standard deviation [N m]; NaN where unknown.
        settled: True where the shaft estimator has converged.
        rejected: Number of angle samples without a prediction, by cause.
        notes: Remarks on the numbers for the reader.
        track: Motion of the shaft if the whole record was smoothed; None otherwise.
    """

    stamps_ns: IntArray
    torque_Nm: FloatArray
    theta_rad: FloatArray
    sigma_Nm: FloatArray
    settled: BoolArray
    rejected: Mapping[str, int]
    notes: tuple[str, ...] = ()
    track: ShaftTrack | None = None


def second_angles(topics: MachineTopics, bag: Bag, machine: AnyMachine) -> tuple[SecondAngle | None, tuple[str, ...]]:
    """Read the second encoder's angles if machine and recording have one, with a note if the recording lacks them."""
    if not has_second_encoder(machine):
        return None, ()
    seen = topics.read_second_angles(bag)
    if seen is None:
        return None, (f"the recording has no topic {SECOND_ANGLE_TOPIC}: the second encoder is not used",)
    return SecondAngle(seen.stamps, seen.angles_rad), ()


def predictions(
    session: Session, angles: AngleSamples, progress: Progress | None = None, second: SecondAngle | None = None
) -> Iterator[Samples]:
    """Process recorded angles in a session and yield the predictions, block by block.

    Args:
        session: The session.
        angles: Angles of the encoder.
        progress: Is called with the number of samples of each block.
        second: Angles of a second encoder.

    Raises:
        RecordingError: There is not a single prediction.
    """
    some = False
    if second is not None:
        session.take_second(second.stamps_ns, second.angle)
    for start in range(0, len(angles), _BLOCK):
        part = slice(start, start + _BLOCK)
        velocities = None if angles.velocities is None else angles.velocities[part]
        samples = session.step(angles.stamps[part], angles.angles_rad[part], velocities)
        if progress is not None:
            progress(len(angles.stamps[part]))
        if len(samples):
            some = True
            yield samples
    last = session.finish()
    if len(last):
        yield last
    elif not some:
        raise RecordingError(f"topic {angles.topic}: too few samples for a prediction; {session.report.text()}")


def recompute(
    angles: AngleSamples,
    machine: Machine,
    shaft: str = "smooth",
    progress: Progress | None = None,
    second: SecondAngle | None = None,
    **shaft_settings: float,
) -> PredictedTorque:
    """Predict the torque from recorded angles, and those of a second encoder, with the named shaft estimator."""
    session = compile_machine(machine, [TORQUE]).session(shaft, **shaft_settings)
    received, angles = len(angles), one_record(angles)
    blocks = list(predictions(session, angles, progress, second))
    track, encoder = None, machine.sensors.encoder
    if shaft == "smooth":
        states = [block.states for block in blocks]
        track = track_of(states, int(angles.stamps[0]), encoder.direction, encoder.zero_rad * encoder.ratio)
        track = replace(track, slips=session.report.jumps)
    rejected = session.report.rejected
    return PredictedTorque(
        stamps_ns=np.concatenate([np.asarray(block.stamps, np.int64) for block in blocks]),
        torque_Nm=np.concatenate([block[TORQUE] for block in blocks]),
        theta_rad=np.concatenate([block.theta_rad for block in blocks]),
        sigma_Nm=np.concatenate([block.torque_sigma_Nm for block in blocks]),
        settled=np.concatenate([block.settled for block in blocks]),
        rejected={**rejected, "older_stamp": rejected["older_stamp"] + received - len(angles)},
        track=track,
    )


def recorded_torque(
    bag: Bag, computed: PredictedTorque, angle_topic: str, times: tuple[IntArray, IntArray] | None = None
) -> PredictedTorque:
    """Read the torque that the live twin published into the recording, beside the topic of the shaft angle.

    Shaft angles and convergence of the estimator come from `computed`, matched by the stamps that a prediction shares
    with its angle sample. A note warns of predictions far from the computed ones.

    Args:
        bag: The recording.
        computed: Predictions from the recorded angles.
        angle_topic: Topic of the angles.
        times: Stamps of the angles as recorded, and the reconstructed ones if the stamps came in bursts.

    Returns:
        The published predictions.

    Raises:
        RecordingError: No stamp is shared.
    """

    def retimed(samples: TorqueSamples) -> TorqueSamples:
        if times is None:
            return samples
        place = np.minimum(np.searchsorted(times[0], samples.stamps), times[1].size - 1)
        return replace(samples, stamps=times[1][place])

    torque = retimed(bag.read_torques(beside(bag, angle_topic, "balancing_torque/predicted")))
    sigma_topic = beside(bag, angle_topic, "balancing_torque/predicted_sigma")
    place = np.clip(np.searchsorted(computed.stamps_ns, torque.stamps), 0, len(computed.stamps_ns) - 1)
    shared = computed.stamps_ns[place] == torque.stamps
    if not shared.any():
        raise RecordingError(f"{bag.path}: no prediction on {torque.topic} has the stamp of a recorded shaft angle")
    sigma = np.full(len(torque), np.nan)
    if bag.has_topic(sigma_topic):
        published = retimed(bag.read_torques(sigma_topic))
        order = np.argsort(published.stamps, kind="stable")
        at = np.clip(np.searchsorted(published.stamps[order], torque.stamps), 0, len(published) - 1)
        same = published.stamps[order][at] == torque.stamps
        sigma[same] = published.torque_Nm[order][at][same]
    return PredictedTorque(
        stamps_ns=torque.stamps[shared],
        torque_Nm=torque.torque_Nm[shared],
        theta_rad=computed.theta_rad[place[shared]],
        sigma_Nm=sigma[shared],
        settled=computed.settled[place[shared]],
        rejected={**computed.rejected, "without_prediction": int(np.count_nonzero(~shared))},
        notes=far_apart(torque.torque_Nm[shared], computed.torque_Nm[place[shared]], computed.settled[place[shared]]),
    )


def far_apart(recorded_Nm: FloatArray, computed_Nm: FloatArray, settled: BoolArray) -> tuple[str, ...]:
    """Warn if recorded predictions cannot be of this machine: the median difference is too large for steps of
    the load alone.
    """
    good = settled & np.isfinite(recorded_Nm) & np.isfinite(computed_Nm)
    peak = float(np.max(np.abs(computed_Nm[good]), initial=0.0))
    if peak == 0.0:
        return ()
    apart = float(np.median(np.abs(recorded_Nm - computed_Nm)[good]))
    if apart <= _OTHER_MACHINE * peak:
        return ()
    return (
        f"half of the recorded predictions differ by more than {apart:.3g} N m from those of this machine, whose peak "
        f"is {peak:.3g} N m: they were recorded with another machine or other parameters",
    )
