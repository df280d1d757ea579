"""Stamps and quality of service of messages go into a recording, and out of it again."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64, String

from tests.ros.suite import RELIABLE, Suite
from textile_twin_core.recordings import BagWriter, OfferedQos, open_bag
from textile_twin_core.recordings.schemas import FLOAT64


def test_a_recording_has_the_times_of_sending_and_of_reception(suite: Suite) -> None:
    """A recorder without processor time receives all at once what was sent every 20 ms."""
    node, bag = suite.node(), suite.folder / "bag"
    publisher = node.create_publisher(Float64, "speed", RELIABLE)
    recorder = suite.start("record_node", f"bag:={bag}", "topics:=[speed]", f"types:=['speed={FLOAT64}']")
    suite.spin_until(publisher.get_subscription_count, "the recorder")
    publisher.publish(Float64(data=-1.0))
    suite.spin_for(0.3)
    os.kill(recorder.process.pid, signal.SIGSTOP)
    sent = []
    for number in range(40):
        sent.append(time.time_ns())
        publisher.publish(Float64(data=float(number)))
        time.sleep(0.02)
    os.kill(recorder.process.pid, signal.SIGCONT)
    suite.spin_for(0.5)
    assert recorder.end() == 0, suite.words()
    messages = [(logged, published) for _, logged, published, _ in open_bag(bag).timed_messages()]
    assert len(messages) == 41
    logged, published = np.array(messages[1:]).T
    assert np.all(published - np.array(sent) >= 0) and np.median(published - np.array(sent)) < 5_000_000
    assert np.all(logged >= published) and np.max(logged - published) > 500_000_000
    assert np.median(np.diff(logged)) < 1_000_000 < 15_000_000 < np.median(np.diff(published))


def test_a_replay_offers_what_was_recorded(suite: Suite) -> None:
    offers = {"driver": OfferedQos("best_effort"), "words": OfferedQos(durability="transient_local", depth=3)}
    with BagWriter(suite.folder / "bag") as out:
        out.add_topic("driver", FLOAT64, offers["driver"])
        out.add_topic("words", "std_msgs/msg/String", offers["words"])
        for number in range(5):
            out.write("driver", 10**18 + number * 10**7, serialize_message(Float64(data=float(number))))
            out.write("words", 10**18 + number * 10**7, serialize_message(String(data=str(number))))
    replay = suite.start("replay_node", f"bag:={suite.folder / 'bag'}", "wait_timeout_s:=0.0", "exit_when_done:=false")
    replay.wait_for_words("played 10 messages")
    node, late = suite.node(), []
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
    node.create_subscription(String, "words", lambda message: late.append(message.data), latched)
    suite.spin_until(lambda: len(late) == 3, "the latched messages")
    (driver,) = node.get_publishers_info_by_topic("/driver")
    assert driver.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert late == ["2", "3", "4"] and replay.end() == 0
