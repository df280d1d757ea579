"""Topics that several use: a twin that would hear itself, other joints on its input, parameters of another name."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE, Suite, node_environment, shaft_angles
from tests.ros.test_endings import keep_signals
from tests.ros.test_live_topics import Bench, joint_state, start_twin
from textile_twin_ros.parameters import ignored_entries

ITSELF = [
    (["main_shaft/angle:=/joint_states"], "/joint_states", "-r joint_states:=twin/joint_states"),
    (["main_shaft/angle:=joint_states", "__ns:=/m1"], "/m1/joint_states", "-r joint_states:=twin/joint_states"),
    (["joint_states:=main_shaft/angle"], "/main_shaft/angle", "-r main_shaft/angle:=TOPIC"),
    (
        ["balancing_torque/measured:=balancing_torque/predicted"],
        "/balancing_torque/predicted",
        "-r balancing_torque/predicted:=twin/balancing_torque/predicted",
    ),
    (["/mill/m7/balancing_torque/residual:=/t", "balancing_torque/measured:=/t", "__ns:=/mill/m7"], "/t", "residual"),
    (["main_shaft/angle:=/x", "needle/position:=/x"], "/x", "needle/position"),
]


@pytest.mark.parametrize(("remaps", "topic", "advice"), ITSELF)
def test_a_twin_that_would_hear_itself_does_not_start(
    remaps: list[str],
    topic: str,
    advice: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in node_environment(tmp_path, domain=101).items():
        monkeypatch.setenv(name, value)
    words = [word for remap in remaps for word in ("-r", remap)]
    with keep_signals():
        assert importlib.import_module("textile_twin_ros.twin_node").main(["twin_node", "--ros-args", *words]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("twin_node: the input ") and f" is {topic}, which this node publishes" in line
    assert advice in line


def test_a_twin_that_is_configured_later_refuses_then(suite: Suite) -> None:
    twin = suite.start("twin_node", "autostart:=false", remaps=["main_shaft/angle:=/joint_states"])
    node = suite.node()
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    assert not suite.call(node, ChangeState, "twin_node/change_state", request).success
    twin.wait_for_words("-r joint_states:=twin/joint_states")


def test_another_driver_on_the_topic_is_no_fault(suite: Suite) -> None:
    twin = start_twin(suite)
    bench = Bench(suite)
    rollers = suite.node().create_publisher(JointState, "main_shaft/angle", RELIABLE)
    stamps, angles = shaft_angles(300)
    suite.spin_until(bench.angle.get_subscription_count, "subscription of the twin")
    for stamp, angle in zip(stamps.tolist(), angles.tolist(), strict=True):
        rollers.publish(JointState(name=["feed_roller", "take_up"], position=[1.0, 2.0]))
        rollers.publish(JointState(name=["main_shaft"], effort=[2.0]))
        bench.angle.publish(joint_state(stamp, angle))
    suite.spin_until(lambda: len(bench.torques) == 298, "every prediction")

    def counted() -> bool:
        return "main_shaft/angle" in bench.diagnostics and bench.values("main_shaft/angle")["other_joints"] == "600"

    suite.spin_until(counted, "diagnostics")
    assert bench.values("main_shaft/angle")["received"] == "300"
    assert bench.diagnostics["main_shaft/angle"].level == DiagnosticStatus.OK, bench.diagnostics["main_shaft/angle"]
    # The drive falls silent, and the rollers' driver goes on.
    suite.spin_until(
        lambda: (
            rollers.publish(JointState(name=["feed_roller"], position=[1.0]))
            or "no message has joint 'main_shaft', there are feed_r" in bench.diagnostics["main_shaft/angle"].message
        ),
        "diagnostics of the joint",
    )
    assert "stop all but one" not in twin.words()


@pytest.mark.parametrize(
    ("entries", "name", "words"),
    [
        (["twin_node"], "/twin_node", ""),
        (["twin_node"], "/m1/twin_node", "'twin_node' is for /twin_node and is ignored, as this node is /m1/"),
        (["/**/twin_node"], "/m1/twin_node", ""),
        (["/**"], "/mill/m1/twin_node", ""),
        (["/*/twin_node"], "/m1/twin_node", ""),
        (["/*/twin_node"], "/mill/m1/twin_node", "write /mill/m1/twin_node, or /**/twin_node"),
        (["/**", "twin_node"], "/m1/twin_node", "'twin_node' is for /twin_node"),
        (["m1/twin_node", "m2/twin_node"], "/m2/twin_node", ""),
        (["m1/twin_node", "m2/twin_node"], "/m3/twin_node", "'m1/twin_node', 'm2/twin_node' is for"),
        (["twin_node"], "/left", "is ignored, as this node is /left"),
        (["shaft_node"], "/m1/twin_node", ""),
    ],
)
def test_entries_of_other_names_are_noted(entries: list[str], name: str, words: str) -> None:
    text = ignored_entries(entries, name, "twin_node")
    assert words in text and bool(text) == bool(words)


@pytest.mark.parametrize(("entry", "ignored"), [("shaft_node", True), ("/**/shaft_node", False), ("/m1/*", False)])
def test_a_parameter_file_that_ros_ignores_is_noted(suite: Suite, entry: str, ignored: bool) -> None:
    file = suite.folder / "settings.yaml"
    file.write_text(f"{entry}:\n  ros__parameters:\n    rpm: 77.0\n")
    shaft = suite.start("shaft_node", "duration_s:=0.1", remaps=["__ns:=/m1"], files=[file])
    assert shaft.wait() == 0
    assert ("77 rpm" in shaft.words()) != ignored
    assert ("write /m1/shaft_node" in shaft.words()) == ignored
