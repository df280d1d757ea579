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

"""The times of a recording as they are played: a hole in its log times is no pause of the machine and is skipped."""

from __future__ import annotations

from textile_twin_ros.messages import SECOND_NS

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
