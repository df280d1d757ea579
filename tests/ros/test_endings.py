"""Every node ends with exit code 0 on SIGINT and SIGTERM, in both executors, and a mistake gives one line."""

from __future__ import annotations

import dataclasses
import importlib
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rcl_interfaces.srv import GetParameters

from tests.campaign import more
from tests.ros.suite import PATIENCE_S, Suite, node_environment, shaft_angles, write_bag
from textile_twin_core.recordings import open_bag
from textile_twin_ros.commands import ENDING_SIGNALS, twin_node

# What the middleware and Python print when something is taken away under a running callback.
ALARM = re.compile("Traceback|FATAL|Exception|never retrieved")


@pytest.mark.slow
@pytest.mark.parametrize(("executor", "number"), [("events", signal.SIGINT), *more(("single", signal.SIGTERM))])
def test_nodes_end_on_signals(suite: Suite, number: signal.Signals, executor: str) -> None:
    bag = write_bag(suite.folder / "played", *shaft_angles(20_000))
    started = [
        (suite.start("record_node", f"bag:={suite.folder / 'recorded'}", f"executor:={executor}"), "recording to"),
        (suite.start("twin_node", f"executor:={executor}"), "predicting from"),
        (suite.start("shaft_node", f"executor:={executor}", "rate_hz:=2000"), "samples a second"),
        (suite.start("replay_node", f"bag:={bag}", f"executor:={executor}", "wait_timeout_s:=0"), "playing"),
    ]
    for program, words in started:
        program.wait_for_words(words)
    for program, _ in started:
        assert program.end(number) == 0, program.words()
        assert not ALARM.search(program.words()), program.words()
    assert open_bag(suite.folder / "recorded").message_count > 0


def test_a_recorder_whose_reader_has_gone_ends_well(suite: Suite) -> None:
    suite.node()
    command = [str(Path(sys.executable).parent / "record_node"), "--ros-args", "-p", f"bag:={suite.folder / 'run'}"]
    with (suite.folder / "errors").open("w+") as errors:
        running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, env=suite.environment)
        assert running.stdout is not None
        running.stdout.close()
        try:
            suite.spin_until(lambda: "recording to" in (suite.folder / "errors").read_text(), "recorder")
            running.terminate()
            assert running.wait(PATIENCE_S) == 0
        finally:
            running.kill()
        assert not ALARM.search((suite.folder / "errors").read_text())
    assert open_bag(suite.folder / "run").message_count == 0


@contextmanager
def keep_signals() -> Iterator[None]:
    """Nodes run inside the test set handlers of their own; pytest's come back."""
    handlers = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@pytest.mark.slow
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
        assert not ALARM.search(program.words()), program.words()


@pytest.mark.parametrize("delay_s", [0.0, 0.5, *more(0.2, 1.0)])
def test_a_node_ends_while_it_starts(suite: Suite, delay_s: float) -> None:
    program = suite.start("twin_node")
    status = Path(f"/proc/{program.process.pid}/status")
    # Python itself catches SIGINT alone: SIGTERM is caught from the node's own first line on.
    while not int(re.search(r"SigCgt:\s*(\w+)", status.read_text())[1], 16) >> (signal.SIGTERM - 1) & 1:  # type: ignore[index]
        time.sleep(0.005)
    time.sleep(delay_s)
    assert program.end(signal.SIGINT) == 0, program.words()
    assert not ALARM.search(program.words()), program.words()


@pytest.mark.slow
def test_a_twin_ends_while_it_compiles(suite: Suite) -> None:
    compiled = suite.folder / "compiled"
    suite.environment["TEXTILE_TWIN_CACHE_DIR"] = str(compiled)
    twin = suite.start("twin_node", "shaft:=lag")
    twin.wait_for_words("warming up")
    assert twin.end() == 0
    assert not [*compiled.glob("*")]  # it was amid it: launch does not wait until a loop is compiled, and is there
    assert "predicting from" not in twin.words() and not ALARM.search(twin.words()), twin.words()


OPCUA = "url:=opc.tcp://127.0.0.1:1"
MISTAKES = [
    ("twin_node", ["machine:=tuffting"], ["no machine 'tuffting'", "tufting"]),
    ("twin_node", ["machine:=nowhere.yaml"], ["nowhere.yaml"]),
    ("twin_node", ["shaft:=smooth"], ["shaft", "smooth", "causal, lag"]),
    ("twin_node", ["rate_hz:=fast"], ["rate_hz", "number"]),
    ("twin_node", ["rate_hz:=-3"], ["rate_hz", "-3"]),
    ("twin_node", ["wait_for:=[needle]"], ["wait_for", "needle", "needle/position"]),
    # What rclpy refuses only when a topic is made, in a transition of the node's life.
    ("twin_node", ["qos_overrides./joint_states.publisher.reliability:=sure"], ["reliability", "sure"]),
    ("twin_node", ["qos_overrides./main_shaft/angle.subscription.depth:=deep"], ["subscription.depth", "deep"]),
    ("monitor_node", ["parquet:=/proc/trends"], ["parquet", "/proc/trends"]),
    ("monitor_node", ["raise_sigmas:=3", "clear_sigmas:=4"], ["clear_sigmas", "raise_sigmas"]),
    ("replay_node", [], ["'bag' is not set"]),
    ("replay_node", ["bag:=nowhere"], ["nowhere"]),
    ("replay_node", ["bag:={bag}", "topics:=[shaft]"], ["shaft", "/main_shaft/angle"]),
    ("replay_node", ["bag:={bag}", "wait_for:=[main_shaft/angle=x]"], ["wait_for", "main_shaft/angle=x"]),
    ("replay_node", ["bag:={bag}", "wait_timeout_s:=0.3"], ["too few subscribers", "/main_shaft/angle"]),
    ("record_node", [], ["'bag' is not set"]),
    ("record_node", ["bag:={bag}"], ["is there already"]),
    ("record_node", ["bag:=/proc/bag"], ["/proc/bag"]),
    ("record_node", ["bag:={bag}2", "types:=[angle]"], ["types", "angle", "package/msg/Type"]),
    (
        "record_node",
        ["bag:={bag}2", "types:=[angle=sensor_msgs/JointState]"],
        ["types", "sensor_msgs/JointState", "/msg/"],
    ),
    ("record_node", ["bag:={bag}2", "topics:=[main-shaft]"], ["topics", "'main-shaft'", "alphanumerics"]),
    ("record_node", ["bag:={bag}2", "stop_after:=[1st=3]"], ["stop_after", "'1st'", "number"]),
    ("opcua_node", ["angle:='ns=2;s=Angle'"], ["give the server's address"]),
    ("opcua_node", [OPCUA], ["'angle' is not set"]),
    ("opcua_node", [OPCUA, "angle:=loom", "allow_insecure:=true"], ["'angle' is 'loom': write a node id"]),
    ("opcua_node", [OPCUA, "angle:=i=1"], ["neither encrypted nor signed: make them with textile-twin opcua"]),
    ("plc_node", ["host:=10.0.0.5", "sequence:=4:float32"], ["sequence", "4:float32", "whole"]),
    ("shaft_node", ["machine:=loom"], ["no machine 'loom'"]),
    ("shaft_node", ["encoder_bits:=2.5"], ["encoder_bits", "whole number"]),
    ("shaft_node", ["use_sim_time:=maybe"], ["use_sim_time", "maybe", "BOOL"]),
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
    bag = write_bag(tmp_path / "played", *shaft_angles(10))
    options = [word for text in parameters for word in ("-p", text.format(bag=bag))]
    main = importlib.import_module(f"textile_twin_ros.{node}").main
    with keep_signals():
        assert main([node, "--ros-args", *options]) == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if "[INFO]" not in line]
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"{node}: ")
    for word in words:
        assert word in lines[0]
    assert not (tmp_path / "played2").exists()


def test_a_parameter_without_its_option_is_reported(capfd: pytest.CaptureFixture[str]) -> None:
    with keep_signals():
        twin = importlib.import_module("textile_twin_ros.twin_node")
        assert twin.main(["twin_node", "--ros-args", "machine:=tufting"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "machine:=tufting" in line and "-p NAME:=VALUE" in line


@pytest.mark.parametrize(
    ("remap", "words"),
    [
        ("__ns:=machine_2", "a namespace begins with /"),
        ("__ns:=/machine-2", "letters, digits and _ alone"),
        ("__node:=a/b", "a node's name has letters"),
        ("main_shaft/angle:=drive-1/angle", "write -r FROM:=TO"),
        ("main_shaft/angle", "write -r FROM:=TO"),
    ],
)
def test_a_name_that_cannot_be_is_reported_with_what_can(
    remap: str, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with keep_signals():
        twin = importlib.import_module("textile_twin_ros.twin_node")
        assert twin.main(["twin_node", "--ros-args", "-r", remap]) == 2
    last = capfd.readouterr().err.splitlines()[-1]  # rcl itself has said something before
    assert last.startswith(f"twin_node: -r {remap}: ") and words in last and "/project/" not in last


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["loom.yaml"], "twin_node --ros-args -p machine:=loom.yaml"),
        (["-p", "machine:=loom.yaml"], "twin_node --ros-args -p machine:=loom.yaml"),
        (["machine:=loom.yaml", "--ros-args", "-r", "__ns:=/m"], "twin_node --ros-args -p machine:=loom.yaml"),
    ],
)
def test_words_before_ros_args_start_nothing(words: list[str], meant: str, capfd: pytest.CaptureFixture[str]) -> None:
    with keep_signals():
        assert importlib.import_module("textile_twin_ros.twin_node").main(["twin_node", *words]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("twin_node: ") and meant in line


def test_help_lists_every_parameter(capfd: pytest.CaptureFixture[str]) -> None:
    for name in ("twin", "replay", "record", "shaft", "view"):
        module = importlib.import_module(f"textile_twin_ros.{name}_node")
        with keep_signals():
            assert module.main([f"{name}_node", "--help"]) == 0
        text = capfd.readouterr().out
        declaration = getattr(module, f"{name.capitalize()}Parameters")
        for field in dataclasses.fields(declaration):
            assert f"  {field.name}:=" in text


def test_a_missing_core_is_reported(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "textile_twin_core", None)
    for name in [name for name in sys.modules if name.startswith(("textile_twin_ros.", "textile_twin_core."))]:
        if name != "textile_twin_ros.commands":
            monkeypatch.delitem(sys.modules, name)
    with keep_signals():
        assert twin_node() == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("twin_node: the package textile_twin_core is missing; ") and ".md" in line


def test_a_mistake_ends_the_process_with_code_2(suite: Suite) -> None:
    program = suite.start("twin_node", "machine:=tuffting")
    assert program.wait() == 2
    assert len(program.words().splitlines()) == 1


def test_unknown_parameters_are_reported(suite: Suite) -> None:
    program = suite.start("twin_node", "machin:=tufting")
    program.wait_for_words("parameter 'machin' is not one of this node's; did you mean 'machine'?")


def test_a_service_without_home_starts(suite: Suite) -> None:
    for name in ("HOME", "ROS_LOG_DIR"):
        del suite.environment[name]
    program = suite.start("twin_node")
    program.wait_for_words("predicting from")
    assert program.end() == 0
