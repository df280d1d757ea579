"""Wheels and shafts of real machines, as their public recordings tell them: many start and stop within a reading.

From git directories of fetched copies of gabrieleginestroni/ros-robotics-2022 (project1/bags: 49 Hz, 42 ticks a turn),
yschen13/SLAM_ParticleFilter (Encoders*.npz: 40 Hz, 360 counts a turn, stamps of the host), opatiny/micromouse
(matlab/data: 1 degree, 5 to 10 ms), FOME-Tech/fome-fw (an engine's start, 260 to 1680 rpm, edges of 60 teeth less 1,
fed as sampled angles), gevanst/Jetting_Propulsion_Control (a crank that drives a plunger, 12 bits, 2 to 10 ms, stamps
in whole milliseconds) and Alfystar/mv-Project (steps of a motor's voltage, 621 counts a turn, 2 to 15 ms). They are
fetched beside the project, never committed.

Run from the root of the repository: python -m tests.benchmarks.wheel_records GIT_DIRECTORY ..
Every second reading is fed, the others are predicted; RMS error over that of the textbook's filter tuned on the record.
"""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from tests.benchmarks.shaft_judge.engine_score import predict
from tests.benchmarks.shaft_judge.views import package, tuned

TICKS_A_TURN, COUNTS_A_TURN, TEETH, MOTOR_COUNTS = 42, 360, 60, 621
FEWEST, MOST = 300, 20_000  # readings of a record that count


@dataclass(frozen=True)
class Wheel:
    """One wheel of one recording: stamps [s] and angles [rad], both (n,)."""

    name: str
    time_s: np.ndarray
    angle_rad: np.ndarray


def wheels(repository: Path) -> Iterator[Wheel]:
    """All wheels that move in a repository's recordings."""
    listing = ["git", "-C", str(repository), "ls-tree", "-r", "--name-only", "HEAD"]
    for path in subprocess.run(listing, check=True, capture_output=True, text=True).stdout.splitlines():
        for begin, reader in READERS.items():
            if path.startswith(begin) and not path.endswith((".ino", ".m", ".bin", ".mat", ".png")):
                show = ["git", "-C", str(repository), "show", f"HEAD:{path}"]
                data = subprocess.run(show, check=True, capture_output=True).stdout
                for number, (time, angle) in enumerate(reader(data)):
                    fresh = np.append(True, np.diff(time) > 0.0)
                    if np.ptp(angle) > 2.0 * np.pi:
                        name = "/".join(Path(path).with_suffix("").parts[-2:])
                        yield Wheel(f"{name}/{number}", time[fresh][:MOST], angle[fresh][:MOST])


def _bag(data: bytes) -> list[tuple[np.ndarray, np.ndarray]]:
    store = get_typestore(Stores.ROS1_NOETIC)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "wheels.bag"
        file.write_bytes(data)
        with Reader(file) as bag:
            chosen = [each for each in bag.connections if each.topic == "/wheel_states"]
            told = [store.deserialize_ros1(raw, one.msgtype) for one, _, raw in bag.messages(connections=chosen)]
    time = np.array([each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in told])
    ticks = np.array([each.position for each in told])
    return [(time - time[0], column * 2.0 * np.pi / TICKS_A_TURN) for column in ticks.T]


def _counts(data: bytes) -> list[tuple[np.ndarray, np.ndarray]]:
    with np.load(io.BytesIO(data)) as told:
        time, counts = told["time_stamps"] - told["time_stamps"][0], np.cumsum(told["counts"], axis=1)
    return [(time, row * 2.0 * np.pi / COUNTS_A_TURN) for row in counts]


def _robot(data: bytes) -> list[tuple[np.ndarray, np.ndarray]]:
    told = np.genfromtxt(io.BytesIO(data), delimiter=",", skip_header=1)
    return [(1e-3 * (told[:, 0] - told[0, 0]), np.deg2rad(told[:, column])) for column in (1, 2)]


def _crank(data: bytes) -> list[tuple[np.ndarray, np.ndarray]]:
    told = np.genfromtxt(io.BytesIO(data), delimiter=",", skip_header=1)
    edges = told[1:, 0][np.diff(told[:, 1]) > 0.0][8:]  # the first are no edges of a wheel that turns
    interval = np.diff(edges)
    teeth = np.ones(interval.size)
    teeth[1:-1][interval[1:-1] > 1.6 * np.sqrt(interval[:-2] * interval[2:])] = 2.0
    return [(edges - edges[0], np.append(0.0, np.cumsum(teeth)) * 2.0 * np.pi / TEETH)]


def _plunger(data: bytes) -> list[tuple[np.ndarray, np.ndarray]]:
    told = _numbers(data, ",", (0, 1))
    rising = told[:, 0] >= np.maximum.accumulate(told[:, 0])
    angle = np.unwrap(told[rising, 1] * 2.0 * np.pi / 4096)
    return [(1e-3 * (told[rising, 0] - told[0, 0]), angle)] if angle.size > FEWEST else []


def _motor(data: bytes) -> list[tuple[np.ndarray, np.ndarray]]:
    interval = re.search(rb"dt=(\d+)|Prescaler\s*\n(\d+)", data)
    counts = _numbers(data, None, (1, 1, 2, 3))[:, 0]
    if interval is None or counts.size <= FEWEST:
        return []
    step = 1e-3 * int(interval[1] or interval[2])
    return [(step * np.arange(counts.size), counts * 2.0 * np.pi / MOTOR_COUNTS)]


def _numbers(data: bytes, separator: str | None, columns: tuple[int, ...]) -> np.ndarray:
    """These columns of the lines that have them as numbers: (n, columns)."""
    rows = []
    for line in data.decode(errors="replace").splitlines():
        fields = line.split(separator)
        with contextlib.suppress(ValueError, IndexError):
            rows.append([float(fields[column]) for column in columns])
    return np.array(rows).reshape(-1, len(columns))


READERS = {
    "project1/bags/bag": _bag,
    "Encoders": _counts,
    "matlab/data/encoders": _robot,
    "unit_tests/tests/trigger/resources/nick_1.csv": _crank,
    "Dodisicus_Enc_Logging/Log_encoder_": _plunger,
    "Dodisicus_PID_Logging/": _plunger,
    "02_SystemAnalysis/03_EstimationScript/MotorTF/SpeedData/": _motor,
}


def main() -> None:
    """Print a line for each wheel and view."""
    for repository in sys.argv[1:]:
        for wheel in wheels(Path(repository)):
            line = f"{wheel.name[-44:]:44} {wheel.time_s.size:6d} readings"
            for view in ("causal", "smooth"):
                made, book = (predict(who, wheel, wheel.angle_rad, view) for who in (package, tuned))
                inside = " ".join(f"{share:.2f}" for share in made.inside)
                line += f"   {view} {made.rms / book.rms:5.2f} ({1e3 * made.rms:6.1f} mrad, inside {inside})"
            print(line, flush=True)


if __name__ == "__main__":
    main()
