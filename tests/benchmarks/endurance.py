"""1 kHz into twin, recorder and view for long: samples lost and doubled, latency, and each node's CPU and memory.

Run from the root of the repository: python -m tests.benchmarks.endurance [MINUTES [RATE_HZ]]
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from tests.ros.suite import SECOND_NS, Program, Suite, running_suite
from textile_twin_core.arrays import IntArray
from textile_twin_core.recordings import Bag, open_bag

ANGLE, PREDICTED = "main_shaft/angle", "balancing_torque/predicted"
LOOK_S = 5.0
TELL_S = 300.0
WARM_SAMPLES = 120_000
"""Number of samples after which the view's memory for later viewers is full, and every pool has its size."""


class Watch:
    """Memory [MB] and CPU [s] of nodes as they go on."""

    def __init__(self, programs: dict[str, Program], warm_s: float) -> None:
        self._programs, self._began, self._warm_s = programs, time.monotonic(), warm_s
        self.memory: dict[str, list[tuple[float, float]]] = {name: [] for name in programs}
        self.cpu_s: dict[str, float] = dict.fromkeys(programs, 0.0)

    def look(self) -> None:
        """Note memory and processor time of each node."""
        self.seconds = time.monotonic() - self._began
        for name, program in self._programs.items():
            pid = program.process.pid
            pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) if program.process.poll() is None else 0
            if pages:  # none are left of one that is just ending
                self.memory[name].append((self.seconds, pages * os.sysconf("SC_PAGE_SIZE") / 1e6))
                fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
                self.cpu_s[name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def rows(self) -> list[str]:
        """A line for each node."""
        head = f"MB an hour after {self._warm_s:g} s"
        lines = [f"{'node':12} {'CPU %':>6} {'MB':>7} {head:>24}"]
        for name, samples in self.memory.items():
            seconds, megabytes = np.array(samples).T
            late = seconds > min(self._warm_s, 0.5 * seconds[-1])
            slope = 3600.0 * np.polyfit(seconds[late], megabytes[late], 1)[0] if late.sum() > 3 else float("nan")
            lines.append(
                f"{name:12} {100.0 * self.cpu_s[name] / self.seconds:6.1f} {megabytes[-1]:7.1f} {slope:+24.1f}"
            )
        return lines


def endurance(suite: Suite, minutes: float, rate_hz: float) -> None:
    """Run for so long, and tell."""
    bag = suite.folder / "endurance"
    programs = {
        "record_node": suite.start("record_node", f"bag:={bag}", f"rate_hz:={rate_hz}"),
        "twin_node": suite.start("twin_node"),
        "view_node": suite.start("view_node", "memory_limit:=16MB"),
    }
    for name, words in (("record_node", "recording to"), ("twin_node", "predicting from"), ("view_node", "look at it")):
        programs[name].wait_for_words(words)
    time.sleep(2.0)
    programs["shaft_node"] = suite.start("shaft_node", f"rate_hz:={rate_hz}", f"duration_s:={60.0 * minutes}")
    watch = Watch(programs, WARM_SAMPLES / rate_hz)
    told = 0.0
    while programs["shaft_node"].process.poll() is None:
        time.sleep(LOOK_S)
        watch.look()
        if watch.seconds - told > TELL_S:
            told = watch.seconds
            print(f"after {told:.0f} s", *watch.rows(), sep="\n", flush=True)
    time.sleep(2.0)
    for name in ("record_node", "twin_node", "view_node"):
        programs[name].end(signal.SIGINT)
    print("\n".join([*_samples(open_bag(bag), rate_hz), "", *watch.rows()]))


def _samples(recorded: Bag, rate_hz: float) -> list[str]:
    """Counts of samples, by the recording."""
    arrived = {topic: _log_times(recorded, topic) for topic in (ANGLE, PREDICTED)}
    lines = [f"{'topic':28} {'messages':>9} {'lost':>5} {'doubled':>8}"]
    for topic, times in arrived.items():
        counts = Counter(stamp for stamp, _ in times)
        doubled = counts.total() - len(counts)
        lines.append(f"{topic:28} {counts.total():9} {_holes(np.array(sorted(counts)), rate_hz):5} {doubled:8}")
    angles, predicted = dict(arrived[ANGLE]), dict(arrived[PREDICTED])
    late = np.array([predicted[stamp] - angles[stamp] for stamp in predicted if stamp in angles]) * 1e-6
    p50, p99, largest = (np.percentile(late, share) for share in (50, 99, 100))
    return [*lines, f"angle to prediction, as recorded: p50 {p50:.2f} ms, p99 {p99:.2f} ms, largest {largest:.1f} ms"]


def _holes(stamps: IntArray, rate_hz: float) -> int:
    """Samples that are missing between the first and the last.

    What was published before all had found each other is no loss.
    """
    return round((int(stamps[-1]) - int(stamps[0])) * rate_hz / SECOND_NS) + 1 - len(stamps)


def _log_times(bag: Bag, topic: str) -> list[tuple[int, int]]:
    """The stamp of each message and when it was recorded [ns]."""
    times = []
    for _, log_ns, raw in bag.raw_messages([topic]):
        seconds, nanoseconds = np.frombuffer(raw, "<i4,<u4", 1, 4)[0]
        times.append((int(seconds) * SECOND_NS + int(nanoseconds), log_ns))
    return times


def main() -> None:
    """Run it."""
    words = sys.argv[1:]
    minutes = float(words[0]) if words else 10.0
    rate_hz = float(words[1]) if len(words) > 1 else 1000.0
    with tempfile.TemporaryDirectory() as folder, running_suite(Path(folder)) as suite:
        endurance(suite, minutes, rate_hz)


if __name__ == "__main__":
    main()
