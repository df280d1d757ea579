"""textile-twin drive: motion under a torque, by number and by table, and the torque from that motion."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.files import read_motion_table
from textile_twin_core.recordings.log_files import read_table


def test_the_torque_that_drove_it_comes_back_from_simulate(tmp_path: Path) -> None:
    motion, torque = tmp_path / "motion.csv", tmp_path / "torque.csv"
    arguments = ["tufting", "--set", "backing_force_N=0", "--torque", "2.5", "--time", "1.5", "--rpm", "100"]
    assert main(["drive", *arguments, "--out", str(motion)]) == 0
    table = read_motion_table(motion)
    assert table.omega_rad_s[0] == pytest.approx(100.0 * math.pi / 30.0)
    assert main(["simulate", *arguments[:3], "--input", str(motion), "--out", str(torque)]) == 0
    np.testing.assert_allclose(read_table(torque)[0]["balancing_torque_Nm"], 2.5, atol=1e-6)


@pytest.mark.parametrize("over", ["time_s", "theta_rad"])
def test_a_torque_from_a_table(over: str, tmp_path: Path) -> None:
    place = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    rows = "\n".join(f"{x:.9g},{3.0 + math.sin(x):.9g}" for x in place)
    (tmp_path / "torque.csv").write_text(f"{over},torque_Nm\n{rows}\n")
    out = tmp_path / "motion.parquet"
    arguments = ["drive", "handloom_beatup", "--torque", str(tmp_path / "torque.csv"), "--time", "0.5"]
    assert main([*arguments, "--out", str(out)]) == 0
    columns = read_table(out)[0]
    given = np.interp(columns["time_s"], place, 3.0 + np.sin(place)) if over == "time_s" else None
    expected = 3.0 + np.sin(columns["theta_rad"]) if given is None else given
    np.testing.assert_allclose(columns["drive_torque_Nm"], expected, atol=2e-3)


@pytest.mark.parametrize("torque", ["-1e-3", "-.5E+1", "-5."])
def test_a_negative_torque_is_no_option(torque: str, tmp_path: Path) -> None:
    out = tmp_path / "motion.csv"
    assert main(["drive", "handloom_beatup", "--torque", torque, "--rpm", "9", "--time", "0.1", "--out", str(out)]) == 0
    np.testing.assert_array_equal(read_table(out)[0]["drive_torque_Nm"], float(torque))


def test_mistakes_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "odd.csv").write_text("a,b\n1,2\n3,4\n")
    out = str(tmp_path / "motion.csv")
    for torque, says in ((str(tmp_path / "odd.csv"), "time_s"), ("nan", "finite"), ("none.csv", "no such file")):
        assert main(["drive", "tufting", "--torque", torque, "--time", "1", "--out", out]) == 2
        error = capsys.readouterr().err
        assert says in error and error.count("\n") == 1


@pytest.mark.parametrize("rows", ["0,1\n1,nan\n2,3\n", "0,1\n2,1\n1,1\n", "0,1\n"])
def test_an_invalid_table_of_torques_is_named(rows: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = tmp_path / "odd.csv", tmp_path / "motion.csv"
    table.write_text(f"time_s,torque_Nm\n{rows}")
    assert main(["drive", "tufting", "--torque", str(table), "--time", "1", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"textile-twin: {table}: drive torque over time: ") and error.count("\n") == 1


@pytest.mark.parametrize(("times", "reported"), [((0.0, 0.1), False), ((0.0, 0.05), True), ((0.02, 0.1), True)])
def test_a_table_that_ends_too_early_is_an_error(
    times: tuple[float, float], reported: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, out = tmp_path / "torque.csv", tmp_path / "motion.csv"
    table.write_text(f"time_s,torque_Nm\n{times[0]},1\n{times[1]},2\n")
    assert main(["drive", "handloom_beatup", "--torque", str(table), "--time", "0.1", "--out", str(out)]) == 0
    says = f"has the torque from {times[0]:g} to {times[1]:g} s; it is taken as constant before and after"
    assert (says in capsys.readouterr().err) == reported


def test_the_table_of_torques_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "torque.csv"
    table.write_text("time_s,torque_Nm\n0,10\n1,10\n")
    assert main(["drive", "tufting", "--torque", str(table), "--time", "0.1", "--out", str(table)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert table.read_text().startswith("time_s,torque_Nm\n")


@pytest.mark.parametrize("motion", [("--torque", "1e9"), ("--torque", "30", "--rpm", "1e6")])
def test_a_motion_that_runs_away_is_one_line(
    motion: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str], recwarn: pytest.WarningsRecorder
) -> None:
    out = tmp_path / "motion.csv"
    assert main(["drive", "tufting", *motion, "--time", "1", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert not recwarn.list and not out.exists()
