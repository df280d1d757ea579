"""Messages of a bridge to a PLC: its angles and torques, predictions, its own diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE


class Bridged:
    """Messages in the order they came; `status` is the name of the bridge's diagnostics."""

    def __init__(self, node: Node, status: str) -> None:
        self.angles: list[JointState] = []
        self.torques: list[WrenchStamped] = []
        self.predicted: list[WrenchStamped] = []
        self.states: list[DiagnosticStatus] = []
        node.create_subscription(JointState, "main_shaft/angle", self.angles.append, RELIABLE)
        node.create_subscription(WrenchStamped, "balancing_torque/measured", self.torques.append, RELIABLE)
        node.create_subscription(WrenchStamped, "balancing_torque/predicted", self.predicted.append, RELIABLE)
        node.create_subscription(DiagnosticArray, "/diagnostics", lambda said: self._hear(said, status), RELIABLE)

    def _hear(self, said: DiagnosticArray, name: str) -> None:
        self.states.extend(status for status in said.status if status.name == name)
