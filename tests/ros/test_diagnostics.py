"""Diagnostics once a second, and at once when a level changes."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tests.ros.suite import RELIABLE, Suite
from textile_twin_core.recordings.schemas import WRENCH
from textile_twin_ros import diagnostics, endpoints, inputs, messages
from textile_twin_ros.diagnostics import OK, STALE, WARN, DiagnosticsPublisher, InputWatch, Status
from textile_twin_ros.endpoints import describe_publishers


def test_a_level_that_changes_is_published_with_the_next_look(suite: Suite) -> None:
    node = suite.node()
    heard: list[int] = []
    looks: list[int] = []
    changed_at = 9  # no multiple of the two looks in a second

    def collect() -> list[Status]:
        if not node.count_subscribers("/diagnostics"):
            return []
        looks.append(len(looks))
        return [Status("one", WARN if looks[-1] >= changed_at else OK, str(looks[-1]))]

    node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda array: heard.extend(int(s.message) for s in array.status), RELIABLE
    )
    DiagnosticsPublisher(node, lambda: "", collect)
    suite.spin_until(lambda: heard and heard[-1] > changed_at, "diagnostics after the change")
    assert changed_at in heard
    assert len(heard) < len(looks)


def test_publishers_are_reported_by_their_names_which_may_come_late(
    suite: Suite, monkeypatch: pytest.MonkeyPatch
) -> None:
    node, now = suite.node(), [100.0]
    monkeypatch.setattr(inputs, "monotonic", lambda: now[0])
    kind = messages.TORQUE_READERS["wrench"]
    source = inputs.SampleInput(node, "torque", kind, "", 10, "auto", lambda: 60.0, lambda block: None)
    drive = TopicEndpointInfo(node_name="drive", node_namespace="/", topic_type=WRENCH)
    late = TopicEndpointInfo(
        node_name="_NODE_NAME_UNKNOWN_", node_namespace="_NODE_NAMESPACE_UNKNOWN_", topic_type=WRENCH
    )
    seen = [drive]
    monkeypatch.setattr(node, "get_publishers_info_by_topic", lambda topic: seen)
    assert source.status().level == WARN and "drive" in source.status().message  # waits for the first message
    seen.append(late)
    now[0] += 1.0
    for text in (source.status().message, describe_publishers(node, "torque", WRENCH)):
        assert "UNKNOWN" not in text and "2 publishers" not in text
        assert "a publisher not known by name yet publishes" in text
    now[0] += 1.5  # no node of ROS, perhaps
    source.watch.took(1)
    assert "2 publishers give /torque: /drive, a publisher not known by name yet;" in source.status().message
    seen[1] = TopicEndpointInfo(node_name="old", node_namespace="/mill", topic_type=WRENCH)
    assert "2 publishers give /torque: /drive, /mill/old;" in source.status().message


def test_who_has_just_started_may_not_know_yet_who_publishes(suite: Suite, monkeypatch: pytest.MonkeyPatch) -> None:
    node = suite.node()
    for started, words in ((math.inf, "no publisher found there yet"), (-math.inf, "no node publishes there")):
        monkeypatch.setattr(endpoints, "STARTED", started)
        assert describe_publishers(node, "torque", WRENCH) == words


def test_the_rate_is_that_of_the_last_second(suite: Suite, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(diagnostics, "time", SimpleNamespace(monotonic=lambda: now[0]))
    watch = InputWatch(suite.node(), "/angle", lambda: 2.0, lambda: "no node publishes there")
    states = []
    for look in range(12):
        now[0] += 0.5
        watch.took(50 if look < 6 else 100)
        states.append(watch.status("angle", {}).message)
    assert states[3:6] == ["100.0 Hz"] * 3 and states[8:] == ["200.0 Hz"] * 4


def test_silence_that_lasts_is_reported_ever_more_seldom(
    suite: Suite, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr(diagnostics, "time", SimpleNamespace(monotonic=lambda: now[0]))
    watch = InputWatch(suite.node(), "/angle", lambda: 2.0, lambda: "no node publishes there")
    watch.took()

    def silences(hours: float) -> list[float]:
        for _ in range(round(hours * 3600)):
            now[0] += 1.0
            level = watch.status("angle", {}).level
        assert level == STALE
        return [float(text) for text in re.findall(r"no data on /angle for (\S+) s", capfd.readouterr().err)]

    assert silences(3.2) == [3, 13, 73, 673, 4273, 7873, 11473]
    watch.took()
    assert watch.status("angle", {}).level == OK
    assert "data on /angle again" in capfd.readouterr().err
    assert silences(0.01) == [3, 13]
