"""Faults that come and go while nodes are killed at any moment: each is in the book once, with its recording."""

from __future__ import annotations

import itertools
import signal
import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from tests.generators.faults import EXPECTED, faulty, with_fault
from tests.ros.suite import RELIABLE, SECOND_NS, Suite
from tests.ros.test_live_topics import joint_state
from textile_twin_core.recordings.fault_book import FaultBook
from textile_twin_ros.pacing import Pace

SPEED, RATE_HZ = 2.0, 100.0
SECONDS_PER_FAULT = 600.0
SIZES = {"needle_force": 0.2, "friction": 1.2, "sensor_gain": 0.12}


class Loom:
    """A tufting machine's sensors, published by a thread; `fault` names the fault that it has at present."""

    def __init__(self, suite: Suite, faults: int, namespace: str = "") -> None:
        node = suite.node()
        made = faulty("", 0.0, 985, duration_s=SECONDS_PER_FAULT * faults, rate=RATE_HZ)
        self._angles = list(zip(made.recording.angle_stamps_ns.tolist(), made.recording.angle.tolist(), strict=True))
        self._stamps = made.recording.torque_stamps_ns.tolist()
        self._torques = {"": made.recording.torque.tolist()} | {
            kind: with_fault(made.recording, made.case, kind, size, -1.0).torque.tolist()
            for kind, size in itertools.islice(SIZES.items(), faults)
        }
        self.fault = ""
        self._angle = node.create_publisher(JointState, f"{namespace}main_shaft/angle", RELIABLE)
        self._torque = node.create_publisher(WrenchStamped, f"{namespace}balancing_torque/measured", RELIABLE)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        pace = Pace(self._stop, SPEED)
        message = WrenchStamped()
        for number, ((stamp, angle), torque_stamp) in enumerate(zip(self._angles, self._stamps, strict=False)):
            if not pace.wait_until(number / RATE_HZ):
                return
            self._angle.publish(joint_state(stamp, angle))
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(torque_stamp, SECOND_NS)
            message.wrench.torque.z = self._torques[self.fault][number]
            self._torque.publish(message)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


def survive(suite: Suite, kills: int, faults: int) -> FaultBook:
    """Book after a number of faults that came and went, with the kills spread over their begins and ends."""
    book = FaultBook(suite.folder / "book", create=True)
    own = [f"book:={book.folder}"]
    parameters = {
        "monitor_node": [*own, "learn_turns:=40"],
        "fault_node": own,
        "twin_node": [],
    }
    running = {node: suite.start(node, *words) for node, words in parameters.items()}
    victims, random = itertools.cycle(parameters), np.random.default_rng(20)
    moments = np.array_split(np.arange(kills), 2 * faults)

    def kill(count: int) -> None:
        for _ in range(count):
            suite.spin_for(random.uniform(0.0, 3.0))
            victim = next(victims)
            running[victim].end(signal.SIGKILL)
            running[victim] = suite.start(victim, *parameters[victim])

    loom = Loom(suite, faults)
    try:
        band = book.folder / "faults.db"
        suite.spin_until(lambda: has_learnt(band), "the band")
        for number, kind in enumerate(itertools.islice(itertools.cycle(SIZES), faults)):
            loom.fault = kind
            kill(moments[2 * number].size)
            suite.spin_until(lambda count=number: len(book.faults()) > count, f"fault {number + 1}, {kind}")
            loom.fault = ""
            kill(moments[2 * number + 1].size)
            suite.spin_until(lambda: all(fault.cleared_ns for fault in book.faults()), f"end of fault {number + 1}")
        suite.spin_until(lambda: all(fault.recording is not None for fault in book.faults()), "the last recording")
    finally:
        loom.close()
    for program in running.values():
        assert program.end() == 0 and "Traceback" not in program.words()
    return book


def has_learnt(file: Path) -> bool:
    """Return whether a monitor has entered its band."""
    with closing(sqlite3.connect(file, timeout=10.0)) as base:
        return bool(base.execute("SELECT count(*) FROM memories").fetchone()[0])


def topics_around(path: Path, raised_ns: int) -> dict[str, tuple[int, int]]:
    """Messages before and after an alarm by topic, as rosbags reads them."""
    counts: dict[str, tuple[int, int]] = {}
    with AnyReader([path]) as reader:
        for connection, log_time_ns, _ in reader.messages():
            before, after = counts.get(connection.topic, (0, 0))
            late = log_time_ns >= raised_ns
            counts[connection.topic] = (before + (not late), after + late)
    return counts


def check(book: FaultBook, faults: int) -> list[tuple[int, int]]:
    """Each fault once, of the right kind, with a recording of the messages around it while the fault node lived.

    Returns:
        Angles before and after each alarm.
    """
    expected = [EXPECTED[kind] for kind in itertools.islice(itertools.cycle(SIZES), faults)]
    assert [fault.kind for fault in book.faults()] == expected
    angles = []
    for fault in book.faults():
        counts = topics_around(book.folder / str(fault.recording), fault.raised_ns)
        for topic in ("/main_shaft/angle", "/balancing_torque/measured"):
            assert sum(counts[topic]) > 0, (fault.number, topic, counts)
        angles.append(counts["/main_shaft/angle"])
    return angles


@pytest.mark.campaign
@pytest.mark.slow
def test_kills_lose_no_fault_and_double_none(suite: Suite) -> None:
    """Each node is killed once; twenty kills take minutes: tests/benchmarks/field.py fault-book."""
    check(survive(suite, kills=3, faults=1), faults=1)
