"""An hour of a machine: time and memory of `replay`, and of `compare` with its pictures, with the shaft's share.

Run from the root of the repository: python -m tests.benchmarks.long_recordings [--minutes 60] [--rate 500]

Each command is a process of its own; the shaft's estimator runs over the same angles in another one.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.shaft import create_estimator

_SPEED = 160.0 * 2.0 * np.pi / 60.0
_DELAY_S, _GAIN, _NOISE_NM = 0.002, 1.01, 0.02
_ESTIMATOR = "from tests.benchmarks.long_recordings import estimate; import sys; estimate(sys.argv[1], sys.argv[2])"


def record(path: Path, minutes: float, rate_hz: float) -> None:
    """An encoder of 16 bit and a torque sensor on a shaft whose speed wanders by 2 percent."""
    rng = np.random.default_rng(0)
    stamps = 10**18 + np.rint(np.arange(round(minutes * 60.0 * rate_hz)) * 1e9 / rate_hz).astype(np.int64)
    time_s = (stamps - stamps[0]) * 1e-9
    twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])

    def motion(at: np.ndarray) -> list[np.ndarray]:
        theta, omega, alpha = _SPEED * at, np.full(at.size, _SPEED), np.zeros(at.size)
        for size, rate in ((0.3, 0.7), (0.02, 16.7)):  # rad of the angle, rad/s: a drive that hunts, a ripple
            theta += size * np.sin(rate * at)
            omega += size * rate * np.cos(rate * at)
            alpha -= size * rate**2 * np.sin(rate * at)
        return [theta, omega, alpha]

    step = 2.0 * np.pi / 2**16
    theta = np.floor(motion(time_s)[0] / step) * step
    torque = twin.evaluate(*motion(time_s - _DELAY_S))["balancing_torque_Nm"]
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], np.remainder(theta, 2.0 * np.pi))
        out.write_wrenches(
            "balancing_torque/measured", stamps + 1000, _GAIN * torque + rng.normal(0.0, _NOISE_NM, theta.size)
        )


def estimate(bag: str, shaft: str) -> None:
    """Estimate the shaft's states alone: the common part of every command."""
    angles = open_bag(bag).read_angles()
    estimator = create_estimator(shaft)
    for first in range(0, len(angles), 100_000):
        estimator.step(angles.stamps[first : first + 100_000], angles.angles_rad[first : first + 100_000])
    estimator.finish()


def run(name: str, command: list[str]) -> tuple[float, float, float]:
    """Wall and processor time [s] and the largest memory [MB] of a process."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - begin
    if status:
        raise SystemExit(f"{name} ended with status {status}")
    row = wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0
    print(f"{name:28} {row[0]:8.1f} {row[1]:8.1f} {row[2]:9.0f}", flush=True)
    return row


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=500.0)
    parser.add_argument("--keep", type=Path, help="make the recording here, or take the one that is there")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bag = options.keep or Path(folder) / "hour"
        if not bag.exists():
            record(bag, options.minutes, options.rate)
        command = [str(Path(sys.executable).parent / "textile-twin")]
        pictures = [f"--{form}={Path(folder) / f'comparison.{form}'}" for form in ("json", "png", "html", "rrd")]
        print(f"{'':28} {'wall/s':>8} {'CPU/s':>8} {'memory/MB':>9}")
        run("replay", [*command, "replay", str(bag), "--machine", "tufting", "--out", str(Path(folder) / "replayed")])
        run("  its estimator, causal", [sys.executable, "-c", _ESTIMATOR, str(bag), "causal"])
        run("compare", [*command, "compare", str(bag), "--machine", "tufting", *pictures])
        run("  its estimator, smooth", [sys.executable, "-c", _ESTIMATOR, str(bag), "smooth"])


if __name__ == "__main__":
    main()
