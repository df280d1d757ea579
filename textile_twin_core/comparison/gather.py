"""From the readings of a recording to its evidence, and from that to the record of the inference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.evidence import REST_SHARE, Evidence
from textile_twin_core.comparison.motion_uncertainty import uncertain_ripple
from textile_twin_core.comparison.range_ends import at_range_ends
from textile_twin_core.comparison.readings import FEWEST_TURNS, AngleUnit, Readings
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack, shaft_track
from textile_twin_core.comparison.slips import parts_between, slips_of, without_turns
from textile_twin_core.comparison.standstill import standstills
from textile_twin_core.comparison.torque_readings import fresh_readings, step_of, stuck_readings
from textile_twin_core.inference.measurement import Hypothesis
from textile_twin_core.inference.parameter import FILTERS
from textile_twin_core.inference.priors import chain_parameters
from textile_twin_core.inference.record import MOST_SAMPLES, Record, Ripple
from textile_twin_core.machine import Encoder, Machine

LONGEST_DELAY_S = 1.0
_CONSTANT = 1e-9
"""Variation of the torque, as a share of its size, below which it is rounding."""
_LEAST_PART, _EQUAL = 0.25, 0.9
"""Share of all turns that a part without a slip must have to represent the record; share of the longest part's turns
from which an earlier part is as good."""
_FEWEST_SETTLED = 6.0
"""Fewest turns of a part whose turn beside a slip is left out."""


def hypothesis_of(machine: Machine) -> Hypothesis:
    """Hypothesis of the configured sensors, for a track of the machine's own ratio."""
    encoder, sensor = machine.sensors.encoder, machine.sensors.torque
    zero = encoder.zero_rad * encoder.direction * encoder.ratio
    filters = frozenset(p.name for p in chain_parameters(machine) if p.name in FILTERS and p.nominal)
    return Hypothesis(float(encoder.direction), sensor.gain, zero, sensor.delay_s, sensor.offset_Nm, filters=filters)


def gather(readings: Readings, machine: Machine, unit: AngleUnit, ratio: float = 1.0) -> Evidence:
    """Gather the evidence of a recording, with its angle in a unit; `ratio` multiplies the machine's own."""
    origin = int(readings.angle_stamps_ns[0])
    angle = readings.angle * unit.to_radians
    speed = None if readings.velocities is None else readings.velocities * unit.to_radians
    encoder = machine.sensors.encoder
    encoder = replace(encoder, ratio=encoder.ratio * ratio)
    track = shaft_track(readings.angle_stamps_ns, angle, speed, origin_ns=origin, encoder=encoder)
    return evidence_of(readings, track, origin, encoder, unit)


def evidence_of(readings: Readings, track: ShaftTrack, origin_ns: int, encoder: Encoder, unit: AngleUnit) -> Evidence:
    """Combine measured torque with the part of the shaft's track in which there is torque.

    Args:
        readings: of the recording. track: the shaft's motion.
        origin_ns: stamp of time 0. encoder: of the track. unit: of the logged angle.
    """
    encoder_turn = TURN * encoder.ratio
    ripple = Ripple()
    if not encoder.teeth:
        time_of_angle: FloatArray = np.asarray((readings.angle_stamps_ns - origin_ns) * 1e-9, np.float64)
        own = encoder.true_angle(readings.angle * unit.to_radians) * encoder.ratio
        ripple = uncertain_ripple(track, time_of_angle, own, encoder_turn)
    stamps = readings.torque_stamps_ns
    good = np.isfinite(readings.torque)
    good[1:] &= stamps[1:] > np.maximum.accumulate(stamps)[:-1]
    time: np.ndarray = (stamps[good] - origin_ns) * 1e-9
    _, omega, _, beside_angles = track.at(time)
    path = np.cumsum(np.where(beside_angles, np.abs(omega), 0.0) * np.diff(time, prepend=time[:1]))
    stuck = stuck_readings(readings.torque[good], path)
    stuck_Nm, stuck_s = readings.torque[good][stuck], float(np.diff(time, prepend=time[:1])[stuck].sum())
    time, good[good] = time[~stuck], ~stuck
    fresh = fresh_readings(time, readings.torque[good])
    time, good[good] = time[fresh], fresh
    fast = track.fast_rad_s
    beside = min(LONGEST_DELAY_S, 0.5 * TURN / fast) if fast > 0.0 else LONGEST_DELAY_S  # largest delay tried
    track = without_turns(track.between(time[0] - beside, time[-1] + beside), encoder_turn)
    track, slips = _unbroken(track)
    # Drift and delay differ over the time in which the shaft turns; standstills may leave little of it.
    turning = track.time_s[np.abs(track.omega_rad_s) >= REST_SHARE * fast]
    middle = 0.5 * float(turning[0] + turning[-1]) if turning.size else 0.5 * float(time[0] + time[-1])
    torque, inside = readings.torque[good], np.ones(time.size, np.bool_)
    _, omega, _, beside_angles = track.at(time)
    moving = beside_angles & (np.abs(omega) > REST_SHARE * fast)
    inside[moving] = ~at_range_ends(torque[moving])
    return Evidence(
        time[inside],
        torque[inside],
        track,
        middle,
        slips,
        torque[~inside],
        encoder_turn_rad=encoder_turn,
        ripple=ripple,
        stuck=(stuck_s, np.unique(stuck_Nm)),
    )


def _unbroken(track: ShaftTrack) -> tuple[ShaftTrack, tuple[tuple[float, float], ...]]:
    """Return the first part of a track with about the most turns between two slips of the angle, and all slips.

    A track that slips too often for a part to represent it is returned whole, without slips.
    """
    by = slips_of(track)
    parts = [_settled(track.between(*ends), track) for ends in parts_between(track)] if by.any() else []
    turns = [part.turns for part in parts]
    if not parts or max(turns) < max(_LEAST_PART * sum(turns), FEWEST_TURNS):
        return track, ()
    best = next(part for part, each in zip(parts, turns, strict=True) if each > _EQUAL * max(turns))
    slips = [(float(track.time_s[k + 1]), float(by[k])) for k in np.flatnonzero(by)]
    return best, tuple(slips)


def _settled(part: ShaftTrack, track: ShaftTrack) -> ShaftTrack:
    """Cut off the turn beside each slip, where the estimated motion has not converged."""
    if part.turns < _FEWEST_SETTLED:
        return part
    theta, keep = part.theta_rad, np.ones(part.theta_rad.size, np.bool_)
    for end, is_leap in ((0, part.time_s[0] > track.time_s[0]), (-1, part.time_s[-1] < track.time_s[-1])):
        if is_leap:
            keep &= np.abs(theta - theta[end]) >= TURN
    times = part.time_s[keep]
    return part.between(float(times[0]), float(times[-1])) if times.size else part


def unusable_reason(evidence: Evidence) -> str:
    """Reason why a recording determines no sensor setting, empty when it does."""
    track = evidence.track
    if track.turns < FEWEST_TURNS:
        still = "the shaft stands still" if track.turns < 0.02 else f"the shaft makes {track.turns:.2f} of a turn"
        return f"{still} in this recording: less than a turn determines no setting; record at working speed"
    usable = track.at(evidence.time_s)[3]
    if np.count_nonzero(usable) < 64:
        return (
            f"only {np.count_nonzero(usable)} of {usable.size} torque samples lie beside shaft angles: the stamps of"
            f" angle ({track.time_s[0]:.3f} .. {track.time_s[-1]:.3f} s) and torque ({evidence.time_s[0]:.3f} .."
            f" {evidence.time_s[-1]:.3f} s) must be of one clock"
        )
    turning = np.abs(track.at(evidence.time_s)[1]) > evidence.slow_rad_s
    if np.count_nonzero(usable & turning) < 64:
        return "the shaft hardly turns while torque is recorded; record at working speed"
    torque = evidence.torque_Nm[usable & turning]
    if float(np.ptp(torque)) <= _CONSTANT * float(np.abs(torque).max()):
        return f"the measured torque is {torque[0]:g} throughout: a dead sensor, or not connected"
    return ""


def record_of(
    evidence: Evidence,
    speed_controlled: bool = False,
    whole_turns: bool = False,
    most: int = MOST_SAMPLES,
    averaged: bool = False,
) -> Record:
    """Return the record for the inference, by samples or by block averages.

    Args:
        evidence: the record.
        speed_controlled: the torque follows the speed.
        whole_turns: averages over a turn, for a machine whose torque does not depend on the angle. A torque that
            repeats with the angle is then foreign to it, and its ripple in speed must not pass for an inertia.
        most: most samples.
        averaged: averages over a tenth of a turn.
    """
    blocks = evidence.in_blocks(whole_turns=whole_turns) if averaged or whole_turns else evidence
    turning = blocks.thinned(most)
    return Record(
        turning.time_s,
        turning.torque_Nm,
        evidence.track,
        evidence.middle_s,
        evidence.working_speed(),
        evidence.slow_rad_s,
        standstills(evidence),
        evidence.track.at_one_speed,
        speed_controlled,
        turning.block_s,
        evidence.encoder_turn_rad / TURN,
        evidence.ripple,
        evidence.predicted,
        step_of(turning.torque_Nm),
    )
