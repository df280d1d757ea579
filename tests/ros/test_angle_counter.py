"""An angle whose counter passes its end: continued as it arrives, as `replay` does in a recording."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import JointState

import textile_twin_core as ttc
from tests.ros.suite import RELIABLE, Suite
from tests.ros.test_live_topics import joint_state
from textile_twin_core.machine import with_encoder
from textile_twin_ros.inputs import AngleInput, Sample
from textile_twin_ros.sensor_parameters import SensorParameters

STEP_RAD = 2.0 * np.pi / 4000.0


@pytest.mark.parametrize(("signed", "known"), [(False, True), (True, False)])
def test_a_counter_of_16_bits_goes_on_and_a_wrapped_angle_stays(signed: bool, known: bool, suite: Suite) -> None:
    node, taken = suite.node(), list[Sample]()
    machine = with_encoder(ttc.machines.tufting(), {"resolution_rad": STEP_RAD} if known else {})
    angle = AngleInput(node, SensorParameters(), machine, 10_000, taken.extend)
    publisher = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "the subscription")
    number = np.arange(3000)
    counts = np.rint(np.cumsum(60.0 * (1.0 + 0.1 * np.sin(0.05 * number))))
    low = -(2**15) if signed else 0
    logged = (counts - low) % 2**16 + low
    assert np.count_nonzero(np.abs(np.diff(logged)) > 2**15) > 1
    for k, reading in enumerate(logged * STEP_RAD):
        publisher.publish(joint_state(k * 2_000_000 + 10**18, float(reading)))
    suite.spin_until(lambda: len(taken) == number.size, "every sample")
    np.testing.assert_allclose(np.diff([value for _, value, _ in taken]), np.diff(counts) * STEP_RAD, atol=1e-9)
    angle.restart()
    taken.clear()
    wrapped = np.mod(counts[:500] * STEP_RAD, 2.0 * np.pi)
    for k, reading in enumerate(wrapped):
        publisher.publish(joint_state(k * 2_000_000 + 10**18, float(reading)))
    suite.spin_until(lambda: len(taken) == wrapped.size, "every sample of a wrapped angle")
    assert [value for _, value, _ in taken] == wrapped.tolist()
    angle.destroy()
