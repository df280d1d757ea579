"""The bytes that the nodes read and write, against the messages of rclpy."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from tests.ros.suite import SECOND_NS
from textile_twin_core.contact import ContactEvent
from textile_twin_core.twin.predictor import StampedEvent
from textile_twin_ros import messages
from textile_twin_ros.contact_events import contact_events, contact_message

numbers = st.floats(allow_nan=False)
stamps = st.integers(0, 2**31 * SECOND_NS - 1)
names = st.lists(st.text(st.characters(codec="ascii", exclude_characters="\0")), max_size=4, unique=True)


@given(stamp=stamps, torque=numbers, frame=st.text(st.characters(codec="utf-8", exclude_characters="\0")))
def test_wrench_bytes_are_the_message(stamp: int, torque: float, frame: str) -> None:
    message = deserialize_message(messages.WrenchTemplate(frame).message(stamp, torque), WrenchStamped)
    assert message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec == stamp
    assert message.header.frame_id == frame
    assert message.wrench.torque.z == torque
    assert message.wrench.force.x == message.wrench.torque.y == 0.0


@given(stamp=stamps, x=numbers, y=numbers)
def test_point_bytes_are_the_message(stamp: int, x: float, y: float) -> None:
    message = deserialize_message(messages.PointTemplate("base").message(stamp, x, y), PointStamped)
    assert message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec == stamp
    assert (message.point.x, message.point.y, message.point.z) == (x, y, 0.0)


@given(stamp=stamps, joints=names, value=numbers)
def test_joint_bytes_are_the_message(stamp: int, joints: list[str], value: float) -> None:
    positions = [value + k for k in range(len(joints))]
    velocities = [-value - k for k in range(len(joints))]
    raw = messages.JointTemplate(joints).full_message(stamp, positions, velocities)
    message = deserialize_message(raw, JointState)
    assert message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec == stamp
    assert list(message.name) == joints
    assert (list(message.position), list(message.velocity), list(message.effort)) == (positions, velocities, [])


@given(stamp=stamps, before=names, value=numbers, velocity=st.none() | numbers)
def test_joint_is_read_at_its_place(stamp: int, before: list[str], value: float, velocity: float | None) -> None:
    reader = messages.JointReader("main shaft of the machine", ("position", "velocity", "effort"))
    joints = [*before, "main shaft of the machine", "after"]
    message = JointState(name=joints, position=[float(k) for k in range(len(before))] + [value, 7.0])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND_NS)
    if velocity is not None:
        message.velocity = [0.0] * len(before) + [velocity, 0.0]
    for _ in range(2):  # found in the first, looked up in the second
        at, values = reader.read(serialize_message(message))
        assert at == stamp and values[0] == value and math.isnan(values[2])
        assert values[1] == velocity or (velocity is None and math.isnan(values[1]))


def test_layouts_may_change_between_messages() -> None:
    reader = messages.JointReader("b", ("position",))
    for joints in (["b"], ["a", "b"], ["b", "a"], ["long name", "b"], ["b"]):
        message = JointState(name=joints, position=[float(joints.index("b") + 10 * k) for k in range(len(joints))])
        assert reader.read(serialize_message(message))[1] == [message.position[joints.index("b")]]
    with pytest.raises(messages.ForeignJointsError, match="no joint 'b', only: a"):
        reader.read(serialize_message(JointState(name=["a"], position=[1.0])))
    assert reader.read(serialize_message(JointState(name=["b"], position=[1.0])))[1] == [1.0]
    with pytest.raises(messages.ForeignJointsError, match="no position of joint 'b'"):
        reader.read(serialize_message(JointState(name=["b"])))
    assert reader.read(serialize_message(JointState(name=["b"], position=[2.0])))[1] == [2.0]


def test_damaged_bytes_are_no_message() -> None:
    whole = serialize_message(JointState(name=["b"], position=[1.0]))
    for raw in (b"", whole[:3], whole[:20], whole[:-12], b"\0\7" + whole[2:]):
        with pytest.raises(messages.MessageError):
            messages.JointReader("b", ("position",)).read(raw)
    whole = bytearray(whole)
    whole[8:12] = (SECOND_NS).to_bytes(4, "little")  # of the last second that a header can tell, it would make another
    with pytest.raises(messages.MessageError, match="a whole second or more"):
        messages.JointReader("b", ("position",)).read(bytes(whole))


@given(stamp=stamps, torque=numbers)
def test_torque_is_read(stamp: int, torque: float) -> None:
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND_NS)
    message.wrench.torque.z = torque
    assert messages.TorqueReader().read(serialize_message(message)) == (stamp, [torque])
    assert messages.read_float64(serialize_message(Float64(data=torque))) == (None, (torque,))


@given(stamp=st.integers(0, 2**30 * SECOND_NS), by=st.integers(-(2**29) * SECOND_NS, 2**29 * SECOND_NS))
def test_stamps_are_shifted(stamp: int, by: int) -> None:
    raw = messages.shift_stamp(messages.PointTemplate("base").message(stamp, 1.0, 2.0), by)
    message = deserialize_message(raw, PointStamped)
    assert message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec == stamp + by
    assert message.point.y == 2.0


def test_headers_are_known() -> None:
    assert messages.has_header(messages.message_class("sensor_msgs/msg/JointState"))
    assert not messages.has_header(messages.message_class("std_msgs/msg/Float64"))
    with pytest.raises(LookupError, match="nowhere_msgs/msg/None"):
        messages.message_class("nowhere_msgs/msg/None")


def test_contact_events_come_back_as_they_went() -> None:
    event = ContactEvent(0.25, "impact", "cone", ("element_1", "element_3"), 0.25, 1.2202, 6.22e-3, 1e-3, -2e-4)
    sent = [StampedEvent(SECOND_NS + 7, event), StampedEvent(SECOND_NS + 9, replace(event, kind="touch"))]
    message = deserialize_message(serialize_message(contact_message(sent, "needle_transfer")), DiagnosticArray)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 7)
    heard = contact_events(message)
    assert [(stamp, got.kind, got.name, got.bodies, got.impulse_Ns) for stamp, got in heard] == [
        (stamp, got.kind, got.name, got.bodies, got.impulse_Ns) for stamp, got in sent
    ]
    message.status[0].values.clear()
    assert len(contact_events(message)) == 1
