"""The suite through long and rough runs, as they occur beside a machine; each prints its result.

Run from the root of the repository: python -m tests.benchmarks.field WHAT [NUMBER]
  side-by-side [SECONDS]   three suites on one computer, two of them in namespaces, started in the same second
  kills [TIMES]            a recorder killed at random moments at 1 kHz, and what is on the disk
  restarts [TIMES]         nodes killed and started again in any order, and how long until all of them work again
  bridge [SECONDS]         a PLC at 100 Hz by OPC UA, encrypted: from asyncua's own server to the predictions in it
  opcua-server [SECONDS]   our own OPC UA server at 100 Hz: every value in asyncua's own client, encrypted
  fault-book [TIMES]       monitor, fault node and twin killed at random moments while faults come and go
python -m tests.benchmarks.endurance [MINUTES] runs at 1 kHz for long.
"""

from __future__ import annotations

import asyncio
import math
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from tests.ros.bridged import Bridged
from tests.ros.suite import PATIENCE_S, RELIABLE, SECOND_NS, Program, Suite, running_suite
from tests.ros.test_fault_kills import check, survive
from tests.ros.test_opcua import RATE_HZ as PLC_HZ
from tests.ros.test_opcua import Plc
from tests.ros.test_opcua_security import Keys
from tests.ros.test_opcua_server import reach_an_encrypted_client
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import open_bag
from textile_twin_ros.messages import TorqueReader
from textile_twin_ros.opcua_security import ServerSecurity, ServerSecurityParameters

ROOT = Path(__file__).parents[2]
PREDICTED = "balancing_torque/predicted"
# What is printed for people: a log line of a node, or the recorder's last word.
FOR_PEOPLE = re.compile(
    r"^\[(INFO|WARN)\] \[[\d.]+\] \[[\w.]+\]: |^recorded \d+ messages|^suite\.sh: nodes on this computer"
)


def side_by_side(suite: Suite, seconds: float) -> None:
    """Three suites: each recording of its own machine alone, and not a line that is not meant for people."""
    machines = {"": "tufting", "/loom_3": "handloom_beatup", "/m7": "elliptic_gear_beatup"}
    programs = []
    for space, machine in machines.items():
        words = [machine, "--shaft", "simulated", *(("-r", f"__ns:={space}") if space else ())]
        command = [sys.executable, str(ROOT / "launch_scripts" / "suite.py"), *words]
        log = suite.folder / f"{machine}.log"
        with log.open("wb") as stream:
            process = subprocess.Popen(command, cwd=suite.folder, stdout=stream, stderr=stream, env=suite.environment)
        programs.append((process, log))
    time.sleep(seconds)
    for process, _ in programs:
        process.send_signal(signal.SIGINT)
    codes = [process.wait(60.0) for process, _ in programs]
    strange = [line for _, log in programs for line in log.read_text().splitlines() if not FOR_PEOPLE.match(line)]
    print(f"exit codes {codes}; lines not meant for people: {strange or 'none'}")
    for path in sorted((suite.folder / "out" / "recordings").iterdir()):
        bag = open_bag(path)
        spaces = {topic.split("/main_shaft/angle")[0] for topic in bag.topics if topic.endswith("/main_shaft/angle")}
        others = sorted(
            topic for topic in bag.topics if topic != "/diagnostics" and not topic.startswith(f"{min(spaces)}/")
        )
        others += [topic for topic in bag.topics if not min(spaces) and topic.startswith(("/loom_3/", "/m7/"))]
        counts = {topic: info.count for topic, info in sorted(bag.topics.items()) if "torque/" in topic}
        print(f"{path.name}: of {spaces}, of others {others or 'nothing'}; {counts}")


def feed(suite: Suite, rate_hz: float) -> Program:
    """A simulated machine at this rate."""
    machine = suite.start("shaft_node", f"rate_hz:={rate_hz}")
    machine.wait_for_words("samples a second")
    return machine


def kills(suite: Suite, times: int) -> None:
    """Check that the disk has all messages published more than half a second before the kill."""
    choice = random.Random(1)
    feed(suite, 1000.0)
    latest, first, holes = [], [], 0
    for number in range(times):
        bag = suite.folder / f"killed_{number}"
        recorder = suite.start("record_node", f"bag:={bag}", "topics:=[main_shaft/angle]")
        recorder.wait_for_words("recording to")
        began = time.monotonic()
        while recorder.process.poll() is None and not _messages_on_disk(bag):
            time.sleep(0.1)
        first.append(time.monotonic() - began)
        time.sleep(choice.uniform(0.5, 2.5))
        killed_ns = time.time_ns()
        recorder.end(signal.SIGKILL)
        # The machine's stamps are a millisecond apart, and those of this computer's clock.
        stamps = np.sort(open_bag(bag).read_angles().stamps)
        holes += round((int(stamps[-1]) - int(stamps[0])) / 1_000_000) + 1 - len(stamps)
        latest.append((killed_ns - int(stamps[-1])) * 1e-9)
    print(f"{times} kills at 1 kHz: the last sample on the disk {np.median(latest):.2f} s (median) and at most"
          f" {max(latest):.2f} s before the kill; {holes} holes; the first sample"
          f" there {max(first):.1f} s after the start at most")  # fmt: skip


def _messages_on_disk(bag: Path) -> int:
    try:
        return open_bag(bag).message_count
    except RecordingError:  # nothing is there yet
        return 0


class Watched:
    """A suite whose nodes are killed and restarted; `heals` checks that all of it works."""

    def __init__(self, suite: Suite) -> None:
        self._suite = suite
        self.heard: list[int] = []
        self._view_s = math.inf
        self.bags: list[Path] = []
        node, read = suite.node(), TorqueReader().read
        node.create_subscription(
            WrenchStamped, PREDICTED, lambda raw: self.heard.append(read(raw)[0]), RELIABLE, raw=True
        )
        node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, RELIABLE)
        self.nodes = {name: self.start(name) for name in ("shaft_node", "twin_node", "view_node", "record_node")}

    def start(self, name: str) -> Program:
        """Start a node, each recorder with a recording of its own."""
        words = ["port:=0", f"file:={self._suite.folder}/view.rrd"] if name == "view_node" else []
        if name == "record_node":
            self.bags.append(self._suite.folder / f"bag_{len(self.bags)}")
            words = [f"bag:={self.bags[-1]}"]
        return self._suite.start(name, *words)

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == f"view_node: {PREDICTED}":
                age = {item.key: item.value for item in status.values}["age_s"]
                self._view_s = math.inf if age == "none" else float(age)

    def heals(self, newest: int) -> float:
        """Seconds until all three have predictions that are newer: a listener, the view, the recording on the disk.

        Infinite where one of them has none within a minute.
        """
        began = time.monotonic()
        self._until(began, lambda: max(self.heard[-9:], default=0) > newest)
        self._view_s = math.inf  # what it said before may have been of the old ones
        self._until(began, lambda: self._view_s < 0.5)
        self._until(began, lambda: _recorded(self.bags[-1]).max(initial=0) > newest)
        took = time.monotonic() - began
        return took if took < PATIENCE_S else math.inf

    def _until(self, began: float, holds: Callable[[], bool]) -> None:
        while not holds() and time.monotonic() - began < PATIENCE_S:
            self._suite.spin_for(0.1)


def restarts(suite: Suite, times: int) -> None:
    """Any node killed and started again: listener, view and recording have predictions again, none an old one."""
    watched, choice = Watched(suite), random.Random(2)
    watched.heals(0)
    healed: dict[str, list[float]] = {name: [] for name in watched.nodes}
    stale = 0
    for _ in range(times):
        name = choice.choice(list(watched.nodes))
        watched.nodes[name].end(signal.SIGKILL)
        suite.spin_for(choice.uniform(0.0, 0.5))
        newest = time.time_ns()  # the machine's stamps are those of this computer's clock
        watched.heard.clear()
        watched.nodes[name] = watched.start(name)
        healed[name].append(watched.heals(newest))
        stale += sum(stamp < newest - SECOND_NS for stamp in watched.heard)
        print(f"{name}: all back after {healed[name][-1]:.1f} s", flush=True)
    for name, seconds in healed.items():
        if seconds:
            worst = f"{np.median(seconds):.1f} s (median), {max(seconds):.1f} s at most"
            print(f"{name}, {len(seconds)} times: all back after {worst}")
    twice = sum(int(np.sum(np.diff(_recorded(bag)) <= 0)) for bag in watched.bags)
    print(f"{stale} old predictions heard, {twice} recorded that are not newer than the one before")


def _recorded(bag: Path) -> np.ndarray:
    """Stamps of the predictions on the disk."""
    try:
        return open_bag(bag).read_torques(f"/{PREDICTED}").stamps
    except RecordingError:  # nothing is there yet
        return np.zeros(0, np.int64)


def bridge(suite: Suite, seconds: float) -> None:
    """Every sample of a PLC comes to the topics once, and the twin's predictions go back."""
    keys = Keys(suite.folder / "keys")
    plc = Plc(secure=ServerSecurity(ServerSecurityParameters(**keys.of_server())).apply)
    heard = Bridged(suite.node(), "opcua_node: plc")
    (suite.folder / "password").write_text("loom 7\n")
    names = [f"{name}:='ns=2;s={name.title()}'" for name in ("angle", "predicted")] + ["torque:='ns=2;s=Load'"]
    names += [f"certificate:={keys.client}", f"private_key:={keys.client_key}", f"server_certificate:={keys.server}"]
    names += ["user:=anna", f"password_file:={suite.folder / 'password'}"]
    suite.start("twin_node").wait_for_words("predicting from")
    suite.start(
        "opcua_node", f"url:=opc.tcp://127.0.0.1:{plc.port}", f"angle_unit_rad:={np.deg2rad(0.1)}", *names
    ).wait_for_words("reading")
    suite.spin_for(3.0)
    heard.angles.clear()
    count = round(seconds * PLC_HZ)

    async def turn() -> None:
        began = time.monotonic()
        for number in range(count):
            await plc.cycle(number)
            await asyncio.sleep(max(0.0, began + (number + 1) / PLC_HZ - time.monotonic()))

    shaft = plc.begin(turn())
    while not shaft.done():
        suite.spin_for(0.1)
    suite.spin_for(2.0)
    stamps = [_stamp(message) for message in heard.angles]
    print(f"{count} samples of a PLC: {len(stamps)} angles, {len(set(stamps))} stamps, {len(heard.torques)} torques,"
          f" {len(heard.predicted)} predictions; in the PLC {plc.call(plc.nodes['Predicted'].read_value()):.3f} N m,"
          f" the last {heard.predicted[-1].wrench.torque.z:.3f} N m")  # fmt: skip
    plc.close()


def opcua_server(suite: Suite, seconds: float) -> None:
    """Every value of five variables reaches the client once, in its order, with its stamp."""
    samples = round(seconds * PLC_HZ)
    reach_an_encrypted_client(suite, Keys(suite.folder / "keys"), samples)
    print(f"{samples} of {samples} values of each of five variables, each once")


def fault_book(suite: Suite, times: int) -> None:
    """Check each fault once, with its recording, under all kills; a fault for every four kills."""
    faults = max(2, times // 4)
    book = survive(suite, times, faults)
    angles = check(book, faults)
    entries = len(book.faults())
    print(f"{times} kills, {faults} faults that came and went: {entries} in the book, {entries} with their recording;"
          f" angles before and after each alarm: {angles}")  # fmt: skip


def _stamp(message: WrenchStamped | JointState) -> int:
    return int(message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec)


def main() -> None:
    """Run one of them."""
    runs = {
        "side-by-side": (side_by_side, 60.0),
        "kills": (kills, 20),
        "restarts": (restarts, 20),
        "bridge": (bridge, 60.0),
        "opcua-server": (opcua_server, 50.0),
        "fault-book": (fault_book, 20),
    }
    if len(sys.argv) < 2 or sys.argv[1] not in runs:
        sys.exit(__doc__)
    run, usual = runs[sys.argv[1]]
    number = type(usual)(float(sys.argv[2])) if len(sys.argv) > 2 else usual
    with tempfile.TemporaryDirectory() as folder, running_suite(Path(folder), "events") as suite:
        run(suite, number)


if __name__ == "__main__":
    main()
