"""service.sh: a unit valid for systemd, with the arguments of suite.sh."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[2]


def service(*words: str) -> subprocess.CompletedProcess[str]:
    command = [str(ROOT / "launch_scripts" / "service.sh"), *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_the_unit_is_one_that_systemd_takes(tmp_path: Path) -> None:
    made = service("loom_3", "examples/six_bar_loom.yaml", "--shaft", "simulated", "-p", "twin_node:shaft:=lag")
    assert made.returncode == 0, made.stderr
    start = made.stdout.split("ExecStart=")[1].split("\nKillMode")[0]
    assert (
        f'"{ROOT}/examples/six_bar_loom.yaml" "--shaft" "simulated" "-p" "twin_node:shaft:=lag" -r "__ns:=/loom_3"'
        in start
    )
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not here to verify it")
    unit = tmp_path / "textile-twin-loom_3.service"
    unit.write_text(made.stdout)
    verified = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True)
    assert (verified.returncode, verified.stderr) == (0, "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["loom_3", "tuffting"], "there is no machine 'tuffting'"),
        (["loom_3", "tufting", "-p", "twin_node:shft:=lag"], "no parameter 'shft'"),
        (["loom-3"], "NAME must be a ROS namespace"),
    ],
)
def test_a_mistake_is_reported_before_a_unit_is_printed(words: list[str], said: str) -> None:
    made = service(*words)
    assert (made.returncode, made.stdout) == (2, "")
    (line,) = made.stderr.splitlines()
    assert said in line
