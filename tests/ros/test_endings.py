"""Every node ends with exit code 0 on SIGINT and SIGTERM, in both executors, and a mistake is told in one line."""

from __future__ import annotations

import importlib
import signal
from pathlib import Path

import pytest
from rcl_interfaces.srv import GetParameters

from tests.ros.suite import Suite, node_environment, shaft_angles, write_bag
from textile_twin_core.files import open_bag


@pytest.mark.parametrize(("executor", "number"), [("events", signal.SIGINT), ("single", signal.SIGTERM)])
def test_nodes_end_on_signals(suite: Suite, number: signal.Signals, executor: str) -> None:
    bag = write_bag(suite.folder / "played", *shaft_angles(100_000))
    started = [
        (suite.start("record_node", f"bag:={suite.folder / 'recorded'}", f"executor:={executor}"), "recording to"),
        (suite.start("twin_node", f"executor:={executor}"), "predicting from"),
        (suite.start("shaft_node", f"executor:={executor}"), "samples a second"),
        (suite.start("replay_node", f"bag:={bag}", f"executor:={executor}", "wait_timeout_s:=0"), "playing"),
    ]
    for program, words in started:
        program.wait_for_words(words)
    for program, _ in started:
        assert program.end(number) == 0, program.words()
        assert "Traceback" not in program.words()
    assert open_bag(suite.folder / "recorded").message_count > 0


def test_nodes_end_while_they_wait(suite: Suite) -> None:
    bag = write_bag(suite.folder / "played", *shaft_angles(100))
    node = suite.node()
    waiting = {
        "/replay_node": suite.start("replay_node", f"bag:={bag}"),
        "/idle": suite.start("twin_node", "autostart:=false", remaps=["__node:=idle"]),
        "/twin_node": suite.start("twin_node", "wait_for:=[joint_states]", "executor:=single"),
    }
    for name, program in waiting.items():
        suite.call(node, GetParameters, f"{name}/get_parameters", GetParameters.Request(names=["executor"]))
        assert program.end() == 0, program.words()
        assert "Traceback" not in program.words()


MISTAKES = [
    ("twin_node", ["machine:=tuffting"], ["no machine 'tuffting'", "tufting"]),
    ("twin_node", ["machine:=nowhere.yaml"], ["nowhere.yaml"]),
    ("twin_node", ["shaft:=smooth"], ["shaft", "smooth", "causal, lag"]),
    ("twin_node", ["rate_hz:=fast"], ["rate_hz", "number"]),
    ("twin_node", ["rate_hz:=-3"], ["rate_hz", "-3"]),
    ("twin_node", ["wait_for:=[needle]"], ["wait_for", "needle", "needle/position"]),
    ("replay_node", [], ["'bag' is not set"]),
    ("replay_node", ["bag:=nowhere"], ["nowhere"]),
    ("replay_node", ["bag:={bag}", "topics:=[shaft]"], ["shaft", "/main_shaft/angle"]),
    ("replay_node", ["bag:={bag}", "wait_for:=[main_shaft/angle=x]"], ["wait_for", "main_shaft/angle=x"]),
    ("replay_node", ["bag:={bag}", "wait_timeout_s:=0.3"], ["too few subscribers", "/main_shaft/angle"]),
    ("record_node", [], ["'bag' is not set"]),
    ("record_node", ["bag:={bag}"], ["is there already"]),
    ("record_node", ["bag:=/proc/bag"], ["/proc/bag"]),
    ("record_node", ["bag:={bag}2", "types:=[angle]"], ["types", "angle", "package/msg/Type"]),
    ("shaft_node", ["machine:=loom"], ["no machine 'loom'"]),
    ("shaft_node", ["encoder_bits:=2.5"], ["encoder_bits", "whole number"]),
]


@pytest.mark.parametrize(("node", "parameters", "words"), MISTAKES)
def test_a_mistake_is_one_line_and_code_2(
    node: str,
    parameters: list[str],
    words: list[str],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in node_environment(tmp_path, domain=101).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # pytest's own handlers stay
    bag = write_bag(tmp_path / "played", *shaft_angles(10))
    options = [word for text in parameters for word in ("-p", text.format(bag=bag))]
    main = importlib.import_module(f"textile_twin_ros.{node}").main
    assert main([node, "--ros-args", *options]) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"{node}: ")
    for word in words:
        assert word in lines[0]
    assert not (tmp_path / "played2").exists()


def test_a_mistake_ends_the_process_with_code_2(suite: Suite) -> None:
    program = suite.start("twin_node", "machine:=tuffting")
    assert program.wait() == 2
    assert len(program.words().splitlines()) == 1


def test_unknown_parameters_are_told(suite: Suite) -> None:
    program = suite.start("twin_node", "machin:=tufting")
    program.wait_for_words("parameter 'machin' is not one of this node's; did you mean 'machine'?")


def test_a_service_without_home_starts(suite: Suite) -> None:
    for name in ("HOME", "ROS_LOG_DIR"):
        del suite.environment[name]
    program = suite.start("twin_node")
    program.wait_for_words("predicting from")
    assert program.end() == 0
