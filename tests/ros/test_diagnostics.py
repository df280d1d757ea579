"""Diagnostics once a second, and at once when a level changes."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray

from tests.ros.suite import RELIABLE, Suite
from textile_twin_ros import diagnostics
from textile_twin_ros.diagnostics import OK, STALE, WARN, DiagnosticsPublisher, InputWatch, Status


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


def test_silence_that_lasts_is_told_ever_more_seldom(
    suite: Suite, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr(diagnostics, "time", SimpleNamespace(monotonic=lambda: now[0]))
    watch = InputWatch(suite.node(), "/angle", lambda: 2.0, lambda: "nobody publishes there")
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
