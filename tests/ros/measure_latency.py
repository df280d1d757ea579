"""Latency and processor time of twin_node at several sample rates: `python -m tests.ros.measure_latency`.

One process publishes angle and torque at a steady rate and hears the predicted torque; latency is from publishing a
sample to hearing its prediction. CPU is that of the twin alone, of one core.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PointStamped, WrenchStamped
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE, Suite, running_suite
from textile_twin_ros.messages import JointTemplate, TorqueReader, WrenchTemplate
from textile_twin_ros.pacing import Pace


def cpu_seconds(pid: int) -> float:
    """Processor time a process has used so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(suite: Suite, rate_hz: float, seconds: float, parameters: list[str]) -> str:
    """One row of the table."""
    twin = suite.start("twin_node", 'wait_for:=["balancing_torque/predicted"]', f"rate_hz:={rate_hz}", *parameters)
    node = suite.node()
    heard: dict[int, int] = {}
    reader = TorqueReader()

    def hear(raw: bytes) -> None:
        heard[reader.read(raw)[0]] = time.monotonic_ns()

    angles = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    torques = node.create_publisher(WrenchStamped, "balancing_torque/measured", RELIABLE)
    node.create_subscription(WrenchStamped, "balancing_torque/predicted", hear, RELIABLE, raw=True)
    for topic, msgtype in (("needle/position", PointStamped), ("joint_states", JointState)):
        node.create_subscription(msgtype, topic, lambda raw: None, RELIABLE, raw=True)
    suite.spin_until(lambda: angles.get_subscription_count() and torques.get_subscription_count(), "twin")
    count = round(rate_hz * seconds)
    sent: dict[int, int] = {}
    used = cpu_seconds(twin.process.pid)

    def publish() -> None:
        angle, torque, pace = JointTemplate(["main_shaft"], velocities=False), WrenchTemplate("main_shaft"), Pace(stop)
        for number in range(count):
            pace.wait_until(number / rate_hz)
            stamp = 10**18 + round(number * 1e9 / rate_hz)
            sent[stamp] = time.monotonic_ns()
            angles.publish(angle.message(stamp, 16.755 * number / rate_hz % (2.0 * np.pi)))
            torques.publish(torque.message(stamp, 1.0))

    stop = threading.Event()
    thread = threading.Thread(target=publish)
    thread.start()
    suite.spin_until(lambda: not thread.is_alive(), "all samples")
    suite.spin_for(2.0)
    used = cpu_seconds(twin.process.pid) - used
    latency = np.array([heard[stamp] - sent[stamp] for stamp in heard if stamp in sent]) / 1e3
    p50, p99 = np.percentile(latency, [50, 99])
    return f"{rate_hz:8.0f} {100 * used / seconds:8.1f} {p50:10.0f} {p99:10.0f} {count - 2 - len(heard):6d}"


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rates", type=float, nargs="+", default=[500.0, 1000.0, 2000.0])
    parser.add_argument("parameters", nargs="*", help="parameters of the twin, as executor:=single")
    options = parser.parse_args()
    print(f"{'rate/Hz':>8} {'CPU/%':>8} {'p50/us':>10} {'p99/us':>10} {'lost':>6}")
    for rate in options.rates:
        with tempfile.TemporaryDirectory() as folder, running_suite(Path(folder), "events") as suite:
            print(measure(suite, rate, options.seconds, options.parameters), flush=True)


if __name__ == "__main__":
    main()
