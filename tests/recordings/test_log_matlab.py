"""MATLAB files with the log in structures, as Simulink and measuring programs save it."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag

N = 2000
TIME = np.arange(N) * 0.002
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
DEG = np.degrees(ANGLE)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0
PLAIN = {"time": TIME, "angle_deg": DEG, "torque_Nm": TORQUE}
SIGNALS = np.array([(DEG, "angle [deg]"), (TORQUE, "torque [Nm]")], dtype=[("values", object), ("label", object)])


def imported(tmp_path: Path, content: dict[str, Any], *options: str) -> int:
    savemat(tmp_path / "log.mat", content)
    return main(["import", str(tmp_path / "log.mat"), "--out", str(tmp_path / "bag"), *options])


@pytest.mark.parametrize(
    ("content", "options"),
    [
        ({"log": PLAIN}, []),
        ({"log": {"about": "loom 3", "signals": PLAIN}}, []),
        ({"log": PLAIN, "other": {"angle": DEG[:9], "torque": TORQUE[:9]}}, ["--table", "log"]),
        ({"scope": {"time": TIME, "signals": SIGNALS}}, []),
        ({"scope": {"time": TIME, "signals": {"values": np.c_[DEG, TORQUE], "label": "ch"}}},
         ["--angle", "ch_1", "--angle-unit", "deg", "--torque", "ch_2"]),
        ({"log": {"time": TIME, "values": np.c_[DEG, TORQUE]}},
         ["--angle", "values_1", "--angle-unit", "deg", "--torque", "values_2"]),
        ({"angle": {"time": TIME, "data": DEG, "unit": "deg"}, "torque": {"time": TIME, "data": TORQUE, "unit": "Nm"}},
         []),
    ],
)  # fmt: skip
def test_structures(content: dict[str, Any], options: list[str], tmp_path: Path) -> None:
    assert imported(tmp_path, content, *options) == 0
    angles, torques = open_bag(tmp_path / "bag").read_angles(), open_bag(tmp_path / "bag").read_torques()
    np.testing.assert_allclose(angles.angles_rad, ANGLE, atol=1e-12)
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, TIME, atol=2e-9)
    np.testing.assert_allclose(torques.torque_Nm, TORQUE, atol=1e-12)


@pytest.mark.parametrize("every", [1, 2])
def test_values_at_other_times_keep_them(every: int, tmp_path: Path) -> None:
    late = {"time": TIME[::every] + 0.001, "data": TORQUE[::every], "unit": "Nm"}
    assert imported(tmp_path, {"angle": {"time": TIME, "data": DEG}, "torque": late}) == 0
    angles, torques = open_bag(tmp_path / "bag").read_angles(), open_bag(tmp_path / "bag").read_torques()
    np.testing.assert_allclose((torques.stamps - angles.stamps[0]) * 1e-9, TIME[::every] + 0.001, atol=2e-9)
    np.testing.assert_allclose(torques.torque_Nm, TORQUE[::every], atol=1e-12)


@pytest.mark.parametrize(("short", "code"), [("torque_Nm", 0), ("angle_deg", 2)])
def test_a_shorter_vector_is_reported(
    short: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, {"log": {**PLAIN, short: PLAIN[short][::2]}}) == code
    said = capsys.readouterr()
    assert f"column '{short}' holds 1000 values, where others have 2000" in said.out + said.err


def test_a_damaged_file_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    savemat(tmp_path / "log.mat", {"log": PLAIN}, do_compression=True)
    whole = bytearray((tmp_path / "log.mat").read_bytes())
    whole[len(whole) // 2] ^= 0xFF
    (tmp_path / "log.mat").write_bytes(whole)
    assert main(["import", str(tmp_path / "log.mat"), "--out", str(tmp_path / "bag")]) == 2
    told = capsys.readouterr().err
    assert "log.mat: not a MATLAB file, or a damaged one" in told and told.count("\n") == 1


@pytest.mark.parametrize("kind", [67, 137])
def test_a_damaged_file_is_one_line_even_where_its_reader_crashes(kind: int, tmp_path: Path) -> None:
    """Byte 176 is the kind of numbers of the first variable: with an unknown kind scipy crashes."""
    savemat(tmp_path / "log.mat", {"t": TIME, "angle_rad": ANGLE})
    damaged = bytearray((tmp_path / "log.mat").read_bytes())
    damaged[176] = kind
    (tmp_path / "log.mat").write_bytes(damaged)
    command = [sys.executable, "-m", "textile_twin_core.cli.main", "import", str(tmp_path / "log.mat")]
    ended = subprocess.run([*command, "--out", str(tmp_path / "bag")], capture_output=True, text=True, check=False)
    assert ended.returncode == 2, ended
    assert ended.stderr.count("\n") == 1 and str(tmp_path / "log.mat") in ended.stderr
    assert not (tmp_path / "bag").exists()
