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

"""Real time without drift: every moment is reckoned from the start, not from the one before."""

from __future__ import annotations

import threading
import time

_LONGEST_S = 0.1
"""Until it is looked again how long it takes: the rate may be another meanwhile."""


class Pace:
    """Waits until moments of a recorded or simulated time, played at a rate.

    Args:
        stop: set to end all waiting.
        rate: seconds of played time per second.
    """

    def __init__(self, stop: threading.Event, rate: float = 1.0) -> None:
        self._stop = stop
        self._begun = (time.monotonic(), 0.0, rate)  # real time, played time, and the rate since then, set at once

    def start(self) -> None:
        """Begin at played time 0 now."""
        self._begun = (time.monotonic(), 0.0, self._begun[2])

    def set_rate(self, rate: float) -> None:
        """Go on at another rate from here."""
        (real_s, played_s, before), now = self._begun, time.monotonic()
        self._begun = (now, played_s + (now - real_s) * before, rate)

    def wait_until(self, played_s: float) -> bool:
        """Wait until this many seconds of played time have passed since the start; False when stopped."""
        while not self._stop.is_set():
            real_s, begun_s, rate = self._begun
            remaining = (played_s - begun_s) / rate - (time.monotonic() - real_s)
            if remaining <= 0.0:
                return True
            self._stop.wait(min(remaining, _LONGEST_S))
        return False
