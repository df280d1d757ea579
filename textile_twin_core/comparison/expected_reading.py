"""Expected reading of the torque sensor: the predicted torque through its filter.

    measured(t) = gain * filtered(predicted)(t - delay) + offset

`reading_track` filters a whole record, whose torque is a piecewise cubic that jumps with the load (see `build_track`);
`ReadingStream` filters live predictions. Both advance the filter exactly from sample to sample.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.alignment import GAP_PERIODS, Track, build_track, usual_step
from textile_twin_core.machine import FilterSession, TorqueFilter, TorqueSensor

TURN = 2.0 * math.pi
_LONGEST_PIECE, _MOST_PARTS = 0.7, 16
"""Longest cubic of the filtered torque, in time constants of its quickest mode, and most parts of an interval."""
LONGEST_NS = 50_000_000
"""Longest step between live predictions; a longer one is a gap."""


def reading_track(
    track: Track, torque_filter: TorqueFilter, most_settling_s: float = math.inf
) -> tuple[Track, BoolArray]:
    """Filter the torque of a track.

    Args:
        track: Predicted torque over time.
        torque_filter: The filter of the sensor.
        most_settling_s: Longest time that the filter gets to settle.

    Returns:
        The track of the filtered torque, and (p,) true for the pieces in which the filter has settled since the
        start or the last gap. Behind a low pass, the torque has no discontinuities.
    """
    if torque_filter.is_identity:
        return track, np.ones(track.blocked.size, dtype=np.bool_)
    track = _refined(track, _LONGEST_PIECE * torque_filter.shortest_s)
    step = np.diff(track.edge_s)
    gap = track.blocked & (step > GAP_PERIODS * usual_step(step))
    chord = (track.end_Nm - track.start_Nm) / step
    slopes = [np.where(track.blocked, chord, slope) for slope in (track.start_slope, track.end_slope)]
    start, end, start_slope, end_slope = torque_filter.apply_to_cubics(
        step, np.stack([track.start_Nm, track.end_Nm, *slopes]), gap
    )
    begun = np.maximum.accumulate(np.where(gap, track.edge_s[1:], track.edge_s[0]))
    settled = ~gap & (track.edge_s[:-1] - begun >= min(torque_filter.settling_s, most_settling_s))
    filtered = replace(track, start_Nm=start, end_Nm=end, start_slope=start_slope, end_slope=end_slope)
    if torque_filter.is_smooth:
        filtered = replace(filtered, step_time_s=np.empty(0))
    return filtered, settled


def _refined(track: Track, longest_s: float) -> Track:
    """Divide the pieces of a track into parts of at most this length, at most 16 each; gaps stay whole."""
    step = np.diff(track.edge_s)
    count = np.where(track.blocked, 1, np.clip(np.ceil(step / longest_s), 1, _MOST_PARTS)).astype(np.int64)
    if count.max() == 1:
        return track
    piece = np.repeat(np.arange(step.size), count)
    number = np.arange(piece.size) - np.repeat(np.cumsum(count) - count, count)
    begin = track.edge_s[piece] + step[piece] * number / count[piece]
    edge = np.append(begin, track.edge_s[-1])
    start, start_slope = track.torque_at(begin, piece)
    end, end_slope = track.torque_at(edge[1:], piece)
    return replace(
        track,
        edge_s=edge,
        theta_rad=np.append(track.theta_at(begin, piece), track.theta_rad[-1]),
        start_Nm=start,
        end_Nm=end,
        start_slope=start_slope,
        end_slope=end_slope,
        after_sample=track.after_sample[piece],
        blocked=track.blocked[piece],
    )


def filtered_at(
    torque_filter: TorqueFilter,
    time_s: FloatArray,
    columns: Sequence[FloatArray],
    theta_rad: FloatArray,
    jump_angles_rad: Sequence[float],
    at_s: FloatArray,
) -> tuple[list[FloatArray], BoolArray]:
    """Filter several functions of time, each given at increasing times (n,), and interpolate them at times (m,).

    Args:
        torque_filter: The filter of the sensor.
        time_s: (n,) times of the values.
        columns: Functions, (n,) values each.
        theta_rad: (n,) unwrapped angle of the shaft.
        jump_angles_rad: Angles at which the functions may jump.
        at_s: (m,) times of the results.

    Returns:
        (m,) filtered values of each function, and true where the filter has settled and no gap lies.
    """
    found, good = [], np.ones(at_s.size, dtype=np.bool_)
    for values in columns:
        track, settled = reading_track(build_track(time_s, values, theta_rad, jump_angles_rad)[0], torque_filter)
        piece, inside = track.piece(at_s)
        good &= inside & settled[piece] & ~track.blocked[piece]
        found.append(track.torque_at(at_s, piece)[0])
    return found, good


def expected_readings(
    sensor: TorqueSensor,
    stamps_ns: IntArray,
    torque_Nm: FloatArray,
    theta_rad: FloatArray,
    jump_angles_rad: Sequence[float] = (),
) -> FloatArray:
    """Return what the sensor reads, its delay later, for torques (n,) at increasing stamps [ns]; NaN stays NaN."""
    torque_filter, out = TorqueFilter.of(sensor), np.full(torque_Nm.shape, np.nan)
    good = np.isfinite(torque_Nm) & np.isfinite(theta_rad)
    filtered = torque_Nm[good]
    if not torque_filter.is_identity and np.count_nonzero(good) > 1:
        time = np.asarray((stamps_ns[good] - stamps_ns[good][0]) * 1e-9, dtype=np.float64)
        track = build_track(time, filtered, theta_rad[good], jump_angles_rad)[0]
        track, _ = reading_track(track, torque_filter)
        filtered = track.torque_at(time, track.piece(time)[0])[0]
    out[good] = sensor.reading(filtered)
    return out


class ReadingStream:
    """Live predictions of the torque, and its filtered value at any time between them.

    The torque is linear between two predictions. Where the shaft passes an angle at which the load jumps, the slope
    before the jump holds on both of its sides.

    Args:
        torque_filter: The filter of the sensor.
        jump_angles_rad: Angles of the shaft at which the load jumps.

    Attributes:
        stamps_ns: Stamps of the predictions in memory.
    """

    def __init__(self, torque_filter: TorqueFilter, jump_angles_rad: Sequence[float] = ()) -> None:
        self._session = None if torque_filter.is_identity else torque_filter.session()
        self._settling_ns, self._jumps = torque_filter.settling_s * 1e9, not torque_filter.is_smooth
        self._jump_angles = jump_angles_rad
        self.stamps_ns: list[int] = []
        self._torques: list[float] = []
        self._thetas: list[float] = []
        self._states: list[tuple[tuple[complex, ...], float, int]] = []
        """Of the filter at each prediction: its modes, slope of the torque before [N m/ns], stamp of its start."""

    def clear(self) -> None:
        """Forget all predictions."""
        self.forget(len(self.stamps_ns))
        if self._session is not None:
            self._session.reset()

    def forget(self, first: int) -> None:
        """Drop the predictions before the one with this index."""
        del self.stamps_ns[:first], self._torques[:first], self._thetas[:first], self._states[:first]

    def add(self, stamp_ns: int, torque_Nm: float, theta_rad: float) -> float:
        """Take the next prediction and return the filtered torque there."""
        session, filtered = self._session, torque_Nm
        if session is not None:
            if self.stamps_ns and stamp_ns - self.stamps_ns[-1] <= LONGEST_NS and math.isfinite(self._torques[-1]):
                slope = self._advance(session, -1, (stamp_ns, torque_Nm, theta_rad), stamp_ns)
                self._states.append((session.behind, slope, self._states[-1][2]))
            else:
                session.restart(torque_Nm)
                self._states.append((session.behind, 0.0, stamp_ns))
            filtered = session.output
        self.stamps_ns.append(stamp_ns)
        self._torques.append(torque_Nm)
        self._thetas.append(theta_rad)
        return filtered

    def at(self, stamp_ns: int) -> tuple[float, str]:
        """Return the filtered torque at a stamp up to the last prediction; NaN with the cause where it is unknown."""
        after = bisect_left(self.stamps_ns, stamp_ns)
        before = after - 1
        exact = self.stamps_ns[after] == stamp_ns
        if not exact:
            if after == 0:
                return math.nan, "before the first prediction"
            if self.stamps_ns[after] - self.stamps_ns[before] > LONGEST_NS:
                return math.nan, "gap between predictions"
            if self._jumps and self._share_of_jump(self._thetas[before], self._thetas[after]) is not None:
                return math.nan, "load jumps there"
        if self._session is None:
            if exact:
                return self._torques[after], ""
            part = (stamp_ns - self.stamps_ns[before]) / (self.stamps_ns[after] - self.stamps_ns[before])
            return self._torques[before] * (1.0 - part) + self._torques[after] * part, ""
        if stamp_ns - self._states[after][2] < self._settling_ns:
            return math.nan, "filter has not settled"
        if exact:
            return self._session.resumed(self._torques[after], self._states[after][0]).output, ""
        session = self._session.resumed(self._torques[before], self._states[before][0])
        self._advance(session, before, (self.stamps_ns[after], self._torques[after], self._thetas[after]), stamp_ns)
        return session.output, ""

    def _advance(self, session: FilterSession, before: int, end: tuple[int, float, float], until_ns: int) -> float:
        """Advance from a prediction towards the next one, up to a stamp; return the slope of the torque."""
        begin_ns, begin_Nm, slope = self.stamps_ns[before], self._torques[before], self._states[before][1]
        end_ns, end_Nm, end_rad = end
        share = self._share_of_jump(self._thetas[before], end_rad)
        if share is None:
            slope = (end_Nm - begin_Nm) / (end_ns - begin_ns)
            session.step((until_ns - begin_ns) * 1e-9, begin_Nm + slope * (until_ns - begin_ns))
            return slope
        until, jump = float(until_ns - begin_ns), share * (end_ns - begin_ns)
        session.step(min(until, jump) * 1e-9, begin_Nm + slope * min(until, jump))
        if until > jump or until_ns == end_ns:
            session.jump(end_Nm - slope * (end_ns - begin_ns - jump))
            session.step((until - jump) * 1e-9, end_Nm - slope * (end_ns - until_ns))
        return slope

    def _share_of_jump(self, theta: float, next_theta: float) -> float | None:
        """Return the share of the way between two angles at which the load first jumps; None without a jump."""
        found = None
        for angle in self._jump_angles:
            turn, next_turn = math.floor((theta - angle) / TURN), math.floor((next_theta - angle) / TURN)
            if turn != next_turn:
                passed = angle + TURN * (turn + 1 if next_turn > turn else turn)
                share = min(max((passed - theta) / (next_theta - theta), 0.0), 1.0)
                found = share if found is None else min(found, share)
        return found
