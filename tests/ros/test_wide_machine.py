"""A wide machine live: topics of its elastic shaft agree with the offline session."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from visualization_msgs.msg import MarkerArray

import textile_twin_core as ttc
from tests.ros.suite import RELIABLE, Suite, shaft_angles
from tests.ros.test_live_topics import joint_state, stamp_of
from textile_twin_core.machine import EvenShaft, ShaftPlace
from textile_twin_ros.endpoints import latched_qos
from textile_twin_ros.machine_namespace import published_by_twins
from textile_twin_ros.outputs import topics_of

MACHINE = """
machine: tufting
name: narrow
shaft:
  diameter_m: 0.03
  length_m: 1.2
  stations: 3
  damping_Nms_rad: 0.2
  drive: {inertia_kgm2: 0.3, slip_Nms_rad: 20}
"""
COUNT = 300
SCALARS = ("twist_rad", "needle_lag_rad", "needle_spread_m")


@pytest.mark.slow
def test_the_whole_width_is_published(suite: Suite) -> None:
    file = suite.folder / "narrow.yaml"
    file.write_text(MACHINE, encoding="utf-8")
    topics: dict[str, Any] = {name: Float64 for name in SCALARS}
    topics |= {"torque_piece_s1_s2_Nm": WrenchStamped, "needle_at_s3/position": PointStamped}
    topics |= {"joint_states": JointState}
    suite.start("twin_node", f"machine:={file}", f"wait_for:={list(topics)}".replace("'", '"'))
    node = suite.node()
    heard: dict[str, list[Any]] = {name: [] for name in topics}
    described: list[String] = []
    marked: list[MarkerArray] = []
    for name, kind in topics.items():
        node.create_subscription(kind, name, heard[name].append, RELIABLE)
    node.create_subscription(String, "robot_description", described.append, latched_qos())
    node.create_subscription(MarkerArray, "markers", marked.append, latched_qos())
    angle = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    suite.spin_until(angle.get_subscription_count, "subscription of the twin")
    stamps, angles = shaft_angles(COUNT)
    for stamp, value in zip(stamps, angles, strict=True):
        angle.publish(joint_state(stamp, value))

    machine = ttc.load_machine(file)
    assert isinstance(machine, ttc.Machine)
    joints = ("station_s3", "needle_bar_at_s3")
    outputs = [*SCALARS, "torque_piece_s1_s2_Nm", "needle_at_s3_position_m", "needle_position_m"]
    outputs += ["point_F_y_m", *(name for joint in joints for name in machine.joint_outputs[joint])]
    offline = ttc.compile(machine, outputs=outputs).session().step(stamps, angles)
    suite.spin_until(lambda: all(len(each) >= len(offline) for each in heard.values()), "all topics")

    def close(live: list[float], name: str) -> None:
        np.testing.assert_allclose(live, offline[name], rtol=0.0, atol=1e-9, err_msg=name)

    assert np.ptp(offline["needle_lag_rad"]) > 1e-5
    for name in SCALARS:
        close([message.data for message in heard[name]], name)
    close([message.wrench.torque.z for message in heard["torque_piece_s1_s2_Nm"]], "torque_piece_s1_s2_Nm")
    assert heard["torque_piece_s1_s2_Nm"][0].header.frame_id == "station_s2"
    tool = [message.point for message in heard["needle_at_s3/position"]]
    assert {point.z for point in tool} == {0.8}
    assert [stamp_of(message) for message in heard["needle_at_s3/position"]] == offline.stamps.tolist()
    # The needle goes straight down: its place is its travel.
    fall = offline["point_F_y_m"][0] + offline["needle_position_m"][0]
    np.testing.assert_allclose([point.y for point in tool], fall - offline["needle_at_s3_position_m"], atol=1e-9)
    states: list[JointState] = heard["joint_states"]
    assert list(states[0].name) == list(machine.joint_outputs)
    for joint in joints:
        place = list(states[0].name).index(joint)
        for values, output in zip(("position", "velocity"), machine.joint_outputs[joint], strict=True):
            close([getattr(state, values)[place] for state in states], output)

    suite.spin_until(lambda: described and marked, "description")
    robot = Xml.fromstring(described[0].data)
    moving = {joint.get("name") for joint in robot.iter("joint") if joint.get("type") != "fixed"}
    assert moving == set(machine.joint_outputs)
    assert {round(marker.pose.position.z, 12) for marker in marked[0].markers} == {0.0, 0.4, 0.8}
    assert len({(marker.ns, marker.id) for marker in marked[0].markers}) == len(marked[0].markers) == 6


@pytest.mark.slow
def test_a_second_encoder_corrects_the_twist_as_offline(suite: Suite) -> None:
    file = suite.folder / "narrow.yaml"
    file.write_text(MACHINE + "  second_encoder_at: s3\n", encoding="utf-8")
    suite.start("twin_node", f"machine:={file}", 'wait_for:=["twist_rad"]')
    node = suite.node()
    heard: list[Float64] = []
    node.create_subscription(Float64, "twist_rad", heard.append, RELIABLE)
    first = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    second = node.create_publisher(JointState, "main_shaft/second_angle", RELIABLE)
    suite.spin_until(lambda: first.get_subscription_count() and second.get_subscription_count(), "subscriptions")
    stamps, angles = shaft_angles(COUNT)
    far = angles + 0.01 + 1e-3 * np.sin(angles)
    for stamp, value in zip(stamps, far, strict=True):
        second.publish(joint_state(stamp, value))
    assert second.wait_for_all_acked(Duration(seconds=10))
    suite.spin_for(1.0)
    for stamp, value in zip(stamps, angles, strict=True):
        first.publish(joint_state(stamp, value))

    twin = ttc.compile(ttc.load_machine(file), outputs=["twist_rad"])
    with_second, alone = twin.session(), twin.session().step(stamps, angles)
    with_second.take_second(stamps, far)
    offline = with_second.step(stamps, angles)
    assert np.abs(offline["twist_rad"] - alone["twist_rad"]).max() > 1e-5
    suite.spin_until(lambda: len(heard) >= len(offline), "all twists")
    np.testing.assert_allclose([message.data for message in heard], offline["twist_rad"], rtol=0.0, atol=1e-9)


@pytest.mark.campaign
def test_the_live_view_draws_every_linkage(suite: Suite) -> None:
    rerun_chunk = pytest.importorskip("rerun.chunk")
    file, drawing = suite.folder / "narrow.yaml", suite.folder / "live.rrd"
    file.write_text(MACHINE, encoding="utf-8")
    view = suite.start("view_node", f"machine:={file}", f"file:={drawing}", "port:=0")
    node = suite.node()
    joints = node.create_publisher(JointState, "joint_states", RELIABLE)
    suite.spin_until(lambda: joints.get_subscription_count() == 2, "both subscriptions of the view")
    names = ["main_shaft", *(f"station_s{k}" for k in range(3, -1, -1))]
    for number in range(50):
        angle = 0.03 * number
        message = JointState(name=names, position=[angle, angle - 3e-3, angle - 2e-3, angle - 1e-3, angle])
        message.header.stamp.sec, message.header.stamp.nanosec = 20, 2_000_000 * number
        joints.publish(message)
    suite.spin_for(1.0)
    assert view.end() == 0, view.words()
    turned = {}
    for chunk in rerun_chunk.RrdReader(str(drawing)).stream():
        if not chunk.is_static and chunk.entity_path.startswith("/world"):
            turned[chunk.entity_path] = chunk.to_record_batch().to_pydict()
    assert "/world/base/shaft/line" in turned
    cranks = {path: rows for path, rows in turned.items() if path.endswith("/links/l1")}
    assert set(cranks) == {f"/world/base/{under}/l1" for under in ("links", "row/1/links", "row/2/links")}
    first, _, last = (_crank_angles(cranks[path]) for path in sorted(cranks))
    scale = np.unwrap(first - last) / 2e-3
    np.testing.assert_allclose(scale, np.round(scale[0]), rtol=1e-3)  # factor of the drawn twist
    assert np.round(scale[0]) in {float(f"{digit}e{power}") for digit in (1, 2, 5) for power in range(5)}


def _crank_angles(rows: dict[str, Any]) -> Any:
    """Angles about z that were drawn."""
    (column,) = (values for name, values in rows.items() if name.endswith("quaternion"))
    turns = np.array([value[0] for value in column])
    return 2.0 * np.arctan2(turns[:, 2], turns[:, 3])


def test_the_readme_names_every_topic_of_a_wide_machine() -> None:
    root = Path(__file__).parents[2]
    machine = ttc.load_machine(root / "examples" / "wide_tufting.yaml")
    text = (root / "ros2_ws/src/textile_twin_ros/README.md").read_text(encoding="utf-8")
    rows = {cell for line in text.splitlines() if line.startswith("| `") for cell in re.findall(r"`([^`]+)`", line)}
    for topic, msgtype in topics_of(machine).items():
        general = re.sub(r"_at_s\d+", "_at_S", re.sub(r"piece_s\d+_s\d+_", "piece_A_B_", topic))
        row = next(line for line in text.splitlines() if line.startswith("| `") and f"`{general}`" in line)
        assert general in rows and msgtype.replace("/msg/", "/") in row


def test_a_recording_played_again_leaves_out_what_the_twin_says() -> None:
    kinds = {"twist_rad": "std_msgs/msg/Float64", "torque_piece_s0_s1_Nm": "geometry_msgs/msg/WrenchStamped"}
    own = {"/m/needle_at_s2/position": "geometry_msgs/msg/PointStamped"} | {f"/m/{k}": v for k, v in kinds.items()}
    kept = {"/m/main_shaft/angle": "sensor_msgs/msg/JointState", "/m/speed_rad_s": "std_msgs/msg/Float64"}
    assert published_by_twins(own | kept) == set(own)


def test_the_tool_of_every_station_in_the_robot_is_where_the_engine_has_it() -> None:
    # Forward kinematics of the URDF, joint by joint, with staggered linkages.
    even = EvenShaft(0.05, 2.0, 2)
    places = even.places([ShaftPlace(), ShaftPlace(1.3)])
    machine = replace(ttc.machines.tufting(), shaft=even.main_shaft(), linkages=places)
    names = [name for pair in machine.joint_outputs.values() for name in pair[:1]]
    points = [f"point_F_at_{station}_{axis}_m" for station in ("s1", "s2") for axis in "xy"]
    time = np.arange(5) * 1e-3
    found = ttc.compile(machine, outputs=[*names, *points]).evaluate(20.0 * time + 0.4, 20.0, 0.0, time=time)
    values = {joint: found[pair[0]][-1] for joint, pair in machine.joint_outputs.items()}
    robot = Xml.fromstring(machine.urdf())
    parents = {joint.find("child").get("link"): joint for joint in robot.iter("joint")}  # type: ignore[union-attr]
    for tip, station, z in (("needle_tip", "s1", 0.0), ("needle_tip_at_s2", "s2", 1.0)):
        place = np.zeros(3)
        link = tip
        while link != "base":
            joint = parents[link]
            place = _pose(joint, values.get(joint.get("name"), 0.0), place)
            link = joint.find("parent").get("link")  # type: ignore[union-attr, assignment]
        expected = (found[f"point_F_at_{station}_x_m"][-1], found[f"point_F_at_{station}_y_m"][-1], z)
        np.testing.assert_allclose(place, expected, rtol=0.0, atol=1e-9)


def _pose(joint: Any, value: float, point: Any) -> Any:
    """A point of the child's frame in the parent's."""
    x, y, z = (float(number) for number in joint.find("origin").get("xyz").split())
    angle = float(joint.find("origin").get("rpy").split()[2])
    if joint.get("type") == "prismatic":
        point = point + np.array([value, 0.0, 0.0])
    elif joint.get("type") != "fixed":
        c, s = math.cos(value), math.sin(value)
        point = np.array([c * point[0] - s * point[1], s * point[0] + c * point[1], point[2]])
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * point[0] - s * point[1] + x, s * point[0] + c * point[1] + y, point[2] + z])
