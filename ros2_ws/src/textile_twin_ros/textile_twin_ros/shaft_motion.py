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
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

TURN = 2.0 * math.pi


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
        zero_rad, direction, ratio: as in shaft angle = (measured angle - zero) * direction * ratio.
    """

    bits: int
    zero_rad: float = 0.0
    direction: float = 1.0
    ratio: float = 1.0

    def turned(self, theta_rad: float) -> float:
        """The angle of its own shaft at this shaft angle, which counts on."""
        return theta_rad / (self.direction * self.ratio) + self.zero_rad

    def read(self, theta_rad: float) -> float:
        """Reading at this shaft angle, in [0, 2 pi)."""
        angle = self.turned(theta_rad) % TURN
        if not self.bits:
            return angle
        steps = 1 << self.bits
        return math.floor(angle / TURN * steps) % steps * (TURN / steps)


@dataclass
class Marks:
    """Marks on the encoder's shaft that a pick-up tells as they pass: edges of teeth, or one index mark.

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
        # One turn more on each side: a quotient that rounds over a whole turn must not hide the mark that stands there.
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


@dataclass
class SimulatedTorqueSensor:
    """A torque sensor with gain, offset and noise; its delay is a matter of when it is asked.

    Args:
        gain, offset_Nm: measured = gain * true + offset.
        noise_Nm: standard deviation of the noise.
        seed: of the noise.
    """

    gain: float = 1.0
    offset_Nm: float = 0.0
    noise_Nm: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        self._random = Random(self.seed)

    def read(self, torque_Nm: float) -> float:
        """Reading at this torque."""
        return self.gain * torque_Nm + self.offset_Nm + self._random.gauss(0.0, self.noise_Nm)
