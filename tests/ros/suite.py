"""Nodes of the suite as processes of their own over real DDS, and a node inside the test that talks with them."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from launch_scripts.this_computer import this_computer_alone
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_ros.node_runner import create_executor

PATIENCE_S = 60.0
_T = TypeVar("_T")
_DOMAINS = itertools.count(os.getpid())


def free_domain() -> tuple[int, socket.socket]:
    """A ROS domain that no other test on this computer uses, and its claim, valid until closed.

    Each time another one: what an earlier test left behind is not heard.
    """
    first = next(_DOMAINS)
    for number in (1 + (first + k) % 100 for k in range(100)):
        claim = socket.socket(socket.AF_UNIX)
        try:
            claim.bind(f"\0textile-twin-test-domain-{number}")
            return number, claim
        except OSError:
            claim.close()
    raise RuntimeError("a hundred tests are running on this computer")


def node_environment(folder: Path, domain: int) -> dict[str, str]:
    """Environment of nodes that hear each other as those of suite.sh do, and leave nothing elsewhere."""
    return {
        "ROS_DOMAIN_ID": str(domain),
        **this_computer_alone(),
        "ROS_PYTHON_CHECK_FIELDS": "1",
        "ROS_LOG_DIR": str(folder / "log"),
        "HOME": str(folder),
    }


class Suite:
    """Processes and a test node in one ROS domain of their own, on this computer alone."""

    def __init__(self, folder: Path, executor: str = "single") -> None:
        self.folder = folder
        self._executor_name = executor
        self.domain, self._claim = free_domain()
        self.environment = os.environ | node_environment(folder, self.domain)
        self.processes: list[Program] = []
        self._context: Context | None = None
        self._nodes: list[Node] = []

    def start(self, node: str, *parameters: str, remaps: Sequence[str] = (), files: Sequence[Path] = ()) -> Program:
        """Start a node with parameters written as name:=value, and with parameter files."""
        words = [word for text in parameters for word in ("-p", text)]
        words += [word for text in remaps for word in ("-r", text)]
        words += [word for file in files for word in ("--params-file", str(file))]
        log = self.folder / f"{len(self.processes)}_{node}.log"
        command = [str(Path(sys.executable).parent / node), "--ros-args", *words]
        program = Program(command, log, self.environment)
        self.processes.append(program)
        return program

    def node(self) -> Node:
        """A node inside the test."""
        if self._context is None:
            for name in (*this_computer_alone(), "ROS_LOG_DIR"):
                os.environ[name] = self.environment[name]
            self._context = Context()
            rclpy.init(context=self._context, domain_id=self.domain)
            self._executor = create_executor(self._executor_name, self._context)
        node = Node("test", context=self._context)
        self._executor.add_node(node)
        self._nodes.append(node)
        return node

    def spin_until(self, condition: Callable[[], object], what: str) -> None:
        """Spin the test's nodes until something holds; fail after PATIENCE_S."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"{what}: not within {PATIENCE_S} s\n{self.words()}"
            self._executor.spin_once(timeout_sec=0.02)

    def spin_for(self, seconds: float) -> None:
        """Spin the test's nodes for a while."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.02)

    def call(self, node: Node, service: Any, name: str, request: Any) -> Any:
        """Call a service and return its response."""
        client = node.create_client(service, name)
        self.spin_until(client.service_is_ready, f"service {name}")
        future = client.call_async(request)
        self.spin_until(future.done, f"answer of {name}")
        return future.result()

    def words(self) -> str:
        """Output of all processes."""
        return "\n".join(program.words() for program in self.processes)

    def close(self) -> None:
        """End every process and the test's nodes."""
        for program in self.processes:
            program.end(signal.SIGKILL)
        if self._context is not None:
            for node in self._nodes:  # the middleware's threads must find none of them when the executor is gone
                self._executor.remove_node(node)
                node.destroy_node()
            self._executor.shutdown()
            rclpy.shutdown(context=self._context)
        self._claim.close()


def wait_until(condition: Callable[[], _T | None], what: str) -> _T:
    """Wait until something holds, and return it; fail after PATIENCE_S."""
    deadline = time.monotonic() + PATIENCE_S
    while not (held := condition()):
        assert time.monotonic() < deadline, f"{what}: not within {PATIENCE_S} s"
        time.sleep(0.02)
    return held


class Program:
    """One process, with its output in a file."""

    def __init__(self, command: list[str], log: Path, environment: dict[str, str]) -> None:
        self._log = log
        with log.open("wb") as stream:
            self.process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, env=environment)

    def words(self) -> str:
        """Its output so far."""
        return self._log.read_text(errors="replace")

    def wait(self) -> int:
        """Its exit code, once it has ended by itself."""
        return self.process.wait(PATIENCE_S)

    def wait_for_words(self, text: str) -> None:
        """Wait until it has said this."""
        deadline = time.monotonic() + PATIENCE_S
        while text not in self.words():
            assert self.process.poll() is None or text in self.words(), f"ended without '{text}':\n{self.words()}"
            assert time.monotonic() < deadline, f"did not say '{text}':\n{self.words()}"
            time.sleep(0.02)

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Send a signal, and return the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


@contextmanager
def running_suite(folder: Path, executor: str = "single") -> Iterator[Suite]:
    """A suite that ends with the block; `executor`: how the test's own nodes are run."""
    suite = Suite(folder, executor)
    try:
        yield suite
    finally:
        suite.close()


RELIABLE = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)
SECOND_NS = 1_000_000_000


def shaft_angles(count: int, rate_hz: float = 500.0, start_ns: int = 1_700_000_000 * SECOND_NS) -> tuple[Any, Any]:
    """Stamps [ns] and wrapped angles [rad] of a shaft at 160 rpm with some ripple, on a 16-bit encoder."""
    phase = 2.0 * np.pi * 160.0 / 60.0 * np.arange(count) / rate_hz
    step = 2.0 * np.pi / 65536
    angles = np.floor((phase + 0.02 * np.sin(phase)) % (2.0 * np.pi) / step) * step
    stamps = start_ns + np.arange(count) * round(SECOND_NS / rate_hz)
    return stamps.astype(np.int64), angles


def write_bag(path: Path, stamps: Any, angles: Any, torques: Any | None = None) -> Path:
    """A recording with shaft angles, and measured torques 1 ms after them."""
    with BagWriter(path) as bag:
        bag.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], angles)
        if torques is not None:
            bag.write_wrenches("balancing_torque/measured", stamps + 1_000_000, torques)
    return path


def recorded(path: Path, topic: str | None = None) -> int:
    """Messages of a recording that is being written, or of one topic; 0 while the disk has no such message."""
    try:
        bag = open_bag(path)
        return bag.message_count if topic is None else bag.topics[topic].count
    except Exception:  # none yet, or half a file
        return 0
