"""Logs in the dialects of many loggers become the same recording."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from rosbags.highlevel import AnyReader
from scipy.io import savemat

from textile_twin_core.cli.import_log import parser
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag
from textile_twin_core.shaft import create_estimator

N = 2000
TIME = np.arange(N) * 0.002
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0


def text(*columns: np.ndarray, separator: str = ",", decimal: str = ".", head: str = "") -> str:
    rows = [separator.join(f"{value:.9g}".replace(".", decimal) for value in row) for row in zip(*columns, strict=True)]
    return head + "\n".join(rows) + "\n"


DIALECTS = {
    "comma": (text(TIME, ANGLE, TORQUE, head="time_s,angle_rad,torque_Nm\n"), []),
    "german": (
        text(
            TIME * 1e3,
            np.degrees(ANGLE),
            TORQUE * 100.0,
            separator=";",
            decimal=",",
            head="Messung 17;Halle 3\nDatum: heute\nZeit [ms];Winkel [deg];Drehmoment [Ncm]\n",
        ),
        [],
    ),
    "units in a line of their own": (
        text(TIME, ANGLE / (2.0 * math.pi) * 4096.0, TORQUE, separator="\t", head="t\tEncoder\tTorque\ns\t\tNm\n"),
        ["--angle-unit", "4096"],
    ),
    "units in a line of their own, a long one among them": (
        text(TIME, ANGLE / (2.0 * math.pi) * 4096.0, TORQUE, separator=";", head="t;Encoder;Torque\ns;Inkremente;Nm\n"),
        ["--angle-unit", "4096"],
    ),
    "thousandths of a newton metre behind a stroke": (
        text(TIME, ANGLE, TORQUE * 1e3, separator=";", head="t / s;theta / rad;Torque / mNm\n"),
        [],
    ),
    "no header, decimal comma, tabs": (
        text(TIME, TORQUE, np.degrees(ANGLE), separator="\t", decimal=","),
        ["--angle", "column_3", "--torque", "column_2"],
    ),
    "spaces, no time": (
        text(ANGLE, TORQUE, separator="   "),
        ["--rate", "500", "--angle", "column_1", "--torque", "column_2", "--torque-unit", "Nm"],
    ),
    "volts": (
        text(TIME, ANGLE, TORQUE / 5.0 - 0.0, head="time,angle,torque [V]\n"),
        ["--torque-scale", "5"],
    ),
    "trailing separators and CRLF": (
        "time;theta;moment;\r\n" + text(TIME, ANGLE, TORQUE, separator=";").replace("\n", ";\r\n"),
        [],
    ),
}


_PLAIN = text(TIME, ANGLE, TORQUE, head="time,angle_rad,torque\n")
_WITH_SPEED = text(TIME, ANGLE, TORQUE, np.full(N, 16.0), head="time,angle_rad,torque,speed\n")
_HALF_SPEED = text(TIME, ANGLE, TORQUE, np.full(N, 8.0), head="time,angle_rad,torque,speed\n")


def check(bag: Path) -> None:
    angles, torques = open_bag(bag).read_angles(), open_bag(bag).read_torques()
    assert len(angles) == len(torques) == N
    np.testing.assert_allclose(angles.angles_rad, ANGLE, atol=2e-8)
    np.testing.assert_allclose(torques.torque_Nm, TORQUE, atol=2e-7)
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, TIME, atol=1e-9)


@pytest.mark.parametrize("name", DIALECTS)
def test_text_of_any_dialect(name: str, tmp_path: Path) -> None:
    content, options = DIALECTS[name]
    log = tmp_path / "log.txt"
    log.write_text(content, encoding="utf-8", newline="")
    assert main(["import", str(log), "--out", str(tmp_path / "bag"), *options]) == 0
    check(tmp_path / "bag")
    with AnyReader([tmp_path / "bag"]) as reader:  # another's reader opens it
        assert reader.message_count == 2 * N


def test_parquet_and_matlab(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "shaft_angle_deg": np.degrees(ANGLE), "torque_Nm": TORQUE}
    parquet.write_table(pyarrow.table(columns), tmp_path / "log.parquet")
    assert main(["import", str(tmp_path / "log.parquet"), "--out", str(tmp_path / "a")]) == 0
    check(tmp_path / "a")
    savemat(tmp_path / "log.mat", {"time": TIME, "theta": ANGLE, "torque": TORQUE, "fs": 500.0})
    assert main(["import", str(tmp_path / "log.mat"), "--out", str(tmp_path / "b")]) == 0
    check(tmp_path / "b")
    savemat(tmp_path / "matrix.mat", {"data": np.stack([TIME, ANGLE, TORQUE], axis=1)})
    options = ["--time", "column_1", "--angle", "column_2", "--torque", "column_3"]
    assert main(["import", str(tmp_path / "matrix.mat"), "--out", str(tmp_path / "c"), *options]) == 0
    check(tmp_path / "c")


def test_dates_keep_the_time_of_day_and_empty_cells_are_left_out(tmp_path: Path) -> None:
    rows = [f"2026-03-01T10:00:0{k // 10}.{k % 10}00,{0.1 * k:.3f},{'' if k == 3 else 1.5}" for k in range(40)]
    log = tmp_path / "log.csv"
    log.write_text("timestamp,angle_rad,torque\n" + "\n".join(rows) + "\n")
    assert main(["import", str(log), "--out", str(tmp_path / "bag"), "--torque-unit", "Nm"]) == 0
    angles, torques = open_bag(tmp_path / "bag").read_angles(), open_bag(tmp_path / "bag").read_torques()
    assert angles.stamps[0] == np.datetime64("2026-03-01T10:00:00", "ns").astype(np.int64)
    assert (len(angles), len(torques)) == (40, 39)


@pytest.mark.parametrize(
    ("content", "options", "says"),
    [
        ("", [], "is empty"),
        ("hello\nworld\n", [], "no table of numbers"),
        (text(TIME, TIME * 16.0, TORQUE, head="time,angle,torque\n"), [], "--angle-unit"),
        (text(TIME, ANGLE, ANGLE, head="time,angle_1,angle_2\n"), [], "which column is the angle"),
        (text(TIME, ANGLE, head="time,angle\n"), ["--torque", "moment"], "no column 'moment'"),
        (text(TIME, ANGLE, TORQUE, head="time,angle,torque [V]\n"), [], "--torque-scale"),
        (text(ANGLE, TORQUE, head="angle,torque\n"), [], "--rate"),
        (_WITH_SPEED, ["--speed", "speed", "--speed-unit", "furlong"], "tell --speed-unit: rad/s, rpm"),
        (_HALF_SPEED, ["--speed", "speed"], "tell --speed-unit: rad/s, rpm"),
        (_WITH_SPEED, ["--speed", "speed", "--speed-unit", "rpm"], "the angle turns 9.55 times as fast"),
        (_PLAIN, ["--speed-unit", "rpm"], "tell it with --speed:"),
        (_PLAIN, ["--rate", "1e12"], "--rate: must be at most 1e+08 rows a second, not '1e12'"),
        (_PLAIN, ["--rate", "500", "--time", "time"], "--rate and --time cannot be combined"),
        (_PLAIN, ["--torque-scale", "5", "--torque-unit", "Nm"], "--torque-scale and --torque-unit cannot be combined"),
        (_PLAIN, ["--quantity-unit", "mm"], "--quantity-unit goes with --quantity"),
        (_PLAIN, ["--drive-force-zero", "0"], "--drive-force-zero goes with --drive-force"),
        (_PLAIN, ["--pickup", "angle", "--torque", "torque"], "--pickup and --torque cannot be combined"),
    ],
)
def test_missing_information_is_requested_in_one_line(
    content: str, options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(content)
    assert main(["import", str(log), "--out", str(tmp_path / "bag"), *options]) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert not (tmp_path / "bag").exists()


def test_dates_with_the_day_first_and_a_decimal_comma(tmp_path: Path) -> None:
    rows = [f"22.11.2026 23:59:5{8 + k // 10},{k % 10}00;{0.1 * k:.3f}" for k in range(20)]
    iso = [row.replace("22.11.2026", "2026-11-22") for row in rows]
    for name, kind in (("day", rows), ("iso", iso)):
        log = tmp_path / name
        log.write_text("Uhrzeit;Winkel [°]\n" + "\n".join(kind) + "\n", encoding="cp1252")
        options = ["--angle", "Winkel [°]", "--decimal", "."] if name == "iso" else []
        assert main(["import", str(log), "--out", str(tmp_path / f"{name}_bag"), *options]) == 0
        angles = open_bag(tmp_path / f"{name}_bag").read_angles()
        np.testing.assert_allclose(angles.angles_rad, np.radians(0.1 * np.arange(20)), atol=1e-12)
        since = angles.stamps - np.datetime64("2026-11-22T23:59:58", "ns").astype(np.int64)
        np.testing.assert_allclose(since * 1e-9, 0.1 * np.arange(20), atol=1e-6)


def test_skipped_parts_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = _PLAIN.splitlines()
    torn = [row.rpartition(",")[0] if k % 10 == 5 else row for k, row in enumerate(rows)]
    (tmp_path / "torn.csv").write_text("\n".join(torn) + "\n")
    assert main(["import", str(tmp_path / "torn.csv"), "--out", str(tmp_path / "torn")]) == 0
    assert "200 of 2000 rows have other than 3 cells" in capsys.readouterr().out
    assert len(open_bag(tmp_path / "torn").read_angles()) == 1800
    log = text(np.mod(TIME, 1.0), ANGLE, TORQUE, head="time,angle_rad,torque\n")
    (tmp_path / "back.csv").write_text(log)
    assert main(["import", str(tmp_path / "back.csv"), "--out", str(tmp_path / "back"), "--time", "time"]) == 0
    assert "goes back at 3 rows, first at row 501" in capsys.readouterr().out
    log = text(np.round(TIME, 2), ANGLE, TORQUE, head="time,angle_rad,torque\n")
    (tmp_path / "coarse.csv").write_text(log)
    assert main(["import", str(tmp_path / "coarse.csv"), "--out", str(tmp_path / "coarse"), "--time", "time"]) == 0
    told = capsys.readouterr().out
    assert "rows have the time of the row before: such rows are in the recording, and are left out where" in told
    angles = open_bag(tmp_path / "coarse").read_angles()
    assert len(angles) == TIME.size
    standing = np.count_nonzero(np.diff(angles.stamps) == 0)
    assert f"; {standing} rows have the time" in told
    estimator = create_estimator("causal")
    estimator.step(angles.stamps, angles.angles_rad)
    assert estimator.report.rejected["duplicate_stamp"] == standing


@pytest.mark.parametrize(("factor", "taken"), [(1.0, True), (-1.0, False), (0.5, False), (1.04, True)])
def test_a_speed_is_taken_that_is_the_angles(
    factor: float, taken: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = text(TIME, ANGLE, np.full(N, factor * 16.0), head="time,angle_rad,speed [rad/s]\n")
    (tmp_path / "log.csv").write_text(log)
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    assert ("left out: the angle turns" in capsys.readouterr().out) is not taken
    assert (open_bag(tmp_path / "bag").read_angles().velocities is not None) is taken


_NOTHING = np.full(N, np.nan)
_HALF = np.where(np.arange(N) < N // 2, 1.0, np.nan)


@pytest.mark.parametrize(
    ("names", "columns", "options"),
    [
        ("time_s,angle_rad,torque_Nm", (TIME, _NOTHING, TORQUE), ["--angle", "angle_rad"]),
        ("time_s,angle_rad,torque_Nm", (TIME, ANGLE, _NOTHING), ["--torque", "torque_Nm"]),
        ("time_s,angle_rad,torque_Nm", (TIME * _HALF, ANGLE, TORQUE * _HALF[::-1]), []),
        ("time_s,angle_rad,torque_Nm", (TIME * _HALF, ANGLE * _HALF[::-1], TORQUE), []),
        ("t_s,angle_rad,t2_s,torque_Nm", (TIME, ANGLE, TIME + 100.0, TORQUE), []),
        ("time_s,angle_rad,second_rad", (TIME * _HALF, ANGLE, ANGLE * _HALF[::-1]), ["--second-angle", "second_rad"]),
        ("time_s,angle_rad,sley_m", (TIME * _HALF, ANGLE, TORQUE * _HALF[::-1]), ["--quantity", "sley_m=sley_m"]),
    ],
)
def test_columns_without_common_rows_are_one_line_with_options_that_exist(
    tmp_path: Path, names: str, columns: tuple[np.ndarray, ...], options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text(*columns, head=names + "\n"))
    assert main(["import", str(path), "--out", str(tmp_path / "bag"), *options]) == 2
    (line,) = [each for each in capsys.readouterr().err.splitlines() if each.strip()]
    assert line.startswith("textile-twin: ") and "fault" not in line
    known = {option for action in parser()._actions for option in action.option_strings}
    advised = set(re.findall(r"--[a-z-]+", line))
    assert advised <= known, line
