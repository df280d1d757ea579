"""A machine whose encoder runs out and whose torque is filtered, live: declared, the residual is the sensor's noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

import textile_twin_core as ttc
from tests.generators.mill_recordings import healthy, record
from tests.ros.suite import RELIABLE, SECOND_NS, Suite
from tests.ros.test_live_topics import joint_state, stamp_of
from textile_twin_core.comparison.residual import ResidualStream, load_steps
from textile_twin_core.files import save_machine_file
from textile_twin_core.machine import Encoder, Sensors, TorqueSensor

RUN_OUT = ((0.0056, 0.0067), (0.0, 0.003))
FILTER = {"low_pass_hz": 20.0, "low_pass_order": 2}
TORQUE = "balancing_torque_Nm"
SETTLED_NS = 2 * SECOND_NS


@pytest.mark.slow
def test_the_residual_is_the_noise_and_the_numbers_are_those_of_the_core(suite: Suite, tmp_path: Path) -> None:
    case = healthy("tufting", 5, duration_s=5.0, run_up=False, loss=0.0)
    sensor = replace(case.torque, delay_s=0.003, gain=1.02, **FILTER)
    made = record(replace(case, encoder=replace(case.encoder, run_out_rad=RUN_OUT), torque=sensor))
    sensors = Sensors(Encoder(eccentricity_rad=RUN_OUT), TorqueSensor(1.02, 0.0, 0.003, **FILTER))
    machine = replace(ttc.machines.tufting(), sensors=sensors)
    save_machine_file(machine, tmp_path / "mill.yaml")

    twin = ttc.compile(machine, outputs=[TORQUE])
    offline = twin.session().step(made.angle_stamps_ns, made.angle)
    stream = ResidualStream(machine.sensors.torque, load_steps(twin))
    stream.predicted(offline.stamps.tolist(), offline[TORQUE].tolist(), offline.theta_rad.tolist())
    expected = {
        each.stamp_ns: each.residual_Nm
        for stamp, torque in zip(made.torque_stamps_ns.tolist(), made.torque.tolist(), strict=True)
        for each in stream.measured(stamp, torque)
    }

    outputs = '["balancing_torque/predicted", "balancing_torque/residual"]'
    suite.start("twin_node", f"machine:={tmp_path / 'mill.yaml'}", f"wait_for:={outputs}", "qos_depth:=10000")
    node = suite.node()
    predicted: list[WrenchStamped] = []
    residuals: list[WrenchStamped] = []
    node.create_subscription(WrenchStamped, "balancing_torque/predicted", predicted.append, RELIABLE)
    node.create_subscription(WrenchStamped, "balancing_torque/residual", residuals.append, RELIABLE)
    angle = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    torque = node.create_publisher(WrenchStamped, "balancing_torque/measured", RELIABLE)
    suite.spin_until(lambda: angle.get_subscription_count() and torque.get_subscription_count(), "twin")
    # The first torque makes the twin compute residuals; it is sent again with all others.
    first = int(made.torque_stamps_ns[0])
    torque.publish(_wrench(first, float(made.torque[0])))
    suite.spin_for(1.0)
    for stamp, reading in zip(made.angle_stamps_ns.tolist(), made.angle.tolist(), strict=True):
        angle.publish(joint_state(stamp, reading))
    for stamp, value in zip(made.torque_stamps_ns.tolist(), made.torque.tolist(), strict=True):
        torque.publish(_wrench(stamp, value))
    suite.spin_until(lambda: len(predicted) == len(offline) and len(residuals) >= len(expected), "residuals")

    assert [stamp_of(message) for message in predicted] == offline.stamps.tolist()
    live = [message.wrench.torque.z for message in predicted]
    np.testing.assert_allclose(live, offline[TORQUE], rtol=0.0, atol=1e-9)  # the true torque, without the filter
    live = [message.wrench.torque.z for message in residuals]
    stamps = [stamp_of(message) for message in residuals]
    np.testing.assert_allclose(live, [expected[stamp] for stamp in stamps], rtol=0.0, atol=1e-9)
    late = np.array([value for stamp, value in zip(stamps, live, strict=True) if stamp - first > SETTLED_NS])
    assert late.size > 1400
    assert np.sqrt(np.mean(late**2)) < 1.1 * 1.02 * sensor.noise_Nm


def _wrench(stamp_ns: int, torque_Nm: float) -> WrenchStamped:
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND_NS)
    message.wrench.torque.z = torque_Nm
    return message
