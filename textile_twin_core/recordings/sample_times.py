"""Times of recorded samples stamped in bursts: reconstructed even times, or an error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.comparison.stamp_timing import StampTiming
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples
from textile_twin_core.shaft.sample_clock import EvenTimes, StampBursts, even_times, find_bursts, sampling_period

_ONE_BRIDGE = 0.05
"""Largest relative difference of the burst periods of two topics on one bridge."""


def evenly_timed(
    angles: AngleSamples, measured: TorqueSamples, machine: AnyMachine
) -> tuple[AngleSamples, TorqueSamples, list[StampTiming]]:
    """Replace burst stamps by even times, and return the samples with the properties of these times.

    Raises:
        RecordingError: Stamps come in bursts and the samples were not taken evenly.
    """
    timings: list[StampTiming] = []
    bursts = None if machine.sensors.encoder.teeth else find_bursts(angles.stamps, uneven=True)
    torque_bursts = find_bursts(measured.stamps, uneven=True)
    if bursts is None and torque_bursts is None:
        return angles, measured, timings
    bridge = None
    if bursts and torque_bursts and abs(bursts.period_s / torque_bursts.period_s - 1.0) < _ONE_BRIDGE:
        bridge = np.sort(np.concatenate([angles.stamps, measured.stamps]))
    if bursts is not None:
        found = even_times(angles.stamps, angles.angles_rad, angles=True, bridge_ns=bridge)
        if found is not None:
            recorded = angles.stamps
            angles = replace(angles, stamps=_checked(found, angles.topic, timings), recorded_ns=recorded)
            angles = replace(angles, timing=timings[-1])
    if torque_bursts is not None:
        period = timings[0].period_s if timings else sampling_period(angles.stamps)
        found = even_times(measured.stamps, measured.torque_Nm, angles=False, period_s=period, bridge_ns=bridge)
        if found is not None:
            measured = replace(measured, stamps=_checked(found, measured.topic, timings), timing=timings[-1])
    return angles, measured, timings


def evenly_timed_angles(angles: AngleSamples, machine: AnyMachine) -> tuple[AngleSamples, list[StampTiming]]:
    """Replace burst stamps of angles by even times; raises as `evenly_timed`."""
    none = TorqueSamples("", np.empty(0, np.int64), np.empty(0))
    angles, _, timings = evenly_timed(angles, none, machine)
    return angles, timings


def _checked(found: EvenTimes | StampBursts, topic: str, timings: list[StampTiming]) -> IntArray:
    """Return the reconstructed times [ns] and add them to `timings`.

    Raises:
        RecordingError: The times cannot be reconstructed.
    """
    if isinstance(found, StampBursts):
        raise RecordingError(
            f"topic {topic}: the stamps come in bursts, {found.text}, and the samples have no even clock: their"
            " times are unknown; stamp them where they are taken"
        )
    timings.append(StampTiming(topic, found.bursts, found.period_s, found.half_width_s))
    return found.times_ns
