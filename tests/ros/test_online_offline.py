"""Live and offline give the same numbers for all four machines, through gaps, a reversal and a restart."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import JointState

import textile_twin_core as ttc
from tests.ros.suite import RELIABLE, SECOND_NS, Suite
from tests.ros.test_live_topics import joint_state, stamp_of
from textile_twin_core.arrays import FloatArray, IntArray

RATE_HZ = 125.0


def rough_shaft() -> tuple[IntArray, FloatArray]:
    """A run-up with lost samples, a pause of 1.5 s, a stop, a turn backwards: stamps [ns], angles [rad]."""
    rng = np.random.default_rng(11)
    time = np.arange(0.0, 4.0, 1.0 / RATE_HZ)
    speed = np.interp(time, [0.0, 0.8, 2.4, 2.8, 3.2, 4.0], [0.0, 12.0, 12.0, 0.0, -6.0, -6.0])
    angle = np.cumsum(speed) / RATE_HZ
    kept = (rng.random(time.size) > 0.03) & ~((time > 1.0) & (time < 2.0))
    stamps = 20 * SECOND_NS + np.rint((time + 0.5 * (time > 1.5)) * 1e9).astype(np.int64)
    step = 2.0 * np.pi / 2**14
    return stamps[kept], np.floor(np.mod(angle, 2.0 * np.pi) / step)[kept] * step


def offline(name: str, stamps: IntArray, angles: FloatArray, outputs: list[str]) -> tuple[list[int], list[FloatArray]]:
    """Result of an offline session with the same samples sent twice."""
    session = ttc.compile(ttc.machines.create(name), outputs=outputs).session(shaft="causal")
    samples = session.step(np.tile(stamps, 2), np.tile(angles, 2))
    return samples.stamps.tolist(), [samples[output] for output in outputs]


def _has(messages: list[JointState], count: int) -> bool:
    return len(messages) >= count


@pytest.mark.slow
def test_all_machines_live_as_offline(suite: Suite) -> None:
    node = suite.node()
    heard: dict[str, list[JointState]] = {name: [] for name in ttc.machines.NAMES}
    publishers = []
    for name, messages in heard.items():
        words = (f"machine:={name}", "wait_for:=[joint_states]", "qos_depth:=10000")
        suite.start("twin_node", *words, remaps=[f"__ns:=/{name}"])
        node.create_subscription(JointState, f"/{name}/joint_states", messages.append, RELIABLE)
        publishers.append(node.create_publisher(JointState, f"/{name}/main_shaft/angle", RELIABLE))
    suite.spin_until(lambda: all(publisher.get_subscription_count() for publisher in publishers), "all twins")
    stamps, angles = rough_shaft()
    for stamp, angle in [*zip(stamps, angles, strict=True)] * 2:
        for publisher in publishers:
            publisher.publish(joint_state(stamp, angle))
    for name, messages in heard.items():
        linkage = isinstance(ttc.machines.create(name), ttc.Machine)
        joints = ["main_shaft", "coupler", "rocker"] if linkage else ["element_1", "element_2", "element_3"]
        outputs = [f"joint_{joint}_position" if linkage else f"{joint}_position_m" for joint in joints]
        expected, columns = offline(name, stamps, angles, outputs)
        suite.spin_until(partial(_has, messages, len(expected)), f"joint states of {name}")
        assert [stamp_of(message) for message in messages] == expected, name
        for joint, column in zip(joints, columns, strict=True):
            live = [message.position[list(message.name).index(joint)] for message in messages]
            np.testing.assert_allclose(live, column, rtol=0.0, atol=1e-9, err_msg=f"{name} {joint}")
    assert all("went back and go on from there" in program.words() for program in suite.processes)
