# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Status of a running suite in the terminal: the nodes' /diagnostics, machine by machine."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from textile_twin_core.errors import TwinError
from textile_twin_ros.diagnostics import ERROR, OK, STALE, WARN
from textile_twin_ros.machine_namespace import NODES

_LISTEN_S = 2.5
_SILENT_S = 3.5
"""Silence [s] after which a node is gone; each reports every second."""
_PERIOD_S = 1.0
_PATIENCE_S = 6.0
"""On a busy computer DDS finds a node after seconds, which then speaks once a second: so long nothing is no proof."""
_WORDS = {OK: "ok", WARN: "WARN", ERROR: "ERROR", STALE: "STALE"}
_COLOURS = {OK: "\033[32m", WARN: "\033[33m", ERROR: "\033[31m", STALE: "\033[31m"}
_PLAIN, _CLEAR = "\033[0m", "\033[2J\033[H"


@dataclass(frozen=True)
class Heard:
    """One status and when it came [s, monotonic]."""

    status: DiagnosticStatus
    at_s: float


def show(seconds: float | None, follow: bool, out: Callable[[str], object] = sys.stdout.write) -> int:
    """Listen and print; the exit code of the process.

    Args:
        seconds: how long to listen before printing first; None: 2.5 s, and up to 6 s until a node is heard.
        follow: print again every second until Ctrl-C, in place on a terminal.
        out: takes the text.

    Raises:
        TwinError: no node of the suite was heard.
    """
    heard: dict[str, Heard] = {}
    patient, seconds = seconds is None, _LISTEN_S if seconds is None else seconds

    def keep(message: DiagnosticArray) -> None:
        take(heard, message, time.monotonic())

    context = Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    node = Node(f"status_{os.getpid()}", context=context, enable_rosout=False, start_parameter_services=False)
    executor.add_node(node)
    try:
        node.create_subscription(DiagnosticArray, "/diagnostics", keep, QoSProfile(depth=100))
        _spin(executor, seconds)
        longest = max(seconds, _PATIENCE_S) if patient else seconds
        _spin(executor, longest - seconds, lambda: bool(heard))
        if not heard:
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            raise TwinError(
                f"no node of the suite is heard within {longest:g} s in ROS_DOMAIN_ID {domain}: start it"
                " (launch_scripts/suite.sh), or give the domain in which it runs: ROS_DOMAIN_ID=N textile-twin status"
            )
        terminal = sys.stdout.isatty()
        while True:
            out((_CLEAR if follow and terminal else "") + text_of(heard, time.monotonic(), terminal) + "\n")
            if not follow:
                return 0
            sys.stdout.flush()
            _spin(executor, _PERIOD_S)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)


def take(heard: dict[str, Heard], message: DiagnosticArray, now_s: float) -> None:
    """Take a node's complete report; it replaces the one before."""
    ours = {status.name: Heard(status, now_s) for status in message.status if _is_ours(status.name)}
    speakers = {name.partition(":")[0] for name in ours}
    for name in [name for name in heard if name.partition(":")[0] in speakers]:
        del heard[name]
    heard.update(ours)


def text_of(heard: Mapping[str, Heard], now_s: float, colours: bool = False) -> str:
    """The statuses of all machines as lines: machine, node, and message; the last line sums up."""
    rows: dict[str, dict[str, list[tuple[bytes, str, str]]]] = {}
    hardware: dict[str, str] = {}
    for name, one in sorted(heard.items()):
        node, _, what = name.partition(": ")
        place, _, short = node.rpartition("/")
        level, message = one.status.level, one.status.message
        if now_s - one.at_s > _SILENT_S:
            level, message = STALE, f"the node has said nothing for {now_s - one.at_s:.0f} s; before: {message}"
        rows.setdefault(f"/{place}", {}).setdefault(short, []).append((level, what, message))
        hardware[f"/{place}"] = one.status.hardware_id or hardware.get(f"/{place}", "")
    width = max(len(what) for nodes in rows.values() for said in nodes.values() for _, what, _ in said)
    lines: list[str] = []
    for machine, nodes in rows.items():
        lines.append(f"{machine}  {hardware[machine]}".rstrip())
        for node, said in nodes.items():
            lines.append(f"  {node}")
            for level, what, message in said:
                word = f"{_WORDS[level]:5}"
                lines.append(f"    {_COLOURS[level] + word + _PLAIN if colours else word}  {what:{width}}  {message}")
    alarms = [level for nodes in rows.values() for said in nodes.values() for level, _, _ in said if level != OK]
    counts = [f"{alarms.count(level)} {word}" for level, word in _WORDS.items() if alarms.count(level)]
    return "\n".join([*lines, ", ".join(counts) if counts else "all in order"])


def _is_ours(name: str) -> bool:
    return name.partition(":")[0].rpartition("/")[2] in NODES


def _spin(executor: SingleThreadedExecutor, seconds: float, enough: Callable[[], bool] = lambda: False) -> None:
    deadline = time.monotonic() + seconds
    while (left := deadline - time.monotonic()) > 0.0 and not enough():
        executor.spin_once(timeout_sec=left)
