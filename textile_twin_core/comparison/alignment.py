"""Predicted torque as a function of time, interpolated without crossing a gap or an event of the load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray

TWO_PI = 2.0 * np.pi

#: The torque is discontinuous at an event where its step is this many times the steps beside the event.
STEP_RATIO = 5.0

#: Two predictions or states further apart than this many usual steps (see `usual_step`) have a gap between them.
GAP_PERIODS = 5.0
_LONGEST_STEP_S = 0.25
_PART = 65_536
_CREEPS = 0.005


def parts(n: int) -> Iterator[slice]:
    """Yield slices that cover n samples, so that temporary arrays of a long record stay small."""
    return (slice(start, start + _PART) for start in range(0, n, _PART))


def usual_step(step_s: FloatArray) -> float:
    """Usual step [s] of (n,) steps between samples: the median, or the mean where samples come in bursts."""
    short = step_s[step_s <= _LONGEST_STEP_S]
    return max(float(np.median(step_s)), float(np.mean(short)) if short.size else 0.0)


def fast_speed(omega_rad_s: FloatArray) -> float:
    """95th percentile of the speeds (n,) [rad/s] while the shaft turns, standstill left out; 0 if it never turns."""
    size = np.abs(omega_rad_s[np.isfinite(omega_rad_s)])
    turning = size[size > _CREEPS * np.percentile(size, 99.9)] if size.size else size
    return float(np.percentile(turning, 95.0)) if turning.size else 0.0


@dataclass(frozen=True, slots=True)
class Track:
    """Predicted torque over time: one cubic per piece; a piece ends at each sample and at each event.

    On each side of an event the torque is extrapolated to the event's instant by the parabola through the three
    nearest samples of that side. This smooths neither a discontinuity (the needle enters the backing) nor a kink
    (the needle turns, and friction with it).

    Attributes:
        edge_s: (p + 1,) ends of the pieces, increasing, in seconds from the caller's origin.
        theta_rad: (p + 1,) unwrapped shaft angle there.
        start_Nm, end_Nm, start_slope, end_slope: (p,) torque [N m] and slope [N m/s] at each piece's ends.
        after_sample: (p,) the prediction at or before each piece.
        blocked: (p,) true in gaps and in intervals with more than one event: no interpolation there.
        step_time_s: (j,) instants of the discontinuities of the torque, increasing.
    """

    edge_s: FloatArray
    theta_rad: FloatArray
    start_Nm: FloatArray
    end_Nm: FloatArray
    start_slope: FloatArray
    end_slope: FloatArray
    after_sample: IntArray
    blocked: BoolArray
    step_time_s: FloatArray

    def piece(self, time_s: FloatArray) -> tuple[IntArray, BoolArray]:
        """Return the index of the piece at each time (m,), and true where the time lies within the track."""
        index = np.searchsorted(self.edge_s, time_s, side="right").astype(np.int64, copy=False)
        index -= 1
        inside = (index >= 0) & (time_s <= self.edge_s[-1])
        return np.clip(index, 0, self.edge_s.size - 2, out=index), inside

    def torque_at(self, time_s: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
        """Torque [N m] and its derivative [N m/s] at times (m,) in their pieces: cubic Hermite."""
        torque, slope = np.empty(time_s.size), np.empty(time_s.size)
        for part in parts(time_s.size):
            torque[part], slope[part] = self._torque_at(time_s[part], piece[part])
        return torque, slope

    def _torque_at(self, time_s: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
        step = self.edge_s[piece + 1] - self.edge_s[piece]
        u = (time_s - self.edge_s[piece]) / step
        v = 1.0 - u
        # The chord, then the differences of the two end slopes from it.
        chord = (self.end_Nm[piece] - self.start_Nm[piece]) / step
        first = self.start_slope[piece] - chord
        last = self.end_slope[piece] - chord
        torque = self.start_Nm[piece] + step * (u * chord + u * v * (v * first - u * last))
        slope = chord + v * (1.0 - 3.0 * u) * first + u * (3.0 * u - 2.0) * last
        return torque, slope

    def theta_at(self, time_s: FloatArray, piece: IntArray) -> FloatArray:
        """Shaft angle [rad] at times (m,), linear between samples."""
        theta = np.empty(time_s.size)
        for part in parts(time_s.size):
            here = piece[part]
            u = (time_s[part] - self.edge_s[here]) / (self.edge_s[here + 1] - self.edge_s[here])
            theta[part] = self.theta_rad[here] * (1.0 - u) + self.theta_rad[here + 1] * u
        return theta

    def near_step(self, time_s: FloatArray, guard_s: float) -> BoolArray:
        """Return true for each time (m,) within `guard_s` of a discontinuity of the torque."""
        near = np.zeros(time_s.size, dtype=np.bool_)
        for part in parts(time_s.size if self.step_time_s.size else 0):
            after = np.searchsorted(self.step_time_s, time_s[part])
            for k in (after - 1, after):
                jump = self.step_time_s[np.clip(k, 0, self.step_time_s.size - 1)]
                near[part] |= np.abs(jump - time_s[part]) <= guard_s
        return near


def build_track(
    time_s: FloatArray, torque_Nm: FloatArray, theta_rad: FloatArray, event_angles_rad: Sequence[float]
) -> tuple[Track, tuple[bool, ...]]:
    """Build the track of (n,) predictions, n >= 2; also return for each event whether the torque is discontinuous.

    The shaft passes an event where its angle crosses the event's, in either direction. The torque is discontinuous
    there if its median step exceeds `STEP_RATIO` times the median step of the neighbouring intervals, as at
    the needle's entry into the backing, but not at its turning point.
    """
    step = np.diff(time_s)
    gap = step > GAP_PERIODS * usual_step(step)
    found: list[tuple[IntArray, FloatArray, bool]] = []
    for angle in event_angles_rad:
        turn = np.floor((theta_rad - angle) / TWO_PI)
        crossing = np.flatnonzero((np.diff(turn) != 0.0) & ~gap)
        level = angle + TWO_PI * np.maximum(turn[crossing], turn[crossing + 1])
        part = (level - theta_rad[crossing]) / (theta_rad[crossing + 1] - theta_rad[crossing])
        instant = time_s[crossing] + np.clip(part, 0.0, 1.0) * step[crossing]
        found.append((crossing, instant, _steps_over(torque_Nm, crossing)))
    jumps = tuple(jump for *_, jump in found)
    crossing = np.concatenate([np.empty(0, dtype=np.int64), *(place for place, *_ in found)])
    instant = np.concatenate([np.empty(0), *(when for _, when, _ in found)])
    is_step = np.concatenate([np.empty(0, dtype=np.bool_), *(np.full(place.size, jump) for place, _, jump in found)])
    jump_time = np.sort(instant[is_step])
    events_in = np.bincount(crossing, minlength=step.size)
    blocked = gap | (events_in > 1)
    whole = (events_in[crossing] == 1) & (instant > time_s[crossing]) & (instant < time_s[crossing + 1])
    order = np.flatnonzero(whole)[np.argsort(instant[whole])]
    return _cut(
        time_s, torque_Nm, theta_rad, blocked, (crossing[order], instant[order], is_step[order]), jump_time
    ), jumps


def _steps_over(torque_Nm: FloatArray, crossing: IntArray) -> bool:
    """Return true if the torque steps in the intervals `crossing` much more than in those beside them."""
    inner = crossing[(crossing >= 1) & (crossing + 2 < torque_Nm.size)]
    if inner.size == 0:
        return False
    across = np.abs(torque_Nm[inner + 1] - torque_Nm[inner])
    before = np.abs(torque_Nm[inner] - torque_Nm[inner - 1])
    after = np.abs(torque_Nm[inner + 2] - torque_Nm[inner + 1])
    floor = 1e-6 * float(np.max(np.abs(torque_Nm)))
    return bool(np.median(across) > STEP_RATIO * max(float(np.median(np.maximum(before, after))), floor))


def _cut(
    time_s: FloatArray,
    torque_Nm: FloatArray,
    theta_rad: FloatArray,
    blocked: BoolArray,
    events: tuple[IntArray, FloatArray, BoolArray],
    step_time_s: FloatArray,
) -> Track:
    """Cut intervals at the events (interval, instant, discontinuous or not), at most one event in each."""
    crossing, instant, is_step = events
    closed = blocked.copy()
    closed[crossing] = True
    slope, curve_before, curve_after = _slopes(np.diff(time_s), torque_Nm, closed)

    # From each side to the event, by the parabola of that side.
    ahead, back = instant - time_s[crossing], instant - time_s[crossing + 1]
    left = torque_Nm[crossing] + ahead * (slope[crossing] + ahead * curve_before[crossing])
    right = torque_Nm[crossing + 1] + back * (slope[crossing + 1] + back * curve_after[crossing + 1])
    left_slope = slope[crossing] + 2.0 * ahead * curve_before[crossing]
    right_slope = slope[crossing + 1] + 2.0 * back * curve_after[crossing + 1]
    middle = 0.5 * (left + right)  # at a kink both sides have the same torque
    left, right = np.where(is_step, left, middle), np.where(is_step, right, middle)

    sample = np.arange(time_s.size - 1)
    after_sample = np.sort(np.concatenate([sample, crossing]))
    first = np.searchsorted(after_sample, crossing)  # the piece before each event; the one after follows
    starts_at_event = np.zeros(after_sample.size, dtype=np.bool_)
    starts_at_event[first + 1] = True
    start_Nm, start_slope = torque_Nm[after_sample].copy(), slope[after_sample].copy()
    end_Nm, end_slope = torque_Nm[after_sample + 1].copy(), slope[after_sample + 1].copy()
    end_Nm[first], end_slope[first] = left, left_slope
    start_Nm[first + 1], start_slope[first + 1] = right, right_slope
    edge = time_s[np.append(after_sample, time_s.size - 1)]
    theta = theta_rad[np.append(after_sample, time_s.size - 1)]
    edge[first + 1] = instant
    part = ahead / (time_s[crossing + 1] - time_s[crossing])
    theta[first + 1] = theta_rad[crossing] + part * (theta_rad[crossing + 1] - theta_rad[crossing])
    return Track(
        edge_s=edge,
        theta_rad=theta,
        start_Nm=start_Nm,
        end_Nm=end_Nm,
        start_slope=start_slope,
        end_slope=end_slope,
        after_sample=after_sample,
        blocked=blocked[after_sample],
        step_time_s=step_time_s,
    )


def _slopes(step: FloatArray, torque_Nm: FloatArray, closed: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivative at each sample, and half the second derivative of the parabola before and after it.

    Parabolas through three samples, one-sided beside a closed interval; a line through two samples alone.
    """
    n = torque_Nm.size
    secant = np.diff(torque_Nm) / step
    slope = np.zeros(n)
    open_left, open_right = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    open_left[1:], open_right[:-1] = ~closed, ~closed
    inner = open_left & open_right
    at = np.flatnonzero(inner)
    before, after = step[at - 1], step[at]
    slope[at] = (after * secant[at - 1] + before * secant[at]) / (before + after)
    # The parabola through the three outermost samples has end slope 2 chord - next slope.
    for ends, to_neighbour, to_interval in (
        (np.flatnonzero(open_right & ~open_left), 1, 0),
        (np.flatnonzero(open_left & ~open_right), -1, -1),
    ):
        chord = secant[ends + to_interval]
        slope[ends] = np.where(inner[ends + to_neighbour], 2.0 * chord - slope[ends + to_neighbour], chord)
    curve_before, curve_after = np.zeros(n), np.zeros(n)
    at = np.flatnonzero(open_left)
    curve_before[at] = (slope[at] - secant[at - 1]) / step[at - 1]
    at = np.flatnonzero(open_right)
    curve_after[at] = (secant[at] - slope[at]) / step[at]
    return slope, curve_before, curve_after


def largest_distance_ns(measured_ns: IntArray, predicted_ns: IntArray) -> int:
    """Largest distance in time from a measured sample (m,) to the nearest prediction (n,) [ns]."""
    after = np.clip(np.searchsorted(predicted_ns, measured_ns), 1, predicted_ns.size - 1)
    to_before = np.abs(predicted_ns[after - 1] - measured_ns)
    return int(np.max(np.minimum(to_before, np.abs(predicted_ns[after] - measured_ns))))


def time_ranges(measured_ns: IntArray, predicted_ns: IntArray) -> str:
    """Both time ranges [s] and the largest distance between them, for an error's one line."""
    distance = largest_distance_ns(measured_ns, predicted_ns) * 1e-9
    return (
        f"measured {_range(measured_ns)}, predicted {_range(predicted_ns)}, "
        f"largest distance from a measured sample to the nearest prediction {distance:.6g} s"
    )


def _range(stamps_ns: IntArray) -> str:
    first, last = int(stamps_ns[0]), int(stamps_ns[-1])
    return f"{first // 10**9}.{first % 10**9:09d} .. {last // 10**9}.{last % 10**9:09d} s"
