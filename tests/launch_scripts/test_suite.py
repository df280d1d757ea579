"""suite.sh: each node gets its own parameters, in any namespace, and a mistake starts nothing."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("rclpy")

SCRIPTS = Path(__file__).parents[2] / "launch_scripts"


@pytest.fixture(scope="module")
def suite() -> ModuleType:
    spec = importlib.util.spec_from_file_location("suite_script", SCRIPTS / "suite.py")
    assert spec is not None and spec.loader is not None
    sys.path.insert(0, str(SCRIPTS))
    module = importlib.util.module_from_spec(spec)
    handler = signal.getsignal(signal.SIGINT)
    spec.loader.exec_module(module)
    signal.signal(signal.SIGINT, handler)
    return module


def arguments_of(suite: ModuleType, *words: str) -> dict[str, list[str]]:
    """Return the arguments of each node after --ros-args."""
    return {Path(command[0]).name: command[2:] for command in suite.commands(words)}


def test_parameters_of_one_node_reach_it_in_a_namespace(suite: ModuleType) -> None:
    nodes = arguments_of(
        suite, "tufting", "-p", "twin_node:shaft:=lag", "-p", "rate_hz:=500.0", "-r", "__ns:=/machine_3"
    )
    assert nodes["twin_node"] == [
        *("-p", "machine:=tufting"),
        *("-p", "shaft:=lag"),
        *("-p", "rate_hz:=500.0"),
        *("-r", "__ns:=/machine_3"),
    ]
    assert "shaft:=lag" not in nodes["record_node"] and "rate_hz:=500.0" in nodes["record_node"]
    assert all("__ns:=/machine_3" in words for words in nodes.values())
    assert list(nodes) == ["twin_node", "record_node", "monitor_node", "fault_node", "view_node"]


def test_alarms_and_what_was_learnt_have_one_book(suite: ModuleType) -> None:
    nodes = arguments_of(suite, "tufting")
    assert "book:=out/faults" in nodes["monitor_node"] and "book:=out/faults" in nodes["fault_node"]
    elsewhere = arguments_of(suite, "tufting", "-p", "book:=/srv/book")
    assert all(elsewhere[node][-1] == "book:=/srv/book" for node in ("monitor_node", "fault_node"))


def test_a_machine_without_a_torque_has_no_monitor(suite: ModuleType) -> None:
    for words in (["elliptic_gear_beatup"], ["needle_transfer"], ["tufting", "--no-torque"]):
        assert list(arguments_of(suite, *words)) == ["twin_node", "record_node", "view_node"]
        assert list(arguments_of(suite, *words, "--no-view")) == ["twin_node", "record_node"]


def test_a_parameter_goes_to_those_that_have_it(suite: ModuleType) -> None:
    nodes = arguments_of(
        suite, "--shaft", "simulated", "-p", "rpm:=90", "-p", "use_sim_time:=false", "-p", "port:=9900"
    )
    assert [name for name, words in nodes.items() if "rpm:=90" in words] == ["shaft_node"]
    assert [name for name, words in nodes.items() if "port:=9900" in words] == ["view_node"]
    assert all("use_sim_time:=false" in words for words in nodes.values())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["tuffting"], "there is no machine 'tuffting'; did you mean tufting?"),
        (
            ["-p", "twin:shaft:=lag"],
            "no node 'twin'; there are twin_node, record_node, monitor_node, fault_node,",
        ),
        (["-p", "twin_node:shft:=lag"], "no parameter 'shft'; did you mean 'shaft'?"),
        (["-p", "rpm:=90"], "no parameter 'rpm'"),
        (["-p", "shaft"], "is not written as NAME:=VALUE"),
    ],
)
def test_a_mistake_is_one_line_and_starts_nothing(
    suite: ModuleType,
    words: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys.modules["bring_up"], "Program", None)
    assert suite.main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("suite.sh: ") and said in line
    assert not list(tmp_path.iterdir())


_SOCKETS = """
import os, socket, struct
import rclpy
rclpy.init()
node = rclpy.create_node("looked_at")
own = set()
for number in os.listdir("/proc/self/fd"):
    try:
        own.add(os.readlink(f"/proc/self/fd/{number}"))
    except OSError:  # the listing's own
        pass
for line in open("/proc/self/net/udp").readlines()[1:]:
    fields = line.split()
    if f"socket:[{fields[9]}]" in own:
        print(socket.inet_ntoa(struct.pack("<I", int(fields[1].partition(":")[0], 16))))
print(*(name for name in os.listdir("/proc/self/task") if "shm" in open(f"/proc/self/task/{name}/comm").read()))
rclpy.shutdown()
"""


def test_nodes_keep_to_the_loopback_interface_and_use_no_shared_memory(suite: ModuleType, tmp_path: Path) -> None:
    environment = {**os.environ, **suite.this_computer_alone(), "HOME": str(tmp_path), "ROS_DOMAIN_ID": "101"}
    ended = subprocess.run(
        [sys.executable, "-c", _SOCKETS], env=environment, capture_output=True, text=True, check=True
    )
    *addresses, shared = ended.stdout.splitlines()
    assert "127.0.0.1" in addresses and not shared
    assert all(address.startswith(("127.", "239.")) for address in addresses)
