"""The suite fixture: skipped as a whole where rclpy is not installed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")


@pytest.fixture
def suite(tmp_path: Path) -> Iterator[Any]:
    """Nodes in a ROS domain of the test's own."""
    from tests.ros.suite import running_suite

    with running_suite(tmp_path) as running:
        yield running
