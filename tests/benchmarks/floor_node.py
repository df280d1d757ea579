"""The least that a Python node can do with a sample: one raw message in, three prepared ones out with its stamp."""

from __future__ import annotations

import rclpy
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE
from textile_twin_ros.messages import JointTemplate, PointTemplate, WrenchTemplate
from textile_twin_ros.node_runner import create_executor

JOINTS = ["main_shaft", "coupler", "rocker", "rod", "needle_bar"]


def main() -> None:
    """Copy stamps until the end."""
    rclpy.init()
    node = Node("floor_node")
    joints = JointTemplate(JOINTS).full_message(0, [0.0] * len(JOINTS), [0.0] * len(JOINTS))
    outputs = [
        (node.create_publisher(msgtype, topic, RELIABLE).publish, bytearray(message))
        for msgtype, topic, message in (
            (JointState, "joint_states", joints),
            (PointStamped, "needle/position", PointTemplate("base").message(0, 0.0, 0.0)),
            (WrenchStamped, "balancing_torque/predicted", WrenchTemplate("main_shaft").message(0, 0.0)),
        )
    ]

    def answer(raw: bytes) -> None:
        stamp = raw[4:12]
        for publish, message in outputs:
            message[4:12] = stamp
            publish(bytes(message))

    node.create_subscription(JointState, "main_shaft/angle", answer, RELIABLE, raw=True)
    executor = create_executor("events")
    executor.add_node(node)
    while rclpy.ok():
        executor.spin_until_future_complete(Future(), timeout_sec=1.0)


if __name__ == "__main__":
    main()
