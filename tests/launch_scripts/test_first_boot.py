"""The service of a machine, from its first boot: an alarm without any command, and again after a power cut."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray

from tests.docs.pages import ROOT
from tests.ros.suite import RELIABLE, Suite, running_suite
from tests.ros.test_fault_kills import Loom, has_learnt
from textile_twin_core.recordings.fault_book import FaultBook

NAME = "loom_3"
ERROR = b"\x02"


class Boot:
    """Start of a computer: the command of the unit, in its folder, with its environment and nothing else."""

    def __init__(self, suite: Suite) -> None:
        words = [str(ROOT / "launch_scripts" / "service.sh"), NAME, "tufting", "-p", "learn_turns:=40"]
        unit = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        self._folder = suite.folder / "textile-twin" / NAME
        self._folder.mkdir(parents=True, exist_ok=True)
        unit = unit.replace("%S", str(suite.folder)).replace("\\\n", " ")
        settings = shlex.split(re.findall("^Environment=(.*)$", unit, re.M)[0])
        cache = {name: os.environ[name] for name in ("TEXTILE_TWIN_CACHE_DIR",) if name in os.environ}
        self._environment = {
            **{"PATH": "/usr/bin:/bin", "ROS_DOMAIN_ID": str(suite.domain)},
            **cache,
            **dict(each.split("=", 1) for each in settings),
        }
        self._command = shlex.split(re.findall("^ExecStart=(.*)$", unit, re.M)[0])
        self._log = suite.folder / "journal"
        self.book = self._folder / "out" / "faults"
        self.process: subprocess.Popen[bytes] | None = None

    def on(self) -> None:
        """Start the service."""
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(
                self._command, cwd=self._folder, env=self._environment, stdout=log, stderr=subprocess.STDOUT
            )

    def cut(self) -> None:
        """Kill the service and every process that it started, without a warning."""
        assert self.process is not None
        started = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        for pid in (self.process.pid, *map(int, started)):
            os.kill(pid, signal.SIGKILL)
        self.process.wait()

    def off(self) -> None:
        """Stop the service as systemd does."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(60.0)

    def journal(self) -> str:
        return self._log.read_text(errors="replace")


@pytest.mark.slow
def test_an_alarm_comes_without_a_command_and_again_after_a_power_cut(tmp_path: Path) -> None:
    with running_suite(tmp_path) as suite:
        faults: list[tuple[bytes, str]] = []

        def hear(message: DiagnosticArray) -> None:
            faults.extend((each.level, each.message) for each in message.status if each.name.endswith(": faults"))

        boot, loom = Boot(suite), Loom(suite, 1, f"/{NAME}/")
        suite.node().create_subscription(DiagnosticArray, "/diagnostics", hear, RELIABLE)
        try:
            boot.on()
            band = boot.book / "faults.db"
            suite.spin_until(lambda: "fault book " in boot.journal() and has_learnt(band), "the band")
            loom.fault = "needle_force"
            book = FaultBook(boot.book)
            suite.spin_until(lambda: book.faults(), "an alarm")
            (fault,) = book.faults()
            assert fault.kind == "load_force" and fault.source == f"/{NAME}"
            boot.cut()
            suite.spin_for(1.0)  # what the killed monitor said may still arrive
            faults.clear()
            again = time.monotonic()
            boot.on()
            suite.spin_until(lambda: any(level == ERROR for level, _ in faults), "the alarm")
            print(f"the alarm stands {time.monotonic() - again:.1f} s after the start")
            suite.spin_until(lambda: "continues with the band learnt before" in boot.journal(), "what was learnt")
            suite.spin_for(3.0)
            assert [each.number for each in book.faults()] == [fault.number]
        finally:
            loom.close()
            boot.off()
