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

from textile_twin_ros.messages import SECOND_NS

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


_RESUMED_NS = SECOND_NS


class PlaybackClock:
    """Log times to times since the start of playing, through all of a recording and its repetitions.

    Log times may begin at 0, as those of messages recorded before the first /clock do, or step where a clock was set.

    Args:
        longest_pause_ns: a longer pause between two messages is played as one second; 0 plays all.
    """

    def __init__(self, longest_pause_ns: int) -> None:
        self._longest_ns = longest_pause_ns
        self._played_ns = self._begun_ns = 0
        self._begin()

    def _begin(self) -> None:
        self._last_ns: int | None = None
        self._messages = self._skipped_ns = 0
        self._stamps_ns: tuple[int, int] | None = None

    def take(self, log_ns: int) -> tuple[int, int]:
        """Time to play the next message [ns from the start], and the skipped part of the pause before it [ns]."""
        pause_ns = 0 if self._last_ns is None else log_ns - self._last_ns
        skipped_ns = pause_ns - _RESUMED_NS if 0 < self._longest_ns < pause_ns else 0
        self._last_ns = log_ns
        self._messages += 1
        self._skipped_ns += skipped_ns
        self._played_ns += pause_ns - skipped_ns
        return self._played_ns, skipped_ns

    def note_stamp(self, stamp_ns: int) -> None:
        """Note the stamp in a message's header; 0 is one that its publisher did not fill in."""
        if stamp_ns:
            first, last = self._stamps_ns or (stamp_ns, stamp_ns)
            self._stamps_ns = min(first, stamp_ns), max(last, stamp_ns)

    def repeat(self) -> int:
        """Begin once more with the first message; by how much stamps and the clock then move on [ns].

        The repetition begins as long after the last message as messages follow each other on average. Where a hole is
        skipped, the log times are no measure of what the stamps span.
        """
        span_ns = self._played_ns - self._begun_ns
        step_ns = span_ns // max(self._messages - 1, 1) + 1
        if self._skipped_ns and self._stamps_ns is not None:
            span_ns = max(span_ns, self._stamps_ns[1] - self._stamps_ns[0])
        self._played_ns += step_ns
        self._begun_ns = self._played_ns
        moved_ns = span_ns + step_ns
        self._begin()
        return moved_ns
