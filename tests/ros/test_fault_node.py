"""The fault book over real nodes: kills, a full disk, services, and the recording that every alarm gets."""

from __future__ import annotations

import signal
import sqlite3
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from diagnostic_msgs.srv import SelfTest
from rosbags.highlevel import AnyReader
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tests.full_disk import full_disk
from tests.generators.configured_machine import configured_machine
from tests.generators.faults import faulty, with_fault
from tests.generators.mill_recordings import MillRecording
from tests.recordings.test_fault_book import FRICTION, NEEDLE
from tests.ros.suite import RELIABLE, SECOND_NS, Program, Suite
from tests.ros.test_recorder_without_room import no_room
from textile_twin_core.comparison.fault_watch import FaultWatch, WatchSettings
from textile_twin_core.comparison.monitor import Monitor
from textile_twin_core.recordings.fault_book import Fault, FaultBook
from textile_twin_ros.endpoints import latched_qos
from textile_twin_ros.monitor_records import FaultLog

LATCHED = "robot_description"


class Talk:
    """Counted words on a topic, twenty times a second, while the test waits."""

    def __init__(self, suite: Suite) -> None:
        self._suite, self.node = suite, suite.node()
        self._publisher = self.node.create_publisher(String, "words", RELIABLE)
        self._latched = self.node.create_publisher(String, LATCHED, latched_qos())
        self._latched.publish(String(data="a robot"))
        self.said: list[tuple[int, int]] = []
        self.node.create_timer(0.05, self._say)

    def _say(self) -> None:
        self.said.append((len(self.said), time.time_ns()))
        self._publisher.publish(String(data=str(len(self.said) - 1)))

    def heard_by(self, count: int) -> None:
        self._suite.spin_until(lambda: self._publisher.get_subscription_count() == count, "the fault node")

    def said_between(self, begin_ns: int, end_ns: int) -> list[int]:
        return [number for number, time_ns in self.said if begin_ns <= time_ns <= end_ns]


def fault_node(suite: Suite, book: FaultBook) -> Program:
    return suite.start("fault_node", f"book:={book.folder}", "before_s:=2.0", "after_s:=1.0")


def words_in(path: Path) -> list[str]:
    """Words of a recording as rosbags reads them."""
    with AnyReader([path]) as reader:
        chosen = [each for each in reader.connections if each.topic == "/words"]
        return [reader.deserialize(raw, each.msgtype).data for each, _, raw in reader.messages(chosen)]


def with_recording(suite: Suite, book: FaultBook, number: int) -> Fault:
    suite.spin_until(lambda: book.faults()[number - 1].recording is not None, f"the recording of fault {number}")
    return book.faults()[number - 1]


@pytest.mark.slow
def test_an_alarm_gets_a_recording_whatever_is_killed(suite: Suite) -> None:
    book = FaultBook(suite.folder / "book", create=True)
    talk, node = Talk(suite), fault_node(suite, book)
    talk.heard_by(1)
    suite.spin_for(2.5)
    book.update("/", "tufting", [FRICTION], [FRICTION])
    fault = with_recording(suite, book, 1)
    path = book.folder / str(fault.recording)
    words = list(map(int, words_in(path)))
    inner = talk.said_between(fault.raised_ns - 1_800_000_000, fault.raised_ns + 800_000_000)
    assert words == list(range(words[0], words[-1] + 1)) and set(inner) <= set(words)
    with AnyReader([path]) as reader:
        (latched,) = (each for each in reader.connections if each.topic == f"/{LATCHED}")
        assert [reader.deserialize(raw, latched.msgtype).data for _, _, raw in reader.messages([latched])] == [
            "a robot"
        ]

    listed = suite.call(talk.node, SelfTest, "fault_node/list", SelfTest.Request())
    (shown,) = listed.status
    assert (shown.name, shown.message, shown.level) == ("fault 1", FRICTION.text, DiagnosticStatus.ERROR)
    assert {entry.key: entry.value for entry in shown.values}["recording"] == "fault_1"
    answer = suite.call(talk.node, Trigger, "fault_node/acknowledge", Trigger.Request())
    assert answer.success and answer.message == "acknowledged: 1"
    assert book.faults()[0].acknowledged_by == "service"

    book.update("/", "tufting", [NEEDLE], [NEEDLE])
    node.end(signal.SIGKILL)  # before the second recording is made; what came before is on the disk
    killed_ns = time.time_ns()
    fault_node(suite, book)
    fault = with_recording(suite, book, 2)
    words = list(map(int, words_in(book.folder / str(fault.recording))))
    assert len(set(words)) == len(words)
    assert set(talk.said_between(fault.raised_ns - 1_800_000_000, killed_ns - SECOND_NS)) <= set(words)
    assert [each.recording for each in book.faults()] == ["fault_1", "fault_2"]


def test_a_book_that_cannot_be_read_is_an_answer_of_the_service(suite: Suite) -> None:
    book = FaultBook(suite.folder / "book", create=True)
    program = fault_node(suite, book)
    node = suite.node()
    listed = suite.call(node, SelfTest, "fault_node/list", SelfTest.Request())
    assert listed.passed == DiagnosticStatus.OK and not listed.status
    with sqlite3.connect(book.path) as base:
        base.execute("DROP TABLE faults")
    for _ in range(2):  # the node lives on
        listed = suite.call(node, SelfTest, "fault_node/list", SelfTest.Request())
        (status,) = listed.status
        assert listed.passed == status.level == DiagnosticStatus.ERROR and str(book.path) in status.message
    done = suite.call(node, Trigger, "fault_node/acknowledge", Trigger.Request())
    assert not done.success and str(book.path) in done.message and program.process.poll() is None


def test_a_book_that_can_be_read_again_is_in_order(suite: Suite) -> None:
    """As after a pause of the disk on which it lies."""
    book = FaultBook(suite.folder / "book", create=True)
    node, levels = suite.node(), list[bytes]()

    def take(message: DiagnosticArray) -> None:
        levels.extend(status.level for status in message.status if status.name == "fault_node: fault book")

    node.create_subscription(DiagnosticArray, "/diagnostics", take, RELIABLE)
    fault_node(suite, book)
    suite.spin_until(lambda: levels[-1:] == [DiagnosticStatus.OK], "diagnostics")
    for change, level in (
        ("faults RENAME TO away", DiagnosticStatus.ERROR),
        ("away RENAME TO faults", DiagnosticStatus.OK),
    ):
        with sqlite3.connect(book.path) as base:
            base.execute(f"ALTER TABLE {change}")
        suite.spin_until(lambda: levels[-1] == level, f"level {level!r} after {change}")  # noqa: B023


def test_a_full_disk_delays_recordings_and_loses_no_alarm(suite: Suite) -> None:
    book = FaultBook(suite.folder / "book", create=True)
    talk, node = Talk(suite), fault_node(suite, book)
    statuses: list[DiagnosticStatus] = []

    def take(message: DiagnosticArray) -> None:
        statuses.extend(status for status in message.status if status.name == "fault_node: fault book")

    talk.node.create_subscription(DiagnosticArray, "/diagnostics", take, RELIABLE)
    talk.heard_by(1)
    suite.spin_for(1.5)
    with no_room(node, 64):
        book.update("/", "tufting", [FRICTION], [FRICTION])
        suite.spin_until(lambda: statuses and "make room" in statuses[-1].message, "diagnostics")
        assert statuses[-1].level == DiagnosticStatus.ERROR
    fault = with_recording(suite, book, 1)
    assert fault.recording == "fault_1" and words_in(book.folder / "fault_1")
    suite.spin_until(lambda: statuses[-1].level == DiagnosticStatus.WARN, "room again")
    assert statuses[-1].message == f"1 not acknowledged, the latest 1: {FRICTION.text}"
    assert node.end() == 0 and "Traceback" not in node.words()


def test_a_monitor_enters_what_a_full_disk_refused(tmp_path: Path) -> None:
    watch = FaultWatch(10.0, WatchSettings(learn_turns=20))
    log = FaultLog(str(tmp_path), "/", "tufting")
    watch._known = [None]  # type: ignore[list-item]
    log._remembered = True
    watch._raised, watch._calm = {"constant_torque": FRICTION}, {"constant_torque": 0}
    with full_disk(max(path.stat().st_size for path in tmp_path.iterdir() if path.suffix == ".db")):
        log.enter(watch, [FRICTION], "")
        for stamp in range(200):  # until the write-ahead log is full
            log.enter(watch, [replace(NEEDLE, stamp_ns=stamp)], "")
        assert "make room" in log.trouble
    watch._raised, watch._calm = {}, {}
    log.enter(watch, [], "")
    assert not log.trouble
    faults = FaultBook(tmp_path).faults()
    assert sorted(fault.stamp_ns for fault in faults) == sorted([*range(200), FRICTION.stamp_ns])
    assert all(fault.cleared_ns is not None for fault in faults)


def test_a_monitor_goes_on_where_a_killed_one_stopped(tmp_path: Path) -> None:
    """The second watch knows the band and the alarm: it raises none again, and clears the one that has gone."""
    made = faulty("friction", 0.6, 985, duration_s=60.0, onset_s=28.0, rate=250.0)
    healthy_again = with_fault(faulty("", 0.0, 985, 60.0, rate=250.0).recording, made.case, "friction", 0.6, 28.0, 42.0)
    machine, settings = configured_machine(made.case), WatchSettings(learn_turns=60)
    raised: Counter[str] = Counter()
    for begin_s, end_s in ((0.0, 38.0), (40.0, 60.0)):
        monitor, log = Monitor(machine, settings), FaultLog(str(tmp_path), "/", "tufting")
        resumed = log.resume(monitor.watch, "tufting")
        assert resumed is (begin_s > 0.0)
        part = between(healthy_again, begin_s, end_s)
        monitor.add_angles(part.angle_stamps_ns, part.angle)
        monitor.add_torques(part.torque_stamps_ns, part.torque)
        trend = monitor.finish()
        raised.update(alarm.kind for alarm in trend.alarms)
        log.enter(monitor.watch, trend.alarms, "tufting")
    (fault,) = FaultBook(tmp_path).faults()
    assert fault.kind == "constant_torque" and fault.cleared_ns is not None and raised.total() == 1


def between(made: MillRecording, begin_s: float, end_s: float) -> MillRecording:
    first = int(made.angle_stamps_ns[0])
    begin, end = first + round(begin_s * 1e9), first + round(end_s * 1e9)
    angle = (made.angle_stamps_ns >= begin) & (made.angle_stamps_ns < end)
    torque = (made.torque_stamps_ns >= begin) & (made.torque_stamps_ns < end)
    return replace(
        made,
        angle_stamps_ns=made.angle_stamps_ns[angle],
        angle=made.angle[angle],
        torque_stamps_ns=made.torque_stamps_ns[torque],
        torque=made.torque[torque],
    )
