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

"""A monitor's side of the fault book: alarms and the learnt band survive a killed monitor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

from textile_twin_core.comparison.fault_signatures import TurnFeatures
from textile_twin_core.comparison.fault_watch import Alarm, FaultWatch
from textile_twin_core.errors import TwinError
from textile_twin_core.recordings.fault_book import FaultBook


class FaultLog:
    """Enters the state of one monitor's watch; a failed write is tried again with the next turn.

    Args:
        folder: of the book; made if need be.
        source: the monitor's namespace.
        machine: name or file of its machine.

    Raises:
        TwinError: there can be no book.
    """

    def __init__(self, folder: str, source: str, machine: str) -> None:
        self._book = FaultBook(folder, create=True)
        self._source, self._machine = source, machine
        self._raised: list[Alarm] = []
        self._standing: list[Alarm] | None = None
        self._remembered = self._to_forget = False
        self.trouble = ""

    def resume(self, watch: FaultWatch, fingerprint: str) -> bool:
        """Let a watch go on where the one before stopped; whether there was one of the same machine and settings."""
        arrays = self._book.recall(self._source, fingerprint)
        if not arrays:
            return False
        open_faults = [fault for fault in self._book.faults(self._source) if fault.cleared_ns is None]
        standing = [Alarm(f.kind, f.side, f.turn, f.stamp_ns, f.size, f.sigmas, f.text) for f in open_faults]
        watch.resume(TurnFeatures(**arrays), standing)  # type: ignore[arg-type]
        self._remembered = True
        return True

    def enter(self, watch: FaultWatch, raised: Iterable[Alarm], fingerprint: str) -> None:
        """Bring the book to the watch's state."""
        self._raised += raised
        standing = list(watch.standing)
        try:
            if self._to_forget:
                self._book.forget(self._source)
                self._book.update(self._source, self._machine, self._raised, ())
                self._raised, self._standing, self._to_forget, self._remembered = [], None, False, False
            if watch.learnt and not self._remembered:
                self._book.remember(self._source, fingerprint, asdict(watch.learnt_turns))
                self._remembered = True
            if watch.learnt and (self._raised or standing != self._standing):
                self._book.update(self._source, self._machine, self._raised, standing)
                self._raised, self._standing = [], standing
            self.trouble = ""
        except TwinError as error:
            self.trouble = f"{error}; make room: what is raised meanwhile is entered then"

    def forget(self, watch: FaultWatch) -> None:
        """Drop the learnt band and clear standing alarms, as after a repair; `watch` begins to learn."""
        self._to_forget = True
        self.enter(watch, (), "")
