"""Cases of live topics: silence, bad samples, other types, best effort, namespaces, a recording once more."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

import textile_twin_core as ttc
from tests.ros.suite import RELIABLE, SECOND_NS, Suite, shaft_angles
from textile_twin_ros.endpoints import latched_qos

PREDICTED = "balancing_torque/predicted"


def joint_state(stamp_ns: int, angle: float, velocity: float | None = None, joint: str = "main_shaft") -> JointState:
    message = JointState(name=["other", joint], position=[0.0, float(angle)])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(stamp_ns), SECOND_NS)
    if velocity is not None:
        message.velocity = [0.0, float(velocity)]
    return message


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec)


class Bench:
    """Test node that feeds a twin and collects its messages."""

    def __init__(
        self, suite: Suite, namespace: str = "", msgtype: Any = JointState, qos: QoSProfile = RELIABLE
    ) -> None:
        self.suite, self.node = suite, suite.node()
        self.torques: list[WrenchStamped] = []
        self.points: list[PointStamped] = []
        self.diagnostics: dict[str, DiagnosticStatus] = {}
        self.said: list[str] = []
        self.angle = self.node.create_publisher(msgtype, f"{namespace}/main_shaft/angle", qos)
        self.node.create_subscription(WrenchStamped, f"{namespace}/{PREDICTED}", self.torques.append, RELIABLE)
        self.node.create_subscription(PointStamped, f"{namespace}/needle/position", self.points.append, RELIABLE)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._keep, RELIABLE)

    def _keep(self, message: DiagnosticArray) -> None:
        self.diagnostics |= {status.name.split(": ")[1]: status for status in message.status}
        self.said += [status.message for status in message.status]

    def send(self, stamps: Any, angles: Any) -> None:
        """Publish samples once the twin listens."""
        self.suite.spin_until(self.angle.get_subscription_count, "subscription of the twin")
        for stamp, angle in zip(stamps, angles, strict=True):
            self.angle.publish(joint_state(stamp, angle))

    def values(self, status: str) -> dict[str, str]:
        return {entry.key: entry.value for entry in self.diagnostics[status].values}


def start_twin(suite: Suite, *parameters: str, **words: Any) -> Any:
    return suite.start("twin_node", f'wait_for:=["{PREDICTED}", "needle/position"]', *parameters, **words)


@pytest.mark.slow
def test_silence_is_reported(suite: Suite) -> None:
    # In recorded time, too, which does not go on when nothing is played.
    twin = suite.start("twin_node", "no_data_timeout_s:=0.5", "use_sim_time:=true")
    bench = Bench(suite, namespace="/elsewhere")
    twin.wait_for_words("no data on /main_shaft/angle")
    suite.spin_until(
        lambda: all(
            words in bench.diagnostics.get("main_shaft/angle", DiagnosticStatus()).message
            for words in ("no data", "no node publishes")
        ),
        "diagnostics of the silence",
    )
    status = bench.diagnostics["main_shaft/angle"]
    assert status.level == DiagnosticStatus.ERROR
    assert status.hardware_id == "tufting"
    assert "sensor_msgs/msg/JointState is published on /elsewhere/main_shaft/angle" in status.message


@pytest.mark.slow
def test_another_type_is_reported(suite: Suite) -> None:
    twin = suite.start("twin_node", "no_data_timeout_s:=0.5")
    Bench(suite, msgtype=Float64)
    twin.wait_for_words("this node wants sensor_msgs/msg/JointState")


def test_bad_samples_are_rejected_and_counted(suite: Suite) -> None:
    start_twin(suite)
    bench = Bench(suite)
    stamps, angles = shaft_angles(300)
    bad_stamps, bad_angles = list(stamps), list(angles)
    for place, (stamp, angle) in {
        50: (stamps[50] - 1_000_000, math.nan),
        100: (stamps[99], angles[99]),  # its stamp comes again
        150: (stamps[120], angles[120]),  # late
        200: (stamps[200] - 1_000_000, math.inf),
    }.items():
        bad_stamps.insert(place, stamp)
        bad_angles.insert(place, angle)
    bench.send(bad_stamps[:250], bad_angles[:250])
    # A speed divided by no time, and an invalid stamp.
    bench.angle.publish(joint_state(bad_stamps[250], bad_angles[250], velocity=math.inf))
    no_stamp = joint_state(0, 1.0)
    no_stamp.header.stamp.sec, no_stamp.header.stamp.nanosec = 2**31 - 1, 2**32 - 1
    bench.angle.publish(no_stamp)
    bench.send(bad_stamps[251:], bad_angles[251:])
    other = JointState(name=["brake"], position=[1.0])
    bench.angle.publish(other)
    suite.spin_until(lambda: len(bench.torques) >= 298 and len(bench.points) >= 298, "predictions")

    twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
    offline = twin.session(shaft="causal").step(stamps, angles)
    assert [stamp_of(message) for message in bench.torques] == offline.stamps.tolist()
    torques = [message.wrench.torque.z for message in bench.torques]
    np.testing.assert_allclose(torques, offline["balancing_torque_Nm"], rtol=0.0, atol=1e-9)
    assert bench.torques[0].header.frame_id == "main_shaft"
    assert bench.points[0].header.frame_id == "base"

    def states() -> bool:
        if "main_shaft/angle" not in bench.diagnostics:
            return False
        values = bench.values("main_shaft/angle")
        return values["accepted"] == "300" and values["other_joints"] == "1"  # which came last

    suite.spin_until(states, "diagnostics")
    values = bench.values("main_shaft/angle")
    assert (values["rejected_not_finite"], values["rejected_duplicate_stamp"], values["rejected_older_stamp"]) == (
        "2", "1", "1",
    )  # fmt: skip
    assert values["unreadable"] == "1"
    assert "a whole second or more in its nanoseconds" in suite.words()


def test_messages_that_are_refused_do_not_flood_the_log(suite: Suite) -> None:
    twin = start_twin(suite)
    bench = Bench(suite)
    suite.spin_until(bench.angle.get_subscription_count, "subscription of the twin")
    for number in range(100):
        bench.angle.publish(JointState(name=[f"robot_{number % 2}_{'x' * 1000}"], position=[1.0]))
    suite.spin_until(
        lambda: "main_shaft/angle" in bench.diagnostics and bench.values("main_shaft/angle")["other_joints"] == "100",
        "refusals",
    )
    suite.spin_until(lambda: "no message has joint" in twin.words(), "a line in the log")
    (line,) = [line for line in twin.words().splitlines() if "no message has joint" in line]
    assert "there are robot_0_xxx" in line and len(line) < 500


@pytest.mark.slow
def test_a_recording_played_again_restarts(suite: Suite) -> None:
    start_twin(suite)
    bench = Bench(suite)
    stamps, angles = shaft_angles(1000)
    bench.send(stamps, angles)
    suite.spin_until(lambda: len(bench.torques) == 998, "predictions")
    bench.send(stamps, angles)
    # Ten samples show that time has been set back; the estimator needs three, the tenth being its first.
    suite.spin_until(lambda: len(bench.torques) == 998 + 1000 - 9 - 2, "predictions of the second time")


def test_float64_is_stamped_on_arrival(suite: Suite) -> None:
    start_twin(suite, "angle_type:=float64")
    bench = Bench(suite, msgtype=Float64)
    suite.spin_until(bench.angle.get_subscription_count, "subscription of the twin")
    before = bench.node.get_clock().now().nanoseconds
    for number in range(50):
        bench.angle.publish(Float64(data=0.03 * number))
        bench.suite.spin_until(lambda n=number: len(bench.torques) >= n - 1, "prediction")  # type: ignore[misc]
    stamps = [stamp_of(message) for message in bench.torques]
    assert len(stamps) == 48
    assert (
        before < stamps[0] and stamps == sorted(set(stamps)) and stamps[-1] <= bench.node.get_clock().now().nanoseconds
    )


def test_best_effort_publishers_are_heard(suite: Suite) -> None:
    twin = start_twin(suite)
    best_effort = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.BEST_EFFORT)
    bench = Bench(suite, qos=best_effort)
    twin.wait_for_words("with best effort")
    suite.spin_until(bench.angle.get_subscription_count, "subscription of the twin")
    samples = zip(*shaft_angles(300_000), strict=True)

    def predicted() -> bool:
        bench.angle.publish(joint_state(*next(samples)))
        return len(bench.torques) >= 40

    suite.spin_until(predicted, "predictions")  # best effort promises nothing until both sides know each other


def test_a_namespace_is_a_machine(suite: Suite) -> None:
    words = start_twin(suite, remaps=["__ns:=/mill/m7"])
    bench = Bench(suite, namespace="/mill/m7")
    descriptions: list[str] = []
    bench.node.create_subscription(
        String, "/mill/m7/robot_description", lambda message: descriptions.append(message.data), latched_qos()
    )
    bench.send(*shaft_angles(20))
    suite.spin_until(lambda: len(bench.torques) == 18 and descriptions, "predictions and description")
    assert descriptions[0].startswith("<?xml") and "needle_bar" in descriptions[0]
    answer = suite.call(bench.node, Trigger, "/mill/m7/twin_node/reset", Trigger.Request())
    assert answer.success
    assert words.end() == 0


def test_outputs_without_a_listener_are_not_computed(suite: Suite) -> None:
    suite.start("twin_node")
    node: Node = suite.node()
    states: list[str] = []
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: states.extend(status.message for status in message.status if status.name.endswith(": outputs")),
        RELIABLE,
    )
    suite.spin_until(lambda: states and states[-1] == "computing nothing: no topic has a subscriber", "diagnostics")
    node.create_subscription(PointStamped, "needle/position", lambda message: None, RELIABLE)
    suite.spin_until(lambda: states[-1] == "computing needle/position", "diagnostics of one subscriber")


@pytest.mark.campaign
@pytest.mark.slow
def test_every_machine_has_its_topics(suite: Suite) -> None:
    tools = {"tufting": "needle", "handloom_beatup": "beater", "elliptic_gear_beatup": "sley", "needle_transfer": ""}
    assert set(tools) == set(ttc.machines.NAMES)
    node = suite.node()
    points: dict[str, list[PointStamped]] = {}
    joints: dict[str, list[JointState]] = {}
    publishers = []
    for machine, tool in tools.items():
        listened = f"[joint_states, {tool}/position]" if tool else "[joint_states]"
        suite.start("twin_node", f"machine:={machine}", f"wait_for:={listened}", remaps=[f"__ns:=/mill/{machine}"])
        points[machine], joints[machine] = [], []
        namespace = f"/mill/{machine}"
        node.create_subscription(JointState, f"{namespace}/joint_states", joints[machine].append, RELIABLE)
        if tool:
            node.create_subscription(PointStamped, f"{namespace}/{tool}/position", points[machine].append, RELIABLE)
        publishers.append(node.create_publisher(JointState, f"{namespace}/main_shaft/angle", RELIABLE))
    suite.spin_until(lambda: all(publisher.get_subscription_count() for publisher in publishers), "all twins")
    stamps, angles = shaft_angles(100)
    for stamp, angle in zip(stamps, angles, strict=True):
        for publisher in publishers:
            publisher.publish(joint_state(stamp, angle))
    suite.spin_until(lambda: all(len(heard) == 98 for heard in joints.values()), "joints of all machines")
    suite.spin_until(lambda: all(len(points[name]) == 98 for name in tools if tools[name]), "tools of all machines")
    assert list(joints["needle_transfer"][0].name) == ["element_1", "element_2", "element_3"]
    for name, tool in tools.items():
        if not tool:
            continue
        machine = ttc.machines.create(name)
        offline = ttc.compile(machine, outputs=[f"{tool}_position_m"]).session().step(stamps, angles)
        assert [stamp_of(message) for message in points[name]] == offline.stamps.tolist()
        x, y = (np.array([getattr(message.point, axis) for message in points[name]]) for axis in ("x", "y"))
        travel = offline[f"{tool}_position_m"]
        if tool == "needle":
            way = -(y - y[0])
        else:  # along an arc: the chord of what it has gone since the first sample is shorter, by its curvature
            chord, arc = np.hypot(x - x[0], y - y[0]), np.abs(travel - travel[0])
            radius = machine.measures[0].radius_m
            way = np.sign(travel - travel[0]) * 2.0 * radius * np.arcsin(chord / (2.0 * radius))
            assert (chord <= arc + 1e-12).all()
        np.testing.assert_allclose(way, travel - travel[0], rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_efforts_speeds_and_thinned_joints(suite: Suite) -> None:
    start_twin(suite, "torque_type:=joint_state", "joint_states_rate_hz:=50.0", "joint:=crank")
    bench = Bench(suite)
    residuals: list[WrenchStamped] = []
    joints: list[JointState] = []
    bench.node.create_subscription(WrenchStamped, "balancing_torque/residual", residuals.append, RELIABLE)
    bench.node.create_subscription(JointState, "joint_states", joints.append, RELIABLE)
    effort = bench.node.create_publisher(JointState, "balancing_torque/measured", RELIABLE)
    suite.spin_until(lambda: bench.angle.get_subscription_count() and effort.get_subscription_count(), "twin")
    suite.spin_until(
        lambda: (
            "outputs" in bench.diagnostics
            and "joint_states" in bench.diagnostics["outputs"].message
            and "residual" in bench.diagnostics["outputs"].message
        ),
        "outputs chosen",
    )
    stamps, angles = shaft_angles(500, start_ns=0)
    speeds = np.gradient(np.unwrap(angles), stamps * 1e-9)
    for stamp, angle, speed in zip(stamps, angles, speeds, strict=True):
        bench.angle.publish(joint_state(stamp, angle, speed, joint="crank"))
        message = JointState(name=["crank"], effort=[2.0])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(stamp), SECOND_NS)
        effort.publish(message)
    twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
    offline = twin.session().step(stamps, angles, speeds)
    suite.spin_until(lambda: len(bench.torques) == len(offline) == len(residuals), "torques and residuals")
    torques = np.array([message.wrench.torque.z for message in bench.torques])
    np.testing.assert_allclose(torques, offline["balancing_torque_Nm"], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose([message.wrench.torque.z for message in residuals], 2.0 - torques, rtol=0.0, atol=1e-12)
    # One joint state in each of the fifty periods of a second.
    suite.spin_until(lambda: len(joints) == 50, "thinned joint states")
    assert (np.diff([stamp_of(message) // 20_000_000 for message in joints]) == 1).all()
    assert list(joints[0].effort) == []
