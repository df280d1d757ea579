"""The prediction as a function of time: interpolation that never crosses a gap or a jump of the load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.errors import TwinError

TWO_PI = 2.0 * np.pi

#: An event is a jump when the prediction steps over it this many times further than over its neighbours.
JUMP_RATIO = 5.0

#: Two predictions further apart than this many median periods have a gap between them.
GAP_PERIODS = 5.0


class AlignmentError(TwinError):
    """Measured and predicted torque cannot be brought onto one time axis."""


@dataclass(frozen=True, slots=True)
class Track:
    """A predicted torque over time, cut where it may not be interpolated.

    Attributes:
        time_s: (n,) strictly increasing, seconds from an origin the caller keeps.
        torque_Nm: (n,) predictions.
        theta_rad: (n,) shaft angle, unwrapped.
        slope_Nm_s: (n,) derivative of the torque, each from its own side of every cut.
        gap: (n - 1,) whether the interval after sample k is a gap.
        jump: (n - 1,) whether the load jumps in the interval after sample k.
        jump_time_s: (j,) the instants of the jumps, increasing.
    """

    time_s: FloatArray
    torque_Nm: FloatArray
    theta_rad: FloatArray
    slope_Nm_s: FloatArray
    gap: BoolArray
    jump: BoolArray
    jump_time_s: FloatArray

    def interval(self, time_s: FloatArray) -> tuple[IntArray, BoolArray]:
        """Index of the interval that holds each time (m,), and whether there is one."""
        index = np.searchsorted(self.time_s, time_s, side="right") - 1
        inside = (index >= 0) & (time_s <= self.time_s[-1])
        return np.clip(index, 0, self.time_s.size - 2).astype(np.int64), inside

    def torque_at(self, time_s: FloatArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
        """Torque [N m] and its derivative [N m/s] at times (m,) in the intervals `index`: cubic Hermite."""
        step = self.time_s[index + 1] - self.time_s[index]
        u = (time_s - self.time_s[index]) / step
        start, end = self.torque_Nm[index], self.torque_Nm[index + 1]
        # Newton form on the interval: chord, then the two slopes' departures from it.
        secant = (end - start) / step
        first = self.slope_Nm_s[index] - secant
        last = self.slope_Nm_s[index + 1] - secant
        v = 1.0 - u
        torque = start + step * (u * secant + u * v * (v * first - u * last))
        slope = secant + v * (1.0 - 3.0 * u) * first + u * (3.0 * u - 2.0) * last
        return torque, slope

    def theta_at(self, time_s: FloatArray, index: IntArray) -> FloatArray:
        """Shaft angle [rad] at times (m,), linear between samples."""
        u = (time_s - self.time_s[index]) / (self.time_s[index + 1] - self.time_s[index])
        return self.theta_rad[index] * (1.0 - u) + self.theta_rad[index + 1] * u

    def near_jump(self, time_s: FloatArray, index: IntArray, guard_s: float) -> BoolArray:
        """Whether each time lies between two predictions that a jump parts, or within `guard_s` of a jump."""
        near = self.jump[index]
        if self.jump_time_s.size and guard_s > 0.0:
            after = np.searchsorted(self.jump_time_s, time_s)
            for k in (after - 1, after):
                k = np.clip(k, 0, self.jump_time_s.size - 1)
                near |= np.abs(self.jump_time_s[k] - time_s) <= guard_s
        return near


def build_track(
    time_s: FloatArray, torque_Nm: FloatArray, theta_rad: FloatArray, event_angles_rad: Sequence[float]
) -> tuple[Track, tuple[bool, ...]]:
    """Build the track of (n,) predictions, n >= 2, and tell which of the events are jumps of the torque.

    An event angle is passed where the shaft angle crosses it, in either direction. It is a jump when the
    median step of the torque over it exceeds `JUMP_RATIO` times the median step over the neighbouring
    intervals: the needle's entry into the backing is one, its turning point is not.
    """
    step = np.diff(time_s)
    gap = step > GAP_PERIODS * float(np.median(step))
    jump = np.zeros(step.size, dtype=np.bool_)
    times: list[FloatArray] = []
    jumps: list[bool] = []
    for angle in event_angles_rad:
        turn = np.floor((theta_rad - angle) / TWO_PI)
        crossing = np.flatnonzero((np.diff(turn) != 0.0) & ~gap)
        is_jump = _steps_over(torque_Nm, crossing)
        jumps.append(is_jump)
        if is_jump:
            jump[crossing] = True
            level = angle + TWO_PI * np.maximum(turn[crossing], turn[crossing + 1])
            part = (level - theta_rad[crossing]) / (theta_rad[crossing + 1] - theta_rad[crossing])
            times.append(time_s[crossing] + np.clip(part, 0.0, 1.0) * step[crossing])
    jump_time = np.sort(np.concatenate(times)) if times else np.empty(0)
    slope = _slopes(step, torque_Nm, gap | jump)
    return Track(time_s, torque_Nm, theta_rad, slope, gap, jump, jump_time), tuple(jumps)


def _steps_over(torque_Nm: FloatArray, crossing: IntArray) -> bool:
    """Whether the torque typically steps in the intervals `crossing`, more than beside them."""
    inner = crossing[(crossing >= 1) & (crossing + 2 < torque_Nm.size)]
    if inner.size == 0:
        return False
    across = np.abs(torque_Nm[inner + 1] - torque_Nm[inner])
    before = np.abs(torque_Nm[inner] - torque_Nm[inner - 1])
    after = np.abs(torque_Nm[inner + 2] - torque_Nm[inner + 1])
    floor = 1e-6 * float(np.max(np.abs(torque_Nm)))
    return bool(np.median(across) > JUMP_RATIO * max(float(np.median(np.maximum(before, after))), floor))


def _slopes(step: FloatArray, torque_Nm: FloatArray, cut: BoolArray) -> FloatArray:
    """Derivative at each sample: three-point parabola, taken from one side beside a cut."""
    n = torque_Nm.size
    secant = np.diff(torque_Nm) / step
    slope = np.zeros(n)
    open_left, open_right = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    open_left[1:], open_right[:-1] = ~cut, ~cut
    inner = np.flatnonzero(open_left & open_right)
    left, right = step[inner - 1], step[inner]
    slope[inner] = (right * secant[inner - 1] + left * secant[inner]) / (left + right)
    is_inner = open_left & open_right
    # The parabola through the three outermost samples has end slope 2 secant - next slope.
    for ends, neighbour, interval in (
        (np.flatnonzero(open_right & ~open_left), 1, 0),
        (np.flatnonzero(open_left & ~open_right), -1, -1),
    ):
        chord = secant[ends + interval]
        slope[ends] = np.where(is_inner[ends + neighbour], 2.0 * chord - slope[ends + neighbour], chord)
    return slope


def largest_distance_ns(measured_ns: IntArray, predicted_ns: IntArray) -> int:
    """The largest distance in time from a measured sample (m,) to the nearest prediction (n,) [ns]."""
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
