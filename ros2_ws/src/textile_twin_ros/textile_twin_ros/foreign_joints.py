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

"""Messages of other joints on an input's topic: counted and named, as they come from another driver beside this one."""

from __future__ import annotations

import time

from textile_twin_ros.diagnostics import WINDOW_S
from textile_twin_ros.messages import ForeignJointsError

_MOST_SOURCES = 32
_NAMED = 12


class ForeignJoints:
    """Messages that do not have the joint of this input, by the list of joints that they have."""

    def __init__(self) -> None:
        self.count = 0
        self._seen: dict[tuple[str, ...], float] = {}

    def take(self, error: ForeignJointsError) -> None:
        """Count a message."""
        self.count += 1
        if error.joints in self._seen or len(self._seen) < _MOST_SOURCES:
            self._seen[error.joints] = time.monotonic()

    def names(self) -> list[str]:
        """Names of the joints of the last seconds' messages, a dozen at most."""
        return sorted({name for joints in self._recent() for name in joints})[:_NAMED]

    def sources(self) -> int:
        """Number of joint lists in the last seconds' messages without this joint: each is another driver's."""
        return len(self._recent())

    def _recent(self) -> list[tuple[str, ...]]:
        since = time.monotonic() - WINDOW_S
        self._seen = {joints: seen for joints, seen in self._seen.items() if seen > since}
        return list(self._seen)
