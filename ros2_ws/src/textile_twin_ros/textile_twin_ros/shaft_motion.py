# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Simulated main shaft that runs up to a speed with ripple, with readings of its encoder and torque sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from random import Random

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine import Encoder, TorqueFilter, TorqueSensor

TURN = 2.0 * math.pi
FILTER_STEP_S = 5e-5
"""Longest step of the torque sensor's filter."""


@dataclass
class SimulatedShaft:
    """Angle, speed and acceleration of a shaft over time, in closed form.

    The angle is phi + ripple * sin(phi) with a phase phi that runs up at constant acceleration and then goes on at
    constant speed: the speed is then 1 + ripple * cos(phi) times that of the phase.

    Args:
        rpm: speed after the run-up; negative runs backwards.
        run_up_s: seconds from standstill to that speed.
        ripple: relative amplitude of the speed's ripple, once a turn.
    """

    rpm: float
    run_up_s: float = 0.0
    ripple: float = 0.0

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Angle theta [rad], omega [rad/s] and alpha [rad/s^2] at a time from the start."""
        full = self.rpm * TURN / 60.0
        if time_s < self.run_up_s:
            rate = full / self.run_up_s
            phase, speed = 0.5 * rate * time_s**2, rate * time_s
        else:
            rate = 0.0
            phase, speed = full * (time_s - 0.5 * self.run_up_s), full
        slope = 1.0 + self.ripple * math.cos(phase)
        bend = -self.ripple * math.sin(phase)
        return phase + self.ripple * math.sin(phase), slope * speed, slope * rate + bend * speed**2


@dataclass
class SimulatedEncoder:
    """Wrapped angle of an absolute encoder.

    Args:
        bits: resolution; 0 is exact.
        encoder: its zero, direction, ratio and periodic error.
    """

    bits: int
    encoder: Encoder = field(default_factory=Encoder)

    def turned(self, theta_rad: float) -> float:
        """Return the measured angle before it is wrapped and rounded."""
        if self.encoder.is_corrected:
            return float(self.encoder.measured_angle(theta_rad))
        return theta_rad / self.encoder.factor + self.encoder.zero_rad

    def read(self, theta_rad: float) -> float:
        """Reading at this shaft angle, in [0, 2 pi)."""
        angle = self.turned(theta_rad) % TURN
        if not self.bits:
            return angle
        steps = 1 << self.bits
        return math.floor(angle / TURN * steps) % steps * (TURN / steps)


@dataclass
class Marks:
    """Marks on the encoder's shaft that a pick-up reports as they pass: edges of teeth, or one index mark.

    Args:
        angles_rad: their angles in a turn, ascending in [0, 2 pi).
        motion, encoder: how their shaft turns.
    """

    angles_rad: Sequence[float]
    motion: SimulatedShaft
    encoder: SimulatedEncoder

    def passed(self, begin_s: float, end_s: float) -> list[float]:
        """Times in (begin, end] at which a mark passes, for an interval in which the shaft does not reverse."""
        begin, end = self._turned(begin_s), self._turned(end_s)
        low, high = min(begin, end), max(begin, end)
        # One turn more on each side: a quotient that rounds over a whole turn must not hide the mark there.
        turns = range(math.floor(low / TURN) - 1, math.floor(high / TURN) + 2)
        angles = [turn * TURN + angle for turn in turns for angle in self.angles_rad]
        times = [self._time_of(angle, begin_s, end_s) for angle in angles if low < angle <= high]
        return sorted(times)

    def _turned(self, time_s: float) -> float:
        return self.encoder.turned(self.motion.at(time_s)[0])

    def _time_of(self, angle_rad: float, begin_s: float, end_s: float) -> float:
        rising = self._turned(end_s) > self._turned(begin_s)
        while True:
            middle = 0.5 * (begin_s + end_s)
            if not begin_s < middle < end_s:
                return end_s
            if (self._turned(middle) < angle_rad) == rising:
                begin_s = middle
            else:
                end_s = middle


class SimulatedTorqueSensor:
    """Readings of a torque sensor with delay, filter, gain, offset and noise.

    Args:
        sensor: the sensor.
        torque_at: true torques [N m] at times (n,) [s].
        noise_Nm: standard deviation of the noise.
        seed: of the noise.
    """

    def __init__(
        self,
        sensor: TorqueSensor,
        torque_at: Callable[[FloatArray], FloatArray],
        noise_Nm: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._sensor, self._torque_at, self._noise_Nm = sensor, torque_at, noise_Nm
        self._filter = TorqueFilter.of(sensor).session()
        self._random, self._time_s = Random(seed), math.nan

    def read(self, time_s: float) -> float:
        """Return the reading at a time, later than that of the reading before [s]."""
        at = time_s - self._sensor.delay_s
        if self._filter.is_identity or math.isnan(self._time_s):
            filtered = self._filter.restart(float(self._torque_at(np.array((at,)))[0]))
        else:
            # The load may jump: steps of a small part of the filter's time, and of the sample's.
            count = max(1, math.ceil((at - self._time_s) / FILTER_STEP_S))
            times = np.linspace(self._time_s, at, count + 1)[1:]
            step = (at - self._time_s) / count
            filtered = self._filter.take([step] * count, self._torque_at(times).tolist())[-1]
        self._time_s = at
        return self._sensor.reading(filtered) + self._random.gauss(0.0, self._noise_Nm)
