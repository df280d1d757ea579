"""Cost of a live sample: twin_node beside a bare node with the same traffic, taking turns in one run.

Run from the root of the repository: python -m tests.benchmarks.live_nodes [--rates 500 1000] [--machine FILE]

Angles are published at a steady rate to one node, then to the other; three outputs of it are heard. Processor time is
that of the node alone, in ms a second; latency is from publishing a sample to hearing its torque. Of several rounds the
medians are shown, of losses the sum.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import numpy as np
from geometry_msgs.msg import PointStamped, WrenchStamped
from sensor_msgs.msg import JointState

import textile_twin_core as ttc
from tests.ros.suite import RELIABLE, Program, Suite, running_suite
from textile_twin_ros.messages import JointTemplate, TorqueReader
from textile_twin_ros.pacing import Pace

OMEGA = 160.0 * 2.0 * np.pi / 60.0
_FIRST = 2
"""Samples that the twin's estimator takes before its first prediction."""


@dataclass
class Answers:
    """One node under test: its process, its input, and when each of its torques was heard."""

    name: str
    program: Program
    suite: Suite
    heard: dict[int, int] = field(default_factory=dict)
    rows: list[tuple[float, float, float, float]] = field(default_factory=list)
    lost: int = 0

    def __post_init__(self) -> None:
        node, reader = self.suite.node(), TorqueReader()
        self.input = node.create_publisher(JointState, f"/{self.name}/main_shaft/angle", RELIABLE)

        def hear(raw: bytes) -> None:
            self.heard[reader.read(raw)[0]] = time.monotonic_ns()

        topic = f"/{self.name}/balancing_torque/predicted"
        node.create_subscription(WrenchStamped, topic, hear, RELIABLE, raw=True)
        for other, msgtype in (("needle/position", PointStamped), ("joint_states", JointState)):
            node.create_subscription(msgtype, f"/{self.name}/{other}", lambda raw: None, RELIABLE, raw=True)

    def cpu_s(self) -> float:
        """Processor time that its process has used so far."""
        fields = Path(f"/proc/{self.program.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def measure(self, rate_hz: float, seconds: float, first: int) -> int:
        """Send a number of seconds of samples, the first of this running number; the number of the next."""
        count = round(rate_hz * seconds)
        sent: dict[int, int] = {}

        def publish() -> None:
            angle, pace = JointTemplate(["main_shaft"], velocities=False), Pace(threading.Event())
            for k in range(count):
                pace.wait_until(k / rate_hz)
                number = first + k
                stamp = 10**18 + round(number * 1e9 / rate_hz)
                sent[stamp] = time.monotonic_ns()
                self.input.publish(angle.message(stamp, OMEGA * number / rate_hz % (2.0 * np.pi)))

        used = self.cpu_s()
        thread = threading.Thread(target=publish)
        thread.start()
        while thread.is_alive():
            self.suite.spin_for(0.5)
        self.suite.spin_for(1.0)
        used = self.cpu_s() - used
        latency = np.array([self.heard[stamp] - sent[stamp] for stamp in sent if stamp in self.heard]) / 1e6
        self.lost += count - latency.size - (_FIRST if first == 0 and self.name == "twin" else 0)
        self.rows.append((1e3 * used / seconds, *np.percentile(latency, [50, 99]).tolist(), float(latency.max())))
        self.heard.clear()
        return first + count

    def row(self, rate_hz: float) -> str:
        """Its line of the table."""
        cpu, p50, p99, worst = (median(values) for values in zip(*self.rows, strict=True))
        return f"{rate_hz:8.0f} {self.name:>6} {cpu:10.0f} {p50:8.2f} {p99:8.2f} {worst:8.2f} {self.lost:7d}"


def compare(machine: str, rate_hz: float, seconds: float, rounds: int) -> None:
    """Measure both nodes at one rate, in turns, and print their lines and the ratio."""
    with tempfile.TemporaryDirectory() as folder, running_suite(Path(folder), "events") as suite:
        command = [sys.executable, "-m", "tests.benchmarks.floor_node", "--ros-args", "-r", "__ns:=/floor"]
        floor = Program(command, Path(folder) / "floor.log", suite.environment)
        suite.processes.append(floor)
        twin = suite.start("twin_node", f"machine:={machine}", f"rate_hz:={rate_hz}", remaps=["__ns:=/twin"])
        nodes = [Answers("floor", floor, suite), Answers("twin", twin, suite)]
        for each in nodes:
            suite.spin_until(each.input.get_subscription_count, each.name)
        suite.spin_for(2.0)
        number = 0
        for _ in range(rounds):
            following = [each.measure(rate_hz, seconds, number) for each in nodes]
            number = following[0]
        for each in nodes:
            print(each.row(rate_hz))
        ratio = median(twin[0] / floor[0] for floor, twin in zip(nodes[0].rows, nodes[1].rows, strict=True))
        print(f"{rate_hz:8.0f}  ratio {ratio:9.2f}", flush=True)


def sample_costs(count: int = 4000) -> str:
    """Processor time of one sample in the whole session, one after the other, as a live node takes them."""
    outputs = ("balancing_torque_Nm", "point_F_x_m", "point_F_y_m")
    session = ttc.compile(ttc.machines.tufting(), outputs=outputs).session()
    for first in (0, count):  # what is learnt of the encoder, and what is compiled, comes before
        used = time.process_time()
        for k in range(first, first + count):
            session.step_one(2_000_000 * k, OMEGA * 0.002 * k)
        used = time.process_time() - used
    return f"one sample, estimator and prediction, with warm caches: {1e6 * used / count:.0f} us"


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=float, nargs="+", default=[200.0, 500.0, 1000.0, 5000.0])
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--machine", default="tufting", help="name of a machine, or a machine file")
    options = parser.parse_args()
    print(sample_costs())
    print(f"{'rate/Hz':>8} {'node':>6} {'CPU ms/s':>10} {'p50/ms':>8} {'p99/ms':>8} {'max/ms':>8} {'lost':>7}")
    for rate in options.rates:
        compare(options.machine, rate, options.seconds, options.rounds)


if __name__ == "__main__":
    main()
