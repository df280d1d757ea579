"""Logs whose units contradict their values: reported beside the choice, or refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag

TIME = np.arange(3000) * 0.002
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
TURN = 2.0 * math.pi


def imported(tmp_path: Path, head: str, time: np.ndarray, angle: np.ndarray, *options: str) -> int:
    log = tmp_path / "log.csv"
    rows = [f"{t:.15g},{a:.9f}" for t, a in zip(time, angle, strict=True)]
    log.write_text("\n".join([head, *rows]) + "\n")
    return main(["import", str(log), "--out", str(tmp_path / "bag"), *options])


@pytest.mark.parametrize(
    ("unit", "turn", "objection"),
    [
        ("rad", 360.0, "as degrees do: if they are, tell --angle-unit deg"),
        ("deg", TURN, "as radians do: if they are, tell --angle-unit rad"),
        ("grad", 400.0, "as gradians do: if they are, tell --angle-unit gon"),
        ("grad", 360.0, ""),
        ("deg", 360.0, ""),
        ("rev", 1.0, ""),
        ("deg", 720.0, ""),
        ("rad", 3.0, ""),
    ],
)
def test_an_angle_that_wraps_as_another_unit(
    unit: str, turn: float, objection: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, f"time [s],angle [{unit}]", TIME, ANGLE / TURN * turn) == 0
    said = capsys.readouterr().out
    assert objection in said and ("begins anew" in said) == bool(objection)


def test_given_counts_of_a_turn_are_no_other_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(tmp_path, "time [s],angle", TIME, ANGLE / TURN * 400.0, "--angle-unit", "400") == 0
    assert "begins anew" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("unit", "objection"), [("ms", "2e-06 s from row to row"), ("min", "0.12 s"), ("hours", "7.2 s")]
)
def test_times_in_a_unit_at_which_no_shaft_is_logged(
    unit: str, objection: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, f"time [{unit}],angle [rad]", TIME, ANGLE) == 0
    said = capsys.readouterr().out
    assert ("if the unit is another, tell --time-unit" in said) == (unit != "min")
    assert (objection in said) == (unit != "min")


@pytest.mark.parametrize("unit", ["h", "hours"])
def test_hours(unit: str, tmp_path: Path) -> None:
    assert imported(tmp_path, f"time [{unit}],angle [rad]", TIME / 3600.0, ANGLE) == 0
    stamps = open_bag(tmp_path / "bag").read_angles().stamps
    np.testing.assert_allclose((stamps - stamps[0]) * 1e-9, TIME, atol=1e-6)


@pytest.mark.parametrize("since", [0.0, 1.7e9])
def test_times_that_fall_are_refused(since: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(tmp_path, "time [s],angle [rad]", since + TIME[::-1], ANGLE) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "column 'time [s]' goes back, first at row 2: sort the rows by time" in said
    assert not (tmp_path / "bag").exists()


def test_a_time_far_before_the_first_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time = TIME + 100.0
    time[1500] = 0.0
    assert imported(tmp_path, "time [s],angle [rad]", time, ANGLE) == 2
    assert "goes back, first at row 1501" in capsys.readouterr().err
