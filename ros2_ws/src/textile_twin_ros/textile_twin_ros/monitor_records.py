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

"""Where a monitor's results go: alarms and what was learnt into the fault book, the trend into files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.fault_signatures import TurnFeatures
from textile_twin_core.comparison.fault_watch import Alarm, FaultWatch
from textile_twin_core.comparison.monitor import Trend
from textile_twin_core.errors import TwinError
from textile_twin_core.files import check_folder
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
        if set(arrays or ()) != set(TurnFeatures.__dataclass_fields__):
            return False  # none, or those of another version
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


Columns = Mapping[str, FloatArray | IntArray]


class TrendFolder:
    """Buffer of trends until they are written.

    Args:
        folder: folder of the files, made if it is missing.
        most: number of writes in a row that may fail without a loss.

    Raises:
        TwinError: nothing can be written there.
    """

    def __init__(self, folder: str, most: int) -> None:
        self._folder, self._most = Path(folder), most
        self._new: list[Columns] = []
        self._waiting: list[Columns] = []
        """What each write that failed would have written."""
        self._prepare()

    def take(self, trend: Trend) -> None:
        """Hold a trend of at least one turn."""
        self._new.append(trend.columns)

    def write(self) -> None:
        """Write the buffer.

        Raises:
            TwinError: it cannot be written; it stays in the buffer, which drops the oldest after too many failures.
        """
        if self._new:
            self._waiting.append(_joined(self._new))
            self._new.clear()
        if not self._waiting:
            return
        import pyarrow
        from pyarrow import parquet

        columns = _joined(self._waiting)
        try:
            self._prepare()
            parquet.write_table(pyarrow.table(columns), self._folder / f"trend_{int(columns['stamp_ns'][0])}.parquet")
        except OSError as error:
            raise TwinError(f"{self._message(error)}{self._drop_oldest()}") from error
        except TwinError as error:
            raise TwinError(f"{error}{self._drop_oldest()}") from error
        self._waiting.clear()

    def _drop_oldest(self) -> str:
        """Bound the memory; return a sentence on the dropped rows."""
        dropped, self._waiting = self._waiting[: -self._most], self._waiting[-self._most :]
        if not dropped:
            return ""
        turns = _joined(dropped)["turn"]
        return f"; too much waits: the trend of the turns {turns[0]} to {turns[-1]} is dropped"

    def _prepare(self) -> None:
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise TwinError(self._message(error)) from error
        check_folder(self._folder / "trend.parquet")

    def _message(self, error: OSError) -> str:
        return f"parameter 'parquet': {self._folder}: {error.strerror or error}"


def _joined(parts: Sequence[Columns]) -> dict[str, FloatArray | IntArray]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
