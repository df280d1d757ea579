"""An angle in another unit than radians: reported by every command, with or without torque, and corrected by one
option.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.generators.mill_recordings import healthy, record
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter, open_bag

MADE = record(healthy("tufting", 921, duration_s=14.0))
SAID = "the angle wraps at 360 and looks like degrees, not radians: give --angle-unit deg"


def write(path: Path, turn: float = 360.0, torque: bool = False, speeds: bool = False) -> Path:
    angle = MADE.angle * (turn / (2.0 * math.pi))
    velocity = np.gradient(np.unwrap(MADE.angle), MADE.angle_stamps_ns * 1e-9) * (turn / (2.0 * math.pi))
    with BagWriter(path) as out:
        out.write_joint_states(
            "main_shaft/angle", MADE.angle_stamps_ns, ["main_shaft"], angle, velocity if speeds else None
        )
        if torque:
            out.write_wrenches("balancing_torque/measured", MADE.torque_stamps_ns, MADE.torque)
    return path


def replay(bag: Path, out: Path, *options: str) -> np.ndarray:
    assert main(["replay", str(bag), "--machine", "tufting", "--out", str(out), *options]) == 0
    return open_bag(out).read_torques("balancing_torque/predicted").torque_Nm


@pytest.mark.parametrize("speeds", [False, True])
def test_replay_without_a_torque_sensor(tmp_path: Path, capsys: pytest.CaptureFixture[str], speeds: bool) -> None:
    right = replay(write(tmp_path / "rad", turn=2.0 * math.pi, speeds=speeds), tmp_path / "right")
    assert capsys.readouterr().err == ""
    bag = write(tmp_path / "deg", speeds=speeds)
    wrong = replay(bag, tmp_path / "wrong")
    assert capsys.readouterr().err == f"textile-twin: topic /main_shaft/angle: {SAID}\n"
    assert np.abs(wrong - right).max() > 10.0
    np.testing.assert_allclose(replay(bag, tmp_path / "mended", "--angle-unit", "deg"), right, atol=1e-6)
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_compare_says_it_once_and_is_mended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["compare", str(write(tmp_path / "deg", torque=True)), "--machine", "tufting", "--json"]
    assert main([*command, str(tmp_path / "c.json")]) == 0
    told = capsys.readouterr()
    assert told.err == "" and told.out.count("degrees") == 1 and "--angle-unit deg" in told.out
    assert main([*command, str(tmp_path / "d.json"), "--angle-unit", "deg"]) == 0
    wrong, mended = (json.loads((tmp_path / name).read_text())["verdict"] for name in ("c.json", "d.json"))
    assert wrong[0]["cause"] == "angle_unit" and not mended


def test_a_dead_torque_sensor_does_not_hide_it(tmp_path: Path) -> None:
    bag = write(tmp_path / "deg")
    with BagWriter(tmp_path / "dead") as out:
        out.copy_topic(open_bag(bag), "main_shaft/angle")
        out.write_wrenches("balancing_torque/measured", MADE.torque_stamps_ns, np.full(MADE.torque.size, 0.25))
    assert main(["compare", str(tmp_path / "dead"), "--machine", "tufting", "--json", str(tmp_path / "c.json")]) == 0
    assert json.loads((tmp_path / "c.json").read_text())["notes"][-1] == SAID


def test_monitor_reports_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write(tmp_path / "deg", torque=True)
    main(["monitor", str(bag), "--machine", "tufting", "--learn", "5"])
    assert SAID in capsys.readouterr().out
    assert main(["monitor", str(bag), "--machine", "tufting", "--learn", "5", "--angle-unit", "deg"]) == 0
    assert "degrees" not in capsys.readouterr().out


def test_an_unknown_unit_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(tmp_path), "--machine", "tufting", "--angle-unit", "degrees"]) == 2
    assert "must be rad, deg, rev, gon, or the counts of a turn, not 'degrees'" in capsys.readouterr().err
