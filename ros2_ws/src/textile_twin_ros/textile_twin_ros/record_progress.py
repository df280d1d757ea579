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

"""Progress of a recording: messages taken, completeness, and silence."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping

# Goes on for as long as any node lives.
_NEVER_SILENT = ("/diagnostics", "/clock")
_AFTERMATH_S = 1.5


class Progress:
    """Counts the messages of a recording.

    Args:
        enough: numbers of messages of topics with which the recording is complete.
        idle_s: and after so long without a message, once there was one; 0 is never.
    """

    def __init__(self, enough: Mapping[str, int], idle_s: float) -> None:
        self._enough, self._idle_s = enough, idle_s
        self.counts: Counter[str] = Counter()
        self.begin()

    def begin(self) -> None:
        """Another recording."""
        self.counts.clear()
        self.anything = False
        """Whether there was a message of a topic that can fall silent."""
        self._last_s = time.monotonic()

    def take(self, topic: str) -> None:
        """A message has been written."""
        self.counts[topic] += 1
        if topic not in _NEVER_SILENT:
            self._last_s = time.monotonic()
            self.anything = True

    def is_complete(self) -> bool:
        """Return whether the recording has all its messages."""
        quiet_s = time.monotonic() - self._last_s
        if self._ends_by_silence and quiet_s > self._idle_s:
            return True
        # Other topics may still have something to say of the last messages counted.
        enough = all(self.counts[topic] >= count for topic, count in self._enough.items())
        return bool(self._enough) and enough and quiet_s > _AFTERMATH_S

    def is_silent(self, timeout_s: float) -> bool:
        """Return whether the topics are silent for `timeout_s`; where silence ends the recording it is no fault."""
        return time.monotonic() - self._last_s > timeout_s and not self._ends_by_silence

    @property
    def _ends_by_silence(self) -> bool:
        return bool(self._idle_s) and self.anything

    def __str__(self) -> str:
        """Messages by topic, for people."""
        return ", ".join(f"{topic} {count}" for topic, count in sorted(self.counts.items()) if count) or "nothing came"
