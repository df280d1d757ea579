"""textile-twin status: a running suite in the terminal, and its message without a suite."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from tests.ros.suite import Suite, wait_until
from textile_twin_ros.diagnostics import ERROR, OK, WARN
from textile_twin_ros.status import Heard, take, text_of


def heard(name: str, level: bytes, message: str, at_s: float = 100.0, hardware: str = "") -> tuple[str, Heard]:
    return name, Heard(DiagnosticStatus(name=name, level=level, message=message, hardware_id=hardware), at_s)


def test_machines_nodes_and_alarms() -> None:
    statuses = dict(
        [
            heard("twin_node: main_shaft/angle", OK, "500.0 Hz", hardware="tufting"),
            heard("m3/twin_node: main_shaft/angle", WARN, "2 publishers", hardware="handloom_beatup"),
            heard("m3/record_node: recording", ERROR, "full"),
        ]
    )
    lines = text_of(statuses, 101.0).splitlines()
    assert lines == [
        "/m3  handloom_beatup",
        "  record_node",
        "    ERROR  recording         full",
        "  twin_node",
        "    WARN   main_shaft/angle  2 publishers",
        "/  tufting",
        "  twin_node",
        "    ok     main_shaft/angle  500.0 Hz",
        "1 WARN, 1 ERROR",
    ]
    late = text_of(statuses, 110.0)
    assert late.splitlines()[-1] == "3 STALE"
    assert "the node has said nothing for 10 s; before: 500.0 Hz" in late
    only = text_of(dict([heard("twin_node: outputs", OK, "computing")]), 100.0)
    assert only.splitlines()[-1] == "all in order"


def test_what_a_node_no_longer_says_is_over() -> None:
    shown: dict[str, Heard] = {}
    for at_s, what in enumerate(("twin_node: twin", "m3/twin_node: twin", "twin_node: outputs")):
        take(shown, DiagnosticArray(status=[DiagnosticStatus(name=what, level=OK)]), float(at_s))
    assert set(shown) == {"m3/twin_node: twin", "twin_node: outputs"}


def status(suite: Suite, *words: str) -> subprocess.CompletedProcess[str]:
    command = [str(Path(sys.executable).parent / "textile-twin"), "status", *words]
    return subprocess.run(command, env=suite.environment, capture_output=True, text=True)


@pytest.mark.slow
def test_a_running_suite_is_shown(suite: Suite) -> None:
    twin = suite.start("twin_node", remaps=["__ns:=/m3"])
    suite.start("shaft_node", "rate_hz:=200", remaps=["__ns:=/m3"])
    twin.wait_for_words("predicting from")
    wanted = (r"ok +main_shaft/angle +(\d+\.\d) Hz", r" shaft estimator ", r" balancing_torque/residual ")

    def shown() -> str | None:
        """Printed status, once a busy computer has found its nodes and has come to their samples."""
        shown = status(suite, "--seconds", "3")
        return shown.stdout if shown.returncode == 0 and all(re.search(line, shown.stdout) for line in wanted) else None

    text = wait_until(shown, "a suite in order")
    assert text.splitlines()[:2] == ["/m3  tufting", "  twin_node"]
    rate = re.search(wanted[0], text)
    assert rate and float(rate[1]) > 0.0


def test_no_suite_is_one_line(suite: Suite) -> None:
    shown = status(suite, "--seconds", "0.5")
    assert (shown.returncode, shown.stdout) == (2, "")
    (line,) = shown.stderr.splitlines()
    assert f"in ROS_DOMAIN_ID {suite.domain}" in line
