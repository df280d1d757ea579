"""Messages that wait for a recorder at its end."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from tests.ros.suite import PATIENCE_S, RELIABLE, free_domain, node_environment
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_ros import record_node
from textile_twin_ros.record_node import RecordNode

COUNT = 500


@pytest.fixture
def recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RecordNode]:
    """A recorder in this process without a spin: all `COUNT` messages wait in its queues."""
    domain, claim = free_domain()
    for name, value in node_environment(tmp_path, domain).items():
        monkeypatch.setenv(name, value)
    words = (f"bag:={tmp_path / 'run'}", "topics:=[words]", "types:=[words=std_msgs/msg/String]")
    rclpy.init(args=["test", "--ros-args", *(word for text in words for word in ("-p", text))])
    node, other = RecordNode(), Node("other")
    try:
        publisher = other.create_publisher(String, "words", RELIABLE)
        deadline = time.monotonic() + PATIENCE_S
        while not publisher.get_subscription_count():
            assert time.monotonic() < deadline
            time.sleep(0.02)
        for number in range(COUNT):
            publisher.publish(String(data=str(number)))
        assert publisher.wait_for_all_acked()
        yield node
    finally:
        other.destroy_node()
        node.destroy_node()
        rclpy.shutdown()
        claim.close()


def test_what_waits_at_the_end_is_recorded(recorder: RecordNode, tmp_path: Path) -> None:
    recorder.close()
    heard = [deserialize_message(raw, String).data for _, _, raw in open_bag(tmp_path / "run").raw_messages(["/words"])]
    assert heard == [str(number) for number in range(COUNT)]


def test_the_end_comes_within_its_time_however_much_waits(
    recorder: RecordNode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_node, "LONGEST_DRAIN_S", -1.0)
    recorder.close()
    assert open_bag(tmp_path / "run").message_count == 0


def test_a_full_disk_at_the_end_is_reported(recorder: RecordNode, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(BagWriter, "write", full)
    with pytest.raises(RecordingError, match="No space left on device: the recording ends after 0 messages"):
        recorder.close()
