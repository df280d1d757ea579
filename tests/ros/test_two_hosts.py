"""Two computers, as network namespaces with a cable between them: the encoder on one, twin and recorder on another."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from launch_scripts.this_computer import this_computer_alone
from tests.ros.suite import Program, node_environment, recorded, wait_until
from textile_twin_core.recordings import open_bag

MACHINE, ROOM = "10.77.0.1", "10.77.0.2"
"""Addresses of the computer at the machine and of the one in the control room."""


def ip(words: str) -> None:
    """Run ip with these words."""
    subprocess.run(["ip", *words.split()], check=True, capture_output=True)


class Host:
    """A network namespace with one end of the cable; deleting it deletes the cable."""

    def __init__(self, name: str, address: str, folder: Path) -> None:
        self.name, self._folder = name, folder
        self._programs: list[Program] = []
        self.environment = os.environ | node_environment(folder, 1) | {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        for setting in this_computer_alone():
            del self.environment[setting]
        ip(f"netns add {name}")
        self._address = address

    def connect(self, end: str, multicast: bool) -> None:
        """Take one end of the cable."""
        ip(f"link set {end} netns {self.name}")
        inside = f"-n {self.name}"
        ip(f"{inside} addr add {self._address}/24 dev {end}")
        ip(f"{inside} link set lo up")
        ip(f"{inside} link set {end} up multicast {'on' if multicast else 'off'}")
        if multicast:
            ip(f"{inside} route add 224.0.0.0/4 dev {end}")

    def start(self, node: str, *parameters: str) -> Program:
        """Start a node on this computer."""
        words = [word for text in parameters for word in ("-p", text)]
        command = ["ip", "netns", "exec", self.name, str(Path(sys.executable).parent / node), "--ros-args", *words]
        program = Program(command, self._folder / f"{self.name}_{node}.log", self.environment)
        self._programs.append(program)
        return program

    def close(self) -> None:
        """Switch it off."""
        for program in self._programs:
            program.end(signal.SIGKILL)
        with suppress(subprocess.SubprocessError):
            ip(f"netns del {self.name}")


@pytest.fixture
def hosts(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[tuple[Host, Host]]:
    number = os.getpid()
    try:
        ip(f"netns add ttprobe{number}")
        ip(f"netns del ttprobe{number}")
    except (OSError, subprocess.SubprocessError):
        pytest.skip("network namespaces may not be made here")
    made: list[Host] = []
    try:
        for name, address in ((f"ttm{number}", MACHINE), (f"ttr{number}", ROOM)):
            made.append(Host(name, address, tmp_path))
        ip(f"link add m{number} type veth peer name r{number}")
        made[0].connect(f"m{number}", request.param)
        made[1].connect(f"r{number}", request.param)
        yield made[0], made[1]
    finally:
        for host in made:
            host.close()


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize("hosts", [True, False], indirect=True, ids=["multicast", "static peers"])
def test_encoder_and_twin_on_two_computers(
    hosts: tuple[Host, Host], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    at_machine, in_room = hosts
    with_multicast = request.node.callspec.params["hosts"]
    for host, other in ((at_machine, ROOM), (in_room, MACHINE)):
        host.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
        if not with_multicast:
            host.environment["ROS_STATIC_PEERS"] = other
    recorder = in_room.start("record_node", f"bag:={tmp_path / 'bag'}")
    twin = in_room.start("twin_node")
    recorder.wait_for_words("recording to")
    twin.wait_for_words("predicting from")
    machine = at_machine.start("shaft_node", "rate_hz:=200.0")
    # It turns until enough has come: how soon two computers find each other is their affair.
    topics = ("/main_shaft/angle", "/balancing_torque/predicted")
    wait_until(lambda: all(recorded(tmp_path / "bag", topic) > 400 for topic in topics), "angles and predictions")
    assert machine.end() == twin.end() == recorder.end() == 0
    bag = open_bag(tmp_path / "bag")
    angles, predicted = bag.read_angles().stamps, bag.read_torques("balancing_torque/predicted").stamps
    assert len(angles) > 400 and len(predicted) > 400
    for stamps in (angles, predicted):
        assert set(np.diff(np.sort(stamps)).tolist()) == {5_000_000}
