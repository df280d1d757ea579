"""record_node on a disk without room: its report, and the remaining recording."""

from __future__ import annotations

import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tests.ros.suite import RELIABLE, Program, Suite, recorded, shaft_angles
from tests.ros.test_live_topics import joint_state
from textile_twin_core.recordings import open_bag


def recorder_on_a_full_disk(suite: Suite, blocks: int, topics: str) -> Program:
    """The shell's limit on the size of files, in blocks of 1024 bytes, stands for a disk without room."""
    command = [str(Path(sys.executable).parent / "record_node"), "--ros-args", "-p", f"bag:={suite.folder / 'full'}"]
    limited = ["bash", "-c", f'ulimit -f {blocks}; exec "$@"', "-", *command, "-p", f"topics:=[{topics}]"]
    recorder = Program(limited, suite.folder / "full.log", suite.environment)
    suite.processes.append(recorder)
    return recorder


def ends_with_a_line(suite: Suite, recorder: Program) -> None:
    suite.spin_until(lambda: recorder.process.poll() is not None, "end of the recorder")
    assert recorder.wait() == 2
    assert recorder.words().splitlines()[-1].startswith(f"record_node: {suite.folder / 'full'}: File too large")
    assert "Traceback" not in recorder.words()


def test_a_full_disk_is_one_line(suite: Suite) -> None:
    recorder = recorder_on_a_full_disk(suite, 64, "main_shaft/angle")
    publisher = suite.node().create_publisher(JointState, "main_shaft/angle", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "recorder")
    for stamp, angle in zip(*shaft_angles(3000), strict=True):
        publisher.publish(joint_state(stamp, angle))
    ends_with_a_line(suite, recorder)


def test_a_disk_that_is_full_as_topics_come_is_one_line(suite: Suite) -> None:
    """Their declarations alone, all at once, are more than the buffer of the next flush."""
    node = suite.node()
    topics = [f"words_{number}" for number in range(40)]
    for topic in topics:
        node.create_publisher(String, topic, RELIABLE)
    ends_with_a_line(suite, recorder_on_a_full_disk(suite, 8, ",".join(topics)))


@contextmanager
def no_room(program: Program, bytes_each: int) -> Iterator[None]:
    """Limit the size of files of a running program meanwhile [bytes]."""
    soft, hard = resource.prlimit(program.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(program.process.pid, resource.RLIMIT_FSIZE, (bytes_each, hard))
    try:
        yield
    finally:
        resource.prlimit(program.process.pid, resource.RLIMIT_FSIZE, (soft, hard))


def ask(suite: Suite, node: Node, what: str) -> Any:
    return suite.call(node, Trigger, f"record_node/{what}", Trigger.Request())


def test_a_stop_that_finds_no_room_is_answered_and_what_is_there_is_read(suite: Suite) -> None:
    recording = suite.folder / "run"
    recorder = suite.start("record_node", f"bag:={recording}", "topics:=[words]")
    node = suite.node()
    publisher = node.create_publisher(String, "words", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "recorder")
    for number in range(20):
        publisher.publish(String(data=str(number)))
    suite.spin_until(lambda: recorded(recording) == 20, "flush of the recording")
    with no_room(recorder, (recording / "run_0.mcap").stat().st_size):
        answer = ask(suite, node, "stop")
    assert not answer.success
    assert answer.message == (
        f"{recording}: File too large: the recording ends after 20 messages; make room, and keep it with textile-twin"
        " recover"
    )
    assert open_bag(recording).topics["/words"].count == 20
    assert ask(suite, node, "start").message == f"{recording}_2"
    assert recorder.end() == 0
    assert "Traceback" not in recorder.words()


def test_a_start_that_finds_no_room_is_refused_and_leaves_nothing(suite: Suite) -> None:
    folder = suite.folder / "recordings"
    recorder = suite.start("record_node", f"folder:={folder}", "topics:=[words]", "start:=false")
    node = suite.node()
    publisher = node.create_publisher(String, "words", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "recorder")
    with no_room(recorder, 16):
        answer = ask(suite, node, "start")
    assert not answer.success and "File too large" in answer.message
    assert not list(folder.iterdir())
    assert ask(suite, node, "start").success
    publisher.publish(String(data="so"))
    suite.spin_until(lambda: any(map(recorded, folder.iterdir())), "flush of the recording")
    assert recorder.end() == 0


def test_more_to_keep_than_the_disk_takes_is_reported_at_once(suite: Suite) -> None:
    folder = suite.folder / "recordings"
    for keep_GB, warned in ((0.001, False), (1e6, True)):
        recorder = suite.start("record_node", f"folder:={folder}", f"keep_GB:={keep_GB}", "topics:=[words]")
        recorder.wait_for_words("recording to")
        assert recorder.end() == 0
        assert ("has room for: the recording ends when it is full" in recorder.words()) is warned
