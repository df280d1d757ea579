"""Fault book: the life of every alarm (raised, acknowledged, cleared), in an SQLite file beside the recordings."""

from __future__ import annotations

import io
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from textile_twin_core.errors import OutputError, RecordingError

if TYPE_CHECKING:
    from textile_twin_core.comparison.fault_watch import Alarm

FILE_NAME = "faults.db"
_WAIT_S = 5.0
"""Longest wait for another process that writes."""
_SCHEMA = """
CREATE TABLE IF NOT EXISTS faults (
    number INTEGER PRIMARY KEY,
    source TEXT NOT NULL, machine TEXT NOT NULL, kind TEXT NOT NULL, side TEXT NOT NULL, text TEXT NOT NULL,
    size REAL, sigmas REAL, turn INTEGER NOT NULL, stamp_ns INTEGER NOT NULL,
    raised_ns INTEGER NOT NULL, acknowledged_ns INTEGER, acknowledged_by TEXT, cleared_ns INTEGER, recording TEXT,
    UNIQUE (source, kind, stamp_ns)
);
CREATE TABLE IF NOT EXISTS memories (source TEXT PRIMARY KEY, fingerprint TEXT NOT NULL, arrays BLOB NOT NULL);
"""


@dataclass(frozen=True)
class Fault:
    """Entry of the book. Times are nanoseconds since 1970 by this computer's clock, None if not yet reached.

    Attributes:
        number: counts the faults of the book from 1.
        source: namespace of the monitor that raised the alarm.
        machine: name or file of the machine.
        kind, side, text, size, sigmas, turn, stamp_ns: as in `Alarm`.
        raised_ns, acknowledged_ns, cleared_ns: the alarm's life.
        acknowledged_by: name and remark of the person.
        recording: name of the fault's own recording beside the book; empty without messages, None until it is made.
    """

    number: int
    source: str
    machine: str
    kind: str
    side: str
    text: str
    size: float
    sigmas: float
    turn: int
    stamp_ns: int
    raised_ns: int
    acknowledged_ns: int | None
    acknowledged_by: str | None
    cleared_ns: int | None
    recording: str | None

    @property
    def is_over(self) -> bool:
        """True if the fault is both acknowledged and cleared."""
        return self.acknowledged_ns is not None and self.cleared_ns is not None


_COLUMNS = ", ".join(field.name for field in fields(Fault))


def _refused(path: Path, error: Exception, remedy: str = "") -> OutputError:
    """Name the book that cannot be used; where its files are another user's, name that user."""
    if "readonly" in str(error):
        return OutputError(f"fault book {path}: this user may not write it; run the command as user {path.owner()}")
    return OutputError(f"fault book {path}: {error}{remedy}")


class FaultBook:
    """The book in a folder. Any number of processes of one computer read and write the same book.

    Every change is one transaction of an SQLite database in WAL mode with `synchronous=FULL`: a killed process or a
    power loss leaves the state before or after the change.

    Args:
        folder: place of the book.
        create: make folder and book if they are missing.

    Raises:
        RecordingError: there is no book, or the file is no database.
        OutputError: the folder or the book cannot be made.

    Examples:
        >>> book = FaultBook("out/faults", create=True)  # doctest: +SKIP
        >>> book.faults()  # doctest: +SKIP
        []
    """

    def __init__(self, folder: str | Path, create: bool = False) -> None:
        self.folder = Path(folder)
        self.path = self.folder / FILE_NAME
        if not create and not self.path.is_file():
            raise RecordingError(f"{self.folder}: no fault book there; give the folder that parameter 'book' names")
        try:
            if create:
                self.folder.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(self.path, timeout=_WAIT_S, isolation_level=None, check_same_thread=False)
            self._base.execute("PRAGMA journal_mode=WAL")
            self._base.execute("PRAGMA synchronous=FULL")
            self._base.executescript(_SCHEMA)
        except (OSError, sqlite3.OperationalError) as error:
            raise _refused(self.path, error, "; choose another folder or make room") from error
        except sqlite3.DatabaseError as error:
            raise RecordingError(f"{self.path}: no fault book ({error}); choose another folder") from error

    def close(self) -> None:
        """Close the database."""
        self._base.close()

    def update(
        self, source: str, machine: str, raised: Iterable[Alarm], standing: Iterable[Alarm], now_ns: int | None = None
    ) -> None:
        """Bring the book to the state of a monitor: enter new alarms, clear those that no longer stand.

        A repeated call changes nothing, so a monitor may repeat a failed update.

        Args:
            source: namespace of the monitor.
            machine: name or file of its machine.
            raised: alarms since the last successful update.
            standing: alarms that stand now.
            now_ns: time of the change; default: now.

        Raises:
            OutputError: the book cannot be written.
        """
        now_ns = time.time_ns() if now_ns is None else now_ns
        standing = list(standing)
        stands = {(alarm.kind, alarm.stamp_ns) for alarm in standing}
        with self._change() as base:
            for a in (*raised, *standing):
                values = (source, machine, a.kind, a.side, a.text, a.size, a.sigmas, a.turn, a.stamp_ns, now_ns)
                base.execute(
                    "INSERT INTO faults (source, machine, kind, side, text, size, sigmas, turn, stamp_ns, raised_ns)"
                    " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (source, kind, stamp_ns) DO NOTHING",
                    values,
                )
            rows = base.execute(
                "SELECT number, kind, stamp_ns FROM faults WHERE source = ? AND cleared_ns IS NULL", (source,)
            ).fetchall()
            gone = [(now_ns, number) for number, kind, stamp_ns in rows if (kind, stamp_ns) not in stands]
            base.executemany("UPDATE faults SET cleared_ns = ? WHERE number = ?", gone)

    def acknowledge(self, numbers: Iterable[int] | None = None, by: str = "", source: str | None = None) -> list[int]:
        """Acknowledge faults; return the numbers of those that were not acknowledged before.

        Args:
            numbers: faults to acknowledge; None: all.
            by: name and remark of the person.
            source: limit to faults of this monitor.

        Raises:
            RecordingError: no fault has such a number.
            OutputError: the book cannot be written.
        """
        with self._change() as base:
            there = {fault.number: fault for fault in self.faults(source)}
            wanted = list(there) if numbers is None else list(numbers)
            for number in wanted:
                if number not in there:
                    raise RecordingError(f"{self.path}: no fault {number}; it has {len(there)}")
            fresh = [number for number in wanted if there[number].acknowledged_ns is None]
            now_ns = time.time_ns()
            base.executemany(
                "UPDATE faults SET acknowledged_ns = ?, acknowledged_by = ? WHERE number = ?",
                [(now_ns, by, number) for number in fresh],
            )
        return fresh

    def set_recording(self, number: int, name: str) -> None:
        """Enter the name of a fault's own recording; empty if nothing was recorded.

        Raises:
            OutputError: the book cannot be written.
        """
        with self._change() as base:
            base.execute("UPDATE faults SET recording = ? WHERE number = ?", (name, number))

    def faults(self, source: str | None = None) -> list[Fault]:
        """Return all faults, or those of the monitor `source`, in order of their numbers."""
        where, values = ("", ()) if source is None else (" WHERE source = ?", (source,))
        with self._named():
            rows = self._base.execute(f"SELECT {_COLUMNS} FROM faults{where} ORDER BY number", values).fetchall()
        return [Fault(*row) for row in rows]

    def version(self) -> int:
        """A number that differs after each change by another process or by this one."""
        with self._named():
            (others,) = self._base.execute("PRAGMA data_version").fetchone()
        return int(others) * (1 << 32) + self._base.total_changes

    def remember(self, source: str, fingerprint: str, arrays: Mapping[str, npt.NDArray[np.generic]]) -> None:
        """Store the learnt state of a monitor, in place of an earlier one.

        Args:
            source: namespace of the monitor.
            fingerprint: of the machine and the settings to which it applies.
            arrays: by name.

        Raises:
            OutputError: the book cannot be written.
        """
        packed = io.BytesIO()
        np.savez(packed, **arrays)  # type: ignore[arg-type]
        with self._change() as base:
            base.execute("INSERT OR REPLACE INTO memories VALUES (?, ?, ?)", (source, fingerprint, packed.getvalue()))

    def forget(self, source: str) -> None:
        """Drop the learnt state of a monitor.

        Raises:
            OutputError: the book cannot be written.
        """
        with self._change() as base:
            base.execute("DELETE FROM memories WHERE source = ?", (source,))

    def recall(self, source: str, fingerprint: str) -> dict[str, npt.NDArray[np.generic]]:
        """Return the learnt state of a monitor for the same machine and settings; empty without one."""
        with self._named():
            row = self._base.execute(
                "SELECT arrays FROM memories WHERE source = ? AND fingerprint = ?", (source, fingerprint)
            ).fetchone()
        if row is None:
            return {}
        with np.load(io.BytesIO(row[0]), allow_pickle=False) as arrays:
            return dict(arrays)

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise _refused(self.path, error) from error

    @contextmanager
    def _change(self) -> Iterator[sqlite3.Connection]:
        """Run one transaction, as a whole or not at all."""
        with self._named():
            self._base.execute("BEGIN IMMEDIATE")
            try:
                yield self._base
                self._base.execute("COMMIT")
            except BaseException:
                if self._base.in_transaction:
                    self._base.execute("ROLLBACK")
                raise
