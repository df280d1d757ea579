"""record_node and replay_node on their own: power loss, services, silence, repetition, recorded time."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from tests.ros.suite import RELIABLE, SECOND_NS, Suite, recorded, shaft_angles, wait_until, write_bag
from tests.ros.test_live_topics import joint_state, stamp_of
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.schemas import MessageSchema, message_schema
from textile_twin_ros.endpoints import latched_qos
from textile_twin_ros.topic_subscriptions import Recorder, TopicSubscriptions


def test_a_kill_loses_a_second_at_most(suite: Suite) -> None:
    recording = suite.folder / "cut"
    recorder = suite.start("record_node", f"bag:={recording}", "topics:=[main_shaft/angle]")
    node = suite.node()
    publisher = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "recorder")
    for stamp, angle in zip(*shaft_angles(2000), strict=True):
        publisher.publish(joint_state(stamp, angle))
    # Flushed from a timer, although nothing more comes.
    suite.spin_until(lambda: recorded(recording) == 2000, "flush of the recording")
    assert recorder.end(signal.SIGKILL) == -signal.SIGKILL
    bag = open_bag(recording)
    assert bag.truncated
    np.testing.assert_array_equal(bag.read_angles().stamps, shaft_angles(2000)[0])


@pytest.mark.slow
def test_recording_by_service(suite: Suite) -> None:
    recording = suite.folder / "runs" / "run"
    recorder = suite.start("record_node", f"bag:={recording}", "start:=false", "topics:=[words]")
    node = suite.node()
    publisher = node.create_publisher(String, "words", RELIABLE)

    def ask(what: str) -> Any:
        return suite.call(node, Trigger, f"record_node/{what}", Trigger.Request())

    suite.spin_until(publisher.get_subscription_count, "recorder")
    publisher.publish(String(data="not recorded"))
    assert not ask("stop").success
    for run in (1, 2):
        assert ask("start").success
        assert not ask("start").success
        for number in range(10 * run):
            publisher.publish(String(data=str(number)))
        publisher.wait_for_all_acked()
        suite.spin_until(lambda: ask("stop").message.startswith(f"{10 * run} messages"), "stop")  # noqa: B023
    assert recorder.end() == 0
    for name, count in (("run", 10), ("run_2", 20)):
        assert open_bag(recording.with_name(name)).topics["/words"].count == count


def test_every_recording_by_service_has_what_was_said_once(suite: Suite) -> None:
    """Record latched topics published before the start; earlier messages of other topics are left out."""
    recording = suite.folder / "run"
    known = ("topics:=[robot_description, states, words]", "types:=[states=std_msgs/msg/String]")
    recorder = suite.start("record_node", f"bag:={recording}", "start:=false", *known)
    node = suite.node()
    qos = {"robot_description": latched_qos(), "states": latched_qos(), "words": RELIABLE}

    def ask(what: str) -> Any:
        return suite.call(node, Trigger, f"record_node/{what}", Trigger.Request())

    suite.spin_until(lambda: node.count_subscribers("states"), "recorder, before there is a publisher")
    publishers = {topic: node.create_publisher(String, topic, each) for topic, each in qos.items()}

    def say(text: str) -> None:
        for publisher in publishers.values():
            publisher.publish(String(data=text))
            publisher.wait_for_all_acked()
        suite.spin_for(0.5)  # taken by the recorder, too

    for publisher in publishers.values():
        suite.spin_until(publisher.get_subscription_count, "recorder")
    say("first")
    said = {"run": ["first"], "run_2": ["first"], "run_3": ["second", "third"]}
    for name, texts in said.items():
        if name == "run_3":
            say("second")
        assert ask("start").success
        if name == "run_3":
            say("third")
        assert ask("stop").success, name
        bag = open_bag(recording.with_name(name))
        for topic in qos:
            heard = [deserialize_message(raw, String).data for _, _, raw in bag.raw_messages([f"/{topic}"])]
            assert heard == (texts if topic != "words" else texts[1:]), (name, topic)
    assert recorder.end() == 0


@pytest.mark.slow
def test_a_place_that_is_taken_or_taken_away(suite: Suite) -> None:
    recording = suite.folder / "run"
    recorder = suite.start("record_node", f"bag:={recording}", "topics:=[words]")
    recorder.wait_for_words("recording to")
    node = suite.node()

    def ask(what: str) -> Any:
        return suite.call(node, Trigger, f"record_node/{what}", Trigger.Request())

    assert ask("stop").success
    write_bag(suite.folder / "run_2", *shaft_angles(10))
    refused = ask("start")
    assert not refused.success and "run_2: is there already" in refused.message
    assert ask("start").message == str(suite.folder / "run_3")
    (suite.folder / "run_3").rename(suite.folder / "mine")
    assert recorder.wait() == 2
    assert recorder.words().splitlines()[-1] == (
        f"record_node: {suite.folder / 'run_3'}: removed or renamed while it was recorded: the recording ends after"
        " 0 messages"
    )


def test_a_recorder_that_another_overwrites_ends(suite: Suite) -> None:
    recording = suite.folder / "run"
    first = suite.start("record_node", f"bag:={recording}", "topics:=[words]")
    first.wait_for_words("recording to")
    second = suite.start("record_node", f"bag:={recording}", "topics:=[words]", "overwrite:=true")
    assert first.wait() == 2
    assert first.words().splitlines()[-1] == (
        f"record_node: {recording}: overwritten by another recording while it was recorded: the recording ends after"
        " 0 messages"
    )
    publisher = suite.node().create_publisher(String, "words", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "the second recorder")
    publisher.publish(String(data="of the second"))
    suite.spin_until(lambda: recorded(recording) == 1, "flush of the recording")
    assert second.end() == 0
    assert open_bag(recording).message_count == 1


def test_a_recorder_that_stood_still_says_so(suite: Suite) -> None:
    """Its queues hold half a second; it is stopped for two."""
    recorder = suite.start("record_node", f"bag:={suite.folder / 'run'}", "topics:=[words]", "queue_s:=0.5")
    recorder.wait_for_words("recording to")
    node = suite.node()
    states: list[tuple[bytes, str]] = []
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda array: states.extend((s.level, s.message) for s in array.status),
        RELIABLE,
    )
    publisher = node.create_publisher(String, "words", RELIABLE)

    def publish(seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            publisher.publish(String(data="so"))
            suite.spin_for(0.05)

    def standstills() -> list[float]:
        words = re.findall(r"no processor time for (\d+\.\d) s .*messages of that time are missing", recorder.words())
        return [float(seconds) for seconds in words]

    suite.spin_until(publisher.get_subscription_count, "recorder")
    publish(1.0)
    recorder.process.send_signal(signal.SIGSTOP)
    publish(1.8)
    recorder.process.send_signal(signal.SIGCONT)
    suite.spin_until(lambda: standstills() and max(standstills()) >= 1.7, "words of the log")
    suite.spin_until(
        lambda: any(level == DiagnosticStatus.WARN and "no processor time" in text for level, text in states),
        "diagnostics",
    )
    # A busy computer may stop it, too, and every process waits for a little now and then: that is not reported.
    assert min(standstills()) > 1.2
    assert recorder.end() == 0


def test_a_recorder_without_data_says_so(suite: Suite) -> None:
    recorder = suite.start(
        "record_node", f"bag:={suite.folder / 'empty'}", "topics:=[main_shaft/angle]", "no_data_timeout_s:=0.3"
    )
    recorder.wait_for_words("no data to record")
    assert re.search("/main_shaft/angle: (no publisher found there yet|no node publishes there)", recorder.words())
    assert recorder.end() == 0
    assert open_bag(suite.folder / "empty").message_count == 0


def test_repetition_goes_on_in_time(suite: Suite) -> None:
    stamps, angles = shaft_angles(100)
    replay = suite.start(
        "replay_node",
        f"bag:={write_bag(suite.folder / 'played', stamps, angles)}",
        "loop:=true",
        "rate:=2.0",
        "clock_rate_hz:=100.0",
    )
    node = suite.node()
    heard: list[JointState] = []
    clocks: list[int] = []
    node.create_subscription(Clock, "/clock", lambda m: clocks.append(m.clock.sec * SECOND_NS + m.clock.nanosec), 10)
    node.create_subscription(JointState, "main_shaft/angle", heard.append, RELIABLE)
    suite.spin_until(lambda: len(heard) >= 250 and clocks, "two repetitions")
    assert replay.end() == 0
    # What a busy test has not come to yet is still there.
    suite.spin_until(lambda: abs(clocks[-1] - stamp_of(heard[-1])) < SECOND_NS, "a clock that goes with the messages")
    times = np.array([stamp_of(message) for message in heard])
    period = 2_000_000
    np.testing.assert_array_equal(times[:100], stamps)
    np.testing.assert_allclose(np.diff(times), period, atol=2)
    np.testing.assert_array_equal([message.position[0] for message in heard[100:200]], angles)
    assert (np.diff(clocks) > 0).all()
    assert stamps[0] <= clocks[0] and clocks[-1] > stamps[-1]


@pytest.mark.campaign
@pytest.mark.slow
def test_recorders_side_by_side_keep_their_own_machine_each(suite: Suite) -> None:
    """Three that start in the same moment in the same folder, two of them without a namespace of its own."""
    spaces = ("/", "/machine_3", "/mill/m7")
    folder = suite.folder / "recordings"
    machines = [suite.start("shaft_node", "rate_hz:=200", remaps=[f"__ns:={space}"]) for space in spaces]
    for machine in machines:
        machine.wait_for_words("samples a second")
    recorders = [
        suite.start("record_node", f"folder:={folder}", remaps=[f"__ns:={space}"]) for space in (*spaces, "/machine_3")
    ]
    for recorder in recorders:
        recorder.wait_for_words("recording to")

    def holds_enough(path: Path) -> bool:
        space = next((s for s in spaces[1:] if s.strip("/").replace("/", "_") in path.name), "").rstrip("/")
        angles, torques = f"{space}/main_shaft/angle", f"{space}/balancing_torque/measured"
        return recorded(path, angles) > 200 and bool(recorded(path, torques) and recorded(path, "/diagnostics"))

    wait_until(lambda: all(map(holds_enough, folder.iterdir())), "enough of every machine")
    for program in (*recorders, *machines):
        assert program.end() == 0, program.words()
    bags = [open_bag(path) for path in sorted(folder.iterdir())]
    assert len(bags) == 4
    for bag in bags:
        space = next((s for s in spaces[1:] if s.strip("/").replace("/", "_") in bag.path.name), "").rstrip("/")
        counts = {topic: info.count for topic, info in bag.topics.items()}
        assert counts.keys() == {f"{space}/main_shaft/angle", f"{space}/balancing_torque/measured", "/diagnostics"}
        assert min(counts.values()) > 0 and counts[f"{space}/main_shaft/angle"] > 200
        named = {name for _, _, raw in bag.raw_messages(["/diagnostics"]) for name in _status_names(raw)}
        assert {name.split(":")[0] for name in named} == {f"{space.lstrip('/')}/record_node".lstrip("/")}


def _status_names(raw: bytes) -> list[str]:
    return [status.name for status in deserialize_message(raw, DiagnosticArray).status]


def test_an_empty_recording_is_removed(suite: Suite) -> None:
    folder = suite.folder / "recordings"
    recorder = suite.start("record_node", f"folder:={folder}")
    recorder.wait_for_words("recording to")
    assert recorder.end() == 0
    assert recorder.words().splitlines()[-1] == "nothing came: no recording is kept"
    assert not list(folder.iterdir())


def test_publishers_that_come_later_are_heard_however_they_offer(suite: Suite) -> None:
    """A driver that is started again with the quality of service of a sensor, and a latched topic that no longer is."""
    reliable, latched, sensor = QoSProfile(depth=100), latched_qos(), qos_profile_sensor_data
    everything = suite.folder / "all"
    recorder = suite.start("record_node", f"bag:={everything}", "types:=[states=std_msgs/msg/String]")
    recorder.wait_for_words("recording to")
    node = suite.node()
    best_effort = (("driver", 1), ("states", 0), ("states", 1))
    said: dict[tuple[str, int], list[int]] = {}

    def publish(topic: str, turn: int, qos: QoSProfile) -> None:
        publisher = node.create_publisher(String, topic, qos)
        suite.spin_until(publisher.get_subscription_count, f"recorder on {topic}")
        numbers = said[topic, turn] = []

        def say() -> bool:
            numbers.append(len(numbers))
            publisher.publish(String(data=f"{turn} {numbers[-1]}"))
            return bool(_numbers(everything, topic, turn))

        for _ in range(1 if qos is latched else 20):
            say()
            suite.spin_for(0.01)
        if (topic, turn) in best_effort:  # which promises nothing until both sides know each other
            suite.spin_until(say, f"anything of {topic}")
        suite.spin_until(lambda: numbers[-1] in _numbers(everything, topic, turn), f"what was said last on {topic}")
        node.destroy_publisher(publisher)

    for topic, *both in (("driver", reliable, sensor), ("words", latched, reliable), ("states", sensor, reliable)):
        for turn, qos in enumerate(both):
            publish(topic, turn, qos)
    other = node.create_publisher(Clock, "driver", reliable)
    recorder.wait_for_words("/driver now carries rosgraph_msgs/msg/Clock, too, which is not recorded")
    node.destroy_publisher(other)
    assert recorder.end() == 0
    for (topic, turn), numbers in said.items():
        heard = _numbers(everything, topic, turn)
        # From then on all of it comes, on a loopback.
        begun = heard[0] if (topic, turn) in best_effort else 0
        assert heard == numbers[begun:], (topic, turn)


def _numbers(recording: Path, topic: str, turn: int) -> list[int]:
    """The numbers of one publisher's messages, in their order; empty while the disk has none of the topic."""
    if not recorded(recording, f"/{topic}"):
        return []
    raws = [raw for _, _, raw in open_bag(recording).raw_messages([f"/{topic}"])]
    words = [deserialize_message(raw, String).data.split() for raw in raws]
    return [int(number) for publisher, number in words if int(publisher) == turn]


def test_a_topic_whose_definition_is_not_found_is_left_out(suite: Suite, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a type that its package declares in IDL alone, on a topic that appears while the others are recorded."""

    def found(msgtype: str) -> MessageSchema:
        if msgtype == "std_msgs/msg/Float64":
            raise RecordingError(f"message type {msgtype}: no definition found")
        return message_schema(msgtype)

    for module in ("textile_twin_ros.topic_subscriptions", "textile_twin_core.recordings.bag_write"):
        monkeypatch.setattr(f"{module}.message_schema", found)
    node = suite.node()
    publishers = [node.create_publisher(kind, name, RELIABLE) for kind, name in ((Float64, "odd"), (String, "words"))]
    suite.spin_until(lambda: all(node.count_publishers(each.topic_name) for each in publishers), "the publishers")
    node.executor_name = "single"  # type: ignore[attr-defined]
    topics = TopicSubscriptions(cast(Recorder, node), ("odd", "words"), (), 10, lambda *_: None)
    with BagWriter(suite.folder / "bag") as writer:
        topics.write_to(writer)
        topics.discover()
    assert topics.topics == ["/words"] and list(open_bag(suite.folder / "bag").topics) == ["/words"]
