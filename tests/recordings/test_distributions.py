"""Equal messages of recordings and nodes in each distribution of ROS, by definitions and hashes of rosbags."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.schemas import message_schema

DISTRIBUTIONS = (Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL)
WRITTEN = (
    "diagnostic_msgs/msg/DiagnosticArray",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/WrenchStamped",
    "rcl_interfaces/msg/FloatingPointRange",
    "rcl_interfaces/msg/ParameterDescriptor",
    "rcl_interfaces/msg/SetParametersResult",
    "rosgraph_msgs/msg/Clock",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/ColorRGBA",
    "std_msgs/msg/Float64",
    "std_msgs/msg/Header",
    "std_msgs/msg/String",
    "visualization_msgs/msg/Marker",
    "visualization_msgs/msg/MarkerArray",
)
"""Types that nodes publish, read or take as parameters, and that recordings hold."""
OF_LYRICAL_ALONE = "lifecycle_msgs/msg/TransitionEvent"
"""Published by rclpy for a lifecycle node: the one type that a node's topics have and Lyrical has changed."""

each_distribution = pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=lambda store: store.name.lower())


@pytest.fixture
def uncached() -> Iterator[None]:
    """Schemas looked up again, before and after."""
    message_schema.cache_clear()
    yield
    message_schema.cache_clear()


@each_distribution
def test_definitions_and_hashes_are_those_of_each_distribution(distribution: Stores) -> None:
    store = get_typestore(distribution)
    for name in WRITTEN:
        schema = message_schema(name)
        assert schema.type_hash == store.hash_rihs01(name), name
        assert schema.text == store.generate_msgdef(name, ros_version=2)[0], name


def test_a_type_that_a_distribution_has_changed_is_written_as_in_the_sourced_one(
    uncached: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashes = []
    for distro, store in (("jazzy", Stores.ROS2_JAZZY), ("lyrical", Stores.ROS2_LYRICAL), ("mine", Stores.ROS2_JAZZY)):
        monkeypatch.setenv("ROS_DISTRO", distro)
        message_schema.cache_clear()
        hashes.append(message_schema(OF_LYRICAL_ALONE).type_hash)
        assert hashes[-1] == get_typestore(store).hash_rihs01(OF_LYRICAL_ALONE)
    assert hashes[0] != hashes[1]


@each_distribution
def test_a_recording_is_read_with_the_messages_of_each_distribution(tmp_path: Path, distribution: Stores) -> None:
    stamps = np.arange(5) * 10_000_000
    with BagWriter(tmp_path / "bag") as out:
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], np.linspace(0.0, 1.0, 5))
        out.write_wrenches("balancing_torque/measured", stamps, np.linspace(2.0, 3.0, 5))
    store = get_typestore(distribution)
    found: dict[str, list[float]] = {}
    with Reader(tmp_path / "bag") as bag:
        for connection, _, raw in bag.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            value = message.position[0] if connection.msgtype.endswith("JointState") else message.wrench.torque.z
            found.setdefault(connection.topic.lstrip("/"), []).append(float(value))
    assert found["main_shaft/angle"] == list(np.linspace(0.0, 1.0, 5))
    assert found["balancing_torque/measured"] == list(np.linspace(2.0, 3.0, 5))


@each_distribution
def test_a_recording_of_each_distribution_is_read(tmp_path: Path, distribution: Stores) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.enums import StoragePlugin

    store = get_typestore(distribution)
    Float64 = store.types["std_msgs/msg/Float64"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/main_shaft/angle", "std_msgs/msg/Float64", typestore=store)
        for k in range(4):
            bag.write(connection, k * 1000, store.serialize_cdr(Float64(data=0.5 * k), "std_msgs/msg/Float64"))
    angles = open_bag(tmp_path / "bag").read_angles()
    assert list(angles.angles_rad) == [0.0, 0.5, 1.0, 1.5]
