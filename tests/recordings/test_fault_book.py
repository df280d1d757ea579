"""Fault book: the life of an alarm, entered once despite killed processes and a full disk."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from tests.full_disk import full_disk
from textile_twin_core.comparison.fault_watch import Alarm
from textile_twin_core.errors import OutputError, RecordingError
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.fault_book import Fault, FaultBook
from textile_twin_core.recordings.rolling_recording import RollingRecording
from textile_twin_core.recordings.zstd_storage import ZSTD_MAGIC

SECOND_NS = 1_000_000_000
FRICTION = Alarm("constant_torque", "drive", 120, 7 * SECOND_NS, 0.6, 9.1, "drive side: friction changed by +0.6 N m")
NEEDLE = replace(FRICTION, kind="load_force", side="needle", stamp_ns=9 * SECOND_NS, text="needle side: +20 %")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can ask as another user")
def test_a_user_without_permission_reads_who_owns_the_book() -> None:
    """All users read the book of a service that runs; its own user acknowledges, and opens it after the end."""
    refusal = "this user may not write it; run the command as user root$"
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:  # which other users may enter, unlike tmp_path
        Path(folder).chmod(0o755)
        book = FaultBook(folder, create=True)
        book.update("/m1", "tufting", [FRICTION], [FRICTION])
        os.seteuid(65534)
        try:
            other = FaultBook(folder)
            assert [fault.text for fault in other.faults()] == [FRICTION.text]
            with pytest.raises(OutputError, match=refusal):
                other.acknowledge([1], "night shift")
            other.close()
            os.seteuid(0)
            book.close()
            os.seteuid(65534)
            with pytest.raises(OutputError, match=refusal):
                FaultBook(folder)
        finally:
            os.seteuid(0)


def test_an_alarm_is_raised_acknowledged_and_cleared(tmp_path: Path) -> None:
    book = FaultBook(tmp_path / "book", create=True)
    other = FaultBook(tmp_path / "book")  # as another process has it open
    book.update("/m1", "tufting", [FRICTION], [FRICTION], now_ns=100)
    before = other.version()
    book.update("/m1", "tufting", [FRICTION], [FRICTION, NEEDLE], now_ns=200)
    assert other.version() != before
    book.update("/m2", "my_loom.yaml", [], [], now_ns=250)  # another monitor clears no fault of this one
    friction, needle = other.faults("/m1")
    assert (friction.number, friction.raised_ns, friction.cleared_ns, friction.machine) == (1, 100, None, "tufting")
    assert (needle.number, needle.raised_ns, needle.text) == (2, 200, NEEDLE.text)
    assert other.acknowledge([1], "night shift") == [1] and book.acknowledge([1], "late") == []
    book.update("/m1", "tufting", [], [NEEDLE], now_ns=300)
    friction, needle = book.faults()
    assert (friction.cleared_ns, friction.acknowledged_by, friction.is_over) == (300, "night shift", True)
    assert needle.cleared_ns is None and not needle.is_over
    assert book.acknowledge() == [2]
    with pytest.raises(RecordingError, match="no fault 7"):
        book.acknowledge([7])


def test_whoever_acknowledges_between_reading_and_writing_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    book, other = FaultBook(tmp_path, create=True), FaultBook(tmp_path)
    book.update("/", "tufting", [FRICTION], [FRICTION])
    read = book.faults
    with ThreadPoolExecutor() as pool:

        def faults(source: str | None = None) -> list[Fault]:
            found = read(source)
            late.append(pool.submit(other.acknowledge, [1], "second"))
            time.sleep(0.1)
            return found

        late: list[Future[list[int]]] = []
        monkeypatch.setattr(book, "faults", faults)
        assert book.acknowledge([1], "first") == [1]
        assert late[0].result() == []
    assert read()[0].acknowledged_by == "first"


def test_a_fault_that_comes_again_is_another_entry(tmp_path: Path) -> None:
    book = FaultBook(tmp_path, create=True)
    again = replace(FRICTION, stamp_ns=99 * SECOND_NS)
    for standing in ([FRICTION], [], [again]):
        book.update("/", "tufting", standing, standing)
    assert [(fault.stamp_ns, fault.cleared_ns is None) for fault in book.faults()] == [
        (FRICTION.stamp_ns, False),
        (again.stamp_ns, True),
    ]


def test_what_was_learnt_holds_for_the_same_machine(tmp_path: Path) -> None:
    book = FaultBook(tmp_path, create=True)
    learnt = {"sizes": np.arange(8.0).reshape(2, 4), "number": np.array([3, 4])}
    book.remember("/", "this machine", learnt)
    assert FaultBook(tmp_path).recall("/", "another machine") == {}
    found = FaultBook(tmp_path).recall("/", "this machine")
    assert found.keys() == learnt.keys() and all(np.array_equal(found[name], learnt[name]) for name in learnt)
    book.forget("/")
    assert book.recall("/", "this machine") == {}


def test_there_is_no_book(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no fault book there"):
        FaultBook(tmp_path)
    (tmp_path / "faults.db").write_bytes(b"a letter, and no database" * 100)
    with pytest.raises(RecordingError):
        FaultBook(tmp_path)


WRITER = """
import json, sys
from types import SimpleNamespace
from textile_twin_core.recordings.fault_book import Fault, FaultBook

book = FaultBook(sys.argv[1], create=True)
while True:  # goes on where the killed process stopped: half of an alarm's life in each step
    faults = book.faults()
    if faults and faults[-1].cleared_ns is None:
        book.acknowledge([faults[-1].number], str(faults[-1].number))
        book.update("/", "tufting", [], [])
    else:
        alarm = SimpleNamespace(**json.loads(sys.argv[2]) | {"stamp_ns": len(faults)})
        print(f"raises {alarm.stamp_ns}", flush=True)
        book.update("/", "tufting", [alarm], [alarm])
"""


@pytest.mark.slow
def test_twenty_kills_lose_nothing_and_double_nothing(tmp_path: Path) -> None:
    random = np.random.default_rng(20)
    begun: set[int] = set()
    for _ in range(20):
        command = [sys.executable, "-c", WRITER, str(tmp_path), json.dumps(asdict(FRICTION))]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            first = process.stdout.readline()
            time.sleep(random.uniform(0.0, 0.02))
            process.send_signal(signal.SIGKILL)
            # a line that the kill cut short is of no alarm: the book is written after it
            begun |= {int(line.split()[1]) for line in [first, *process.stdout] if line.endswith("\n")}
        assert process.returncode == -signal.SIGKILL
    faults = FaultBook(tmp_path).faults()
    assert len(faults) >= 20
    # The last one may have been killed before its transaction; all others are there, each once and whole.
    assert [fault.stamp_ns for fault in faults] == list(range(len(faults)))
    assert len(faults) in (max(begun), max(begun) + 1)
    assert all(fault.is_over and fault.acknowledged_by == str(fault.number) for fault in faults[:-1])


def test_a_full_disk_leaves_the_book_as_it_was_and_the_change_is_made_later(tmp_path: Path) -> None:
    book = FaultBook(tmp_path, create=True)
    book.update("/", "tufting", [FRICTION], [FRICTION])
    size = max(path.stat().st_size for path in tmp_path.iterdir() if not path.name.endswith("-shm"))
    with full_disk(size), pytest.raises(OutputError, match=r"fault book .*faults\.db"):
        for stamp in range(1000):
            book.update("/", "tufting", [], [replace(NEEDLE, stamp_ns=stamp)])
    before = len(book.faults())
    assert before >= 1 and [fault.number for fault in FaultBook(tmp_path).faults()] == [*range(1, before + 1)]
    book.update("/", "tufting", [NEEDLE], [NEEDLE])
    assert FaultBook(tmp_path).faults()[-1].stamp_ns == NEEDLE.stamp_ns


def fill(rolling: RollingRecording, begin_s: int, end_s: int) -> None:
    rolling.writer.add_topic("words", "std_msgs/msg/String")
    for tenth in range(10 * begin_s, 10 * end_s):
        rolling.writer.write("words", tenth * SECOND_NS // 10, cdr(f"{tenth / 10:g}"))


def cdr(text: str) -> bytes:
    return b"\x00\x01\x00\x00" + (len(text) + 1).to_bytes(4, "little") + text.encode() + b"\x00"


def test_a_part_is_cut_out_of_all_runs_and_old_files_go(tmp_path: Path) -> None:
    killed = RollingRecording(tmp_path / "rolling")
    fill(killed, 1000, 1030)
    killed.writer.flush()  # and no more of it: the process is killed
    rolling = RollingRecording(tmp_path / "rolling")
    fill(rolling, 1032, 1060)
    rolling.writer.flush()
    out = tmp_path / "fault_1"
    begin_ns, end_ns = 1025 * SECOND_NS, 1045 * SECOND_NS
    with BagWriter(tmp_path / ".fault_1.partial-1") as partial:  # by a process killed while it wrote
        partial.add_topic("words", "std_msgs/msg/String")
    count = rolling.cut(begin_ns, end_ns, out, [("words", cdr("latched"))], {"fault": "1"})
    bag = open_bag(out)
    times = [time_ns for _, time_ns, _ in bag.raw_messages()]
    expected = [tenth * SECOND_NS // 10 for tenth in [*range(10250, 10300), *range(10320, 10451)]]
    assert times == [begin_ns, *expected] and count == len(times) and bag.metadata == {"fault": "1"}
    assert next(bag.raw_messages())[2] == cdr("latched") and not list(tmp_path.glob(".fault*"))
    assert rolling.cut(0, SECOND_NS, tmp_path / "fault_2") == 0 and not (tmp_path / "fault_2").exists()
    files = len(list(rolling.writer.path.glob("*.mcap")))
    rolling.drop_before(1047 * SECOND_NS)
    assert len(list(rolling.writer.path.glob("*.mcap"))) == files - 3
    assert killed.writer.path.exists()  # its last change is of today
    rolling.drop_before(time.time_ns())
    assert not killed.writer.path.exists()
    rolling.close()
    assert open_bag(rolling.writer.path).topics["/words"].count


def test_a_damaged_file_of_a_killed_run_costs_its_own_messages_alone(tmp_path: Path) -> None:
    """A disk that lost a byte must not keep every later cut, and with it the removal of old files, from its end."""
    killed = RollingRecording(tmp_path / "rolling")
    fill(killed, 1000, 1015)
    killed.writer.flush()
    damaged = sorted(killed.writer.path.glob("*.mcap"))[1]  # of 1005 s to 1010 s
    content = bytearray(damaged.read_bytes())
    (chunk,) = (i for i in range(len(content) - 4) if content[i : i + 4] == ZSTD_MAGIC)
    content[chunk + 30] ^= 0xFF
    damaged.write_bytes(content)
    rolling = RollingRecording(tmp_path / "rolling")
    fill(rolling, 1015, 1020)
    rolling.writer.flush()
    rolling.cut(1000 * SECOND_NS, 1020 * SECOND_NS, tmp_path / "fault_1")
    times = [time_ns for _, time_ns, _ in open_bag(tmp_path / "fault_1").raw_messages()]
    assert times == [tenth * SECOND_NS // 10 for tenth in [*range(10000, 10050), *range(10100, 10200)]]
    rolling.close()
