"""Edges of a toothed wheel, index pulses and a motor's current as the twin's inputs, live as offline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from tests.ros.suite import RELIABLE, SECOND_NS, Suite
from tests.ros.test_live_topics import stamp_of
from textile_twin_core.machine import with_encoder
from textile_twin_core.machines import tufting
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.machine_topics import MachineTopics
from textile_twin_core.recordings.replay import replay_bag
from textile_twin_ros.messages import HeaderTemplate
from textile_twin_ros.shaft_motion import TURN, Marks, SimulatedEncoder, SimulatedShaft

TEETH, MISSING, UNIT_NM = 36, 1, 2.5
MACHINE = with_encoder(tufting(), {"teeth": TEETH, "missing_teeth": MISSING})
WHEEL = ("angle_type:=edges", f"encoder_teeth:={TEETH}", f"encoder_missing_teeth:={MISSING}")


def passing(angles: list[float], seconds: float = 4.0) -> list[int]:
    """Stamps [ns] at which marks at these angles pass a shaft that runs up to 120 rpm."""
    motion = SimulatedShaft(rpm=120.0, run_up_s=1.0, ripple=0.05)
    times = Marks(angles, motion, SimulatedEncoder(0)).passed(0.1, seconds)
    return [50 * SECOND_NS + round(time * SECOND_NS) for time in times]


@pytest.mark.slow
def test_edges_and_current_live_as_offline(suite: Suite, tmp_path: Path) -> None:
    node = suite.node()
    teeth = passing([k * TURN / TEETH for k in range(TEETH - MISSING)])
    pulses = passing([TURN - 0.5 * TURN / TEETH])
    currents = list(range(teeth[40], teeth[-40], SECOND_NS // 50))
    with BagWriter(tmp_path / "sent") as bag:
        bag.write_events("main_shaft/angle", np.array(teeth))
        bag.write_events("main_shaft/index", np.array(pulses))
        bag.write_joint_states(
            "balancing_torque/measured", np.array(currents), ["main_shaft"], None, None, np.full(len(currents), 3.0)
        )
    with BagWriter(tmp_path / "replayed") as out:
        topics = MachineTopics(index="main_shaft/index", torque_unit_Nm=UNIT_NM)
        replay_bag(open_bag(tmp_path / "sent"), out, MACHINE, recorded=topics)
    offline = open_bag(tmp_path / "replayed").read_torques("balancing_torque/predicted")
    residuals = open_bag(tmp_path / "replayed").read_torques("balancing_torque/residual")

    heard: dict[str, list[WrenchStamped]] = {"predicted": [], "residual": []}
    for name, messages in heard.items():
        node.create_subscription(WrenchStamped, f"balancing_torque/{name}", messages.append, RELIABLE)
    said: list[str] = []
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda array: said.extend(status.message for status in array.status if status.name == "twin_node: outputs"),
        RELIABLE,
    )
    angle = node.create_publisher(Header, "main_shaft/angle", RELIABLE)
    index = node.create_publisher(Header, "main_shaft/index", RELIABLE)
    torque = node.create_publisher(JointState, "balancing_torque/measured", RELIABLE)
    words = (*WHEEL, "index:=true", "torque_type:=joint_state", f"torque_unit_Nm:={UNIT_NM}")
    suite.start("twin_node", *words, "wait_for:=[balancing_torque/predicted]")
    suite.spin_until(lambda: all(p.get_subscription_count() for p in (angle, index, torque)), "the twin")
    suite.spin_until(lambda: said and "residual" in said[-1], "residuals, once it has heard of the torque's publisher")
    template = HeaderTemplate("main_shaft")
    events = [(stamp, angle) for stamp in teeth] + [(stamp, index) for stamp in pulses]
    for stamp, publisher in sorted(events, key=lambda event: event[0]):
        publisher.publish(template.message(stamp))
    suite.spin_until(lambda: len(heard["predicted"]) >= len(offline), "predictions")
    for stamp in currents:
        message = JointState(name=["main_shaft"], effort=[3.0])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND_NS)
        torque.publish(message)
    suite.spin_until(lambda: heard["residual"], "residuals")
    suite.spin_for(0.5)
    assert [stamp_of(message) for message in heard["predicted"]] == offline.stamps.tolist()
    live = [message.wrench.torque.z for message in heard["predicted"]]
    np.testing.assert_allclose(live, offline.torque_Nm, rtol=0.0, atol=1e-9)
    assert len(offline) > 100
    # The torque came when its predictions were old; what is still paired is what the recording gives, in N m.
    known = dict(zip(residuals.stamps.tolist(), residuals.torque_Nm.tolist(), strict=True))
    for message in heard["residual"]:
        assert message.wrench.torque.z == pytest.approx(known[stamp_of(message)], abs=1e-9)


def test_edges_that_cannot_be_counted_are_reported_at_the_start(suite: Suite) -> None:
    program = suite.start("twin_node", "angle_type:=edges", "encoder_teeth:=60")
    assert program.wait() == 2
    assert "nothing marks tooth 0 of the wheel: set missing_teeth of the encoder" in program.words()
    assert "Traceback" not in program.words()


@pytest.mark.campaign
@pytest.mark.slow
def test_a_simulated_wheel(suite: Suite) -> None:
    node = suite.node()
    heard: list[JointState] = []
    node.create_subscription(JointState, "joint_states", heard.append, RELIABLE)
    suite.start("twin_node", *WHEEL, "wait_for:=[joint_states]").wait_for_words("warming up")
    machine = suite.start("shaft_node", "angle_type:=edges", *WHEEL[1:], "rpm:=240.0", "run_up_s:=0.5", "ripple:=0.0")
    suite.spin_until(lambda: len(heard) > 200, "joint states")
    machine.end()
    place = list(heard[0].name).index("main_shaft")
    angles = np.array([message.position[place] for message in heard])
    # At a steady speed each edge stands at its tooth, and tooth 0 at zero.
    off = np.remainder(angles[100:] * TEETH / TURN + 0.5, 1.0) - 0.5
    assert np.abs(off).max() < 0.02
    assert set(np.rint(np.mod(angles[100:], TURN) * TEETH / TURN).astype(int) % TEETH) == set(range(TEETH - MISSING))
