"""Copy of the repository in which the commands of a page run and write their outputs."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from shutil import copyfile

import numpy as np

from launch_scripts.this_computer import this_computer_alone
from tests.docs.pages import ROOT, Block
from textile_twin_core.recordings import BagWriter, open_bag

PATIENCE_S = 300.0
BIN = Path(sys.prefix) / "bin"


def furnish(folder: Path) -> None:
    """Lay out the repository in a folder, with the preconditions of its pages.

    The long recording has its name but only its first 16 s: run-up and some turns.
    """
    for name in ("docs", "examples", "tests", "textile_twin_core", "ros2_ws", "pyproject.toml"):
        (folder / name).symlink_to(ROOT / name)
    (folder / ".venv").symlink_to(sys.prefix)
    (folder / "out").mkdir()
    (folder / "launch_scripts").mkdir()
    for script in (ROOT / "launch_scripts").glob("*.sh"):  # they find the repository relative to their own path
        wrapper = folder / "launch_scripts" / script.name
        wrapper.write_text(f'#!/bin/sh\nexec "{script}" "$@"\n')
        wrapper.chmod(0o755)
    (folder / "bags").mkdir()
    for bag in (ROOT / "bags").iterdir():
        if bag.name != "tufting_160rpm_synthetic":
            (folder / "bags" / bag.name).symlink_to(bag)
    _readers_own(folder)


def _readers_own(folder: Path) -> None:
    stamps, angles, torque_stamps, torques = _short_recording()
    with BagWriter(folder / "bags" / "tufting_160rpm_synthetic") as bag:
        bag.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], angles)
        bag.write_wrenches("balancing_torque/measured", torque_stamps, torques)
    torque = np.interp(stamps, torque_stamps, torques)
    seconds = (stamps - stamps[0]) * 1e-9
    tables = {
        "log.csv": (["time_s", "angle_rad", "torque_Nm"], [seconds, angles, torque], ","),
        "next.csv": (["time_s", "angle_rad", "torque_Nm"], [seconds, angles, torque], ","),
        "messung.txt": (["Zeit [s]", "Winkel [deg]", "Md"], [seconds, np.degrees(angles), 100.0 * torque], ";"),
        "raw.txt": (None, [np.floor(angles * 4096 / (2 * np.pi)), torque / 5.0], ","),
        "path.csv": (["x_m", "y_m"], [np.cos(np.arange(8.0)), 0.3 * np.sin(np.arange(8.0))], ","),
    }
    for name, (header, columns, separator) in tables.items():
        with (folder / name).open("w", newline="") as file:
            writer = csv.writer(file, delimiter=separator)
            writer.writerows([header] if header else [])
            writer.writerows(zip(*(np.asarray(column).tolist() for column in columns), strict=True))
    copyfile(ROOT / "examples" / "six_bar_loom.yaml", folder / "my_loom.yaml")


@cache
def _short_recording(seconds: float = 16.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    bag = open_bag(ROOT / "bags" / "tufting_160rpm_synthetic")
    angle, torque = bag.read_angles("main_shaft/angle"), bag.read_torques("balancing_torque/measured")
    last = angle.stamps[0] + int(seconds * 1e9)
    here, there = angle.stamps < last, torque.stamps < last
    return angle.stamps[here], angle.angles_rad[here], torque.stamps[there], torque.torque_Nm[there]


def run(block: Block, folder: Path, ros_domain: int) -> str:
    """Run a block as a reader would, and return its output. Raises AssertionError with the output on failure."""
    home = folder / ".home"
    home.mkdir(exist_ok=True)
    environment = os.environ | {
        "PATH": f"{BIN}:{os.environ['PATH']}",
        "HOME": str(home),
        "BROWSER": "true",
        "MPLBACKEND": "agg",
        "PYTHONUNBUFFERED": "1",
        "ROS_DOMAIN_ID": str(ros_domain),
        **this_computer_alone(),
        "ROS_LOG_DIR": str(home / "log"),
    }
    commands = {"bash": ["bash", "-euo", "pipefail", "-c"], "python": [sys.executable, "-c"]}
    text = "\n".join(filter(None, (block.marks.get("first") if block.language == "bash" else None, block.text)))
    log = folder / ".said"
    with log.open("wb") as said:
        process = subprocess.Popen(
            [*commands[block.language], text],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        expected = block.marks.get("Ctrl-C after")
        try:
            if expected is not None:
                _wait_for(expected, log, process)
                os.killpg(process.pid, signal.SIGINT)
            code = process.wait(PATIENCE_S)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    told = log.read_text(errors="replace")
    ends = (0,) if expected is None else (0, 128 + signal.SIGINT, -signal.SIGINT)
    assert code in ends, f"{block.place} ended with exit code {code}:\n{block.text}\n{told[-3000:]}"
    return told


def _wait_for(text: str, log: Path, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE_S
    while text not in (told := log.read_text(errors="replace")):
        assert process.poll() is None, f"it ended before it said '{text}':\n{told[-3000:]}"
        assert time.monotonic() < until, f"it did not say '{text}':\n{told[-3000:]}"
        time.sleep(0.1)
