"""Measured minus predicted torque, sample by sample, from two live streams."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.expected_reading import ReadingStream
from textile_twin_core.machine import Machine, TorqueFilter, TorqueSensor
from textile_twin_core.twin.restart import BACK_NS, RestartWatch
from textile_twin_core.twin.session import AnyTwin

_RECENT = 1000
_PROBES = 64
_BESIDE_RAD = 1e-7
_JUMP_OVER_PEAK = 1e-4


@dataclass(frozen=True, slots=True)
class Residual:
    """One residual: measured less expected reading of the sensor, at the stamp of the measured sample."""

    stamp_ns: int
    residual_Nm: float


@dataclass
class ResidualStream:
    """Pairs of a stream of measured torques and a stream of predictions, in any order of arrival.

    The prediction at `stamp - delay` is interpolated linearly between its two neighbours, and passes the filter of the
    sensor. No residual is given over a gap, while the filter settles, where the prediction is not finite, or over a
    discontinuity of the reading (the needle enters the backing, and no low pass smooths it). Such samples are counted
    in `skipped`, by cause.

    Args:
        sensor: the torque sensor.
        jump_angles_rad: shaft angles at which the predicted torque is discontinuous.
        memory_s: how long a prediction, or a measured sample, waits for its counterpart.
    """

    sensor: TorqueSensor
    jump_angles_rad: Sequence[float] = ()
    memory_s: float = 30.0
    given: int = 0
    skipped: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all samples and counts."""
        self._predictions = ReadingStream(TorqueFilter.of(self.sensor), self.jump_angles_rad)
        self._stamps = self._predictions.stamps_ns
        self._waiting: deque[tuple[int, float]] = deque()
        self._recent: deque[float] = deque(maxlen=_RECENT)
        self._delay_ns = round(self.sensor.delay_s * 1e9)
        self._last_measured_ns: int | None = None
        self._restarts = RestartWatch()
        self.given = 0
        self.skipped.clear()

    @property
    def rms_Nm(self) -> float:
        """Root mean square of the latest residuals (up to 1000), nan without any."""
        if not self._recent:
            return math.nan
        return math.sqrt(math.fsum(value * value for value in self._recent) / len(self._recent))

    @property
    def apart_s(self) -> float:
        """Lead of the newest measured torque over the newest prediction [s], nan without both."""
        if self._last_measured_ns is None or not self._stamps:
            return math.nan
        return (self._last_measured_ns - self._delay_ns - self._stamps[-1]) * 1e-9

    def predicted(
        self, stamps_ns: Iterable[int], torques_Nm: Iterable[float], thetas_rad: Iterable[float]
    ) -> list[Residual]:
        """Take predictions and return the residuals that they complete.

        Stamps increase; predictions of a call that begins before the last one are those of a clock that was set back.
        """
        stamps = list(stamps_ns)
        if stamps and self._stamps and stamps[0] <= self._stamps[-1]:
            self._predictions.clear()
            if self._last_measured_ns is not None and self._last_measured_ns > stamps[0] + BACK_NS:
                self._last_measured_ns = None  # the torque's clock is to be set back yet
                self._waiting.clear()
        for stamp, torque, theta in zip(stamps, torques_Nm, thetas_rad, strict=True):
            self._predictions.add(stamp, torque, theta)
        ready = []
        while self._waiting and self._stamps and self._stamps[-1] >= self._waiting[0][0] - self._delay_ns:
            ready += self._residual(*self._waiting.popleft())
        self._forget()
        return ready

    def measured(self, stamp_ns: int, torque_Nm: float) -> list[Residual]:
        """Take one measured torque [N m] and return its residual if its prediction is known."""
        if not math.isfinite(torque_Nm):
            self.skipped["not finite"] += 1
            return []
        if self._restarts.restarted(stamp_ns):  # the sensor's clock was set back, or had been ahead
            self._last_measured_ns = None
            self._waiting.clear()
            if self._stamps and self._stamps[-1] > stamp_ns + BACK_NS:  # the angle's is to be set back yet
                self._predictions.clear()
        if self._last_measured_ns is not None and stamp_ns <= self._last_measured_ns:
            self.skipped["stamp not after the one before"] += 1
            return []
        self._last_measured_ns = stamp_ns
        if self._waiting or not self._stamps or self._stamps[-1] < stamp_ns - self._delay_ns:
            self._waiting.append((stamp_ns, torque_Nm))
            self._forget()
            return []
        return self._residual(stamp_ns, torque_Nm)

    def _residual(self, stamp_ns: int, torque_Nm: float) -> list[Residual]:
        predicted, cause = self._predictions.at(stamp_ns - self._delay_ns)
        if not cause and not math.isfinite(predicted):
            cause = "prediction is not finite"
        if cause:
            self.skipped[cause] += 1
            return []
        residual = torque_Nm - self.sensor.reading(predicted)
        self.given += 1
        self._recent.append(residual)
        return [Residual(stamp_ns, residual)]

    def _forget(self) -> None:
        """Keep `memory_s` of both streams; count the measured samples dropped without a prediction."""
        memory_ns = round(self.memory_s * 1e9)
        while self._waiting and self._waiting[-1][0] - self._waiting[0][0] > memory_ns:
            self._waiting.popleft()
            self.skipped["no prediction came"] += 1
        # At twice the memory, so that the lists are seldom cut.
        if self._stamps and self._stamps[-1] - self._stamps[0] > 2 * memory_ns:
            first = bisect_left(self._stamps, self._stamps[-1] - memory_ns)
            self._predictions.forget(first)


def load_steps(twin: AnyTwin) -> tuple[float, ...]:
    """Find the shaft angles [rad], among the events of a machine, at which its balancing torque is discontinuous.

    Args:
        twin: compiled for `balancing_torque_Nm`, among others.
    """
    machine = twin.machine
    if not isinstance(machine, Machine):  # one with a history: its events depend on its motion
        return ()
    angles = np.array([event.angle_rad for event in machine.events()])
    scale = np.nanmax(np.abs(_torques(twin, machine.shaft_angles(_PROBES))))
    steps = np.abs(_torques(twin, angles + _BESIDE_RAD) - _torques(twin, angles - _BESIDE_RAD))
    return tuple(angles[steps > _JUMP_OVER_PEAK * scale].tolist())  # NaN beyond an end of the range compares false


def _torques(twin: AnyTwin, theta_rad: FloatArray) -> FloatArray:
    """Balancing torque at angles (n,), NaN where the machine cannot close."""
    torques: FloatArray = twin.evaluate(theta_rad, 1.0, 0.0)["balancing_torque_Nm"]
    return torques
