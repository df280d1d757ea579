"""Diagnostics once a second, and at once when a level changes."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray

from tests.ros.suite import RELIABLE, Suite
from textile_twin_ros.diagnostics import OK, WARN, DiagnosticsPublisher, Status


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
