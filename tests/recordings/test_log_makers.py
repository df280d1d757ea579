"""Logs of controllers and measuring programs, and names of columns in mills of many countries."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.log_columns import choose, unit_in_name

N = 2000
TIME = np.arange(N) * 0.002
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0


def rows(*columns: np.ndarray, separator: str = "\t", decimal: str = ".", end: str = "") -> str:
    lines = [
        separator.join(f"{value:.9g}".replace(".", decimal) for value in row) for row in zip(*columns, strict=True)
    ]
    return "".join(f"{line}{end}\r\n" for line in lines)


def imported(tmp_path: Path, text: str, *options: str, encoding: str = "utf-8") -> Path:
    log = tmp_path / "log.txt"
    log.write_text(text, encoding=encoding, newline="")
    assert main(["import", str(log), "--out", str(tmp_path / "bag"), *options]) == 0
    return tmp_path / "bag"


def check(bag: Path) -> None:
    angles, torques = open_bag(bag).read_angles(), open_bag(bag).read_torques()
    np.testing.assert_allclose(angles.angles_rad, ANGLE, atol=2e-8)
    np.testing.assert_allclose(torques.torque_Nm, TORQUE, atol=2e-7)
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, TIME, atol=2e-6)


def scope(times: list[np.ndarray], decimal: str = ",", separator: str = "\t", end: str = "") -> str:
    """Export of TwinCAT Scope: the angle beside the first times, the torque beside the last."""
    blocks = [("Name", "SymbolComment", "Data-Type", "SampleTime[ms]", "VariableSize", "SymbolBased", "Unit", "Offset")]
    angle = ("Winkel Hauptwelle", "", "REAL64", "2", "8", "True", "deg (Angle)", "0")
    torque = ("fMotorTorque", "", "REAL32", "2", "4", "True", "(None)", "0")
    cells = [*blocks, angle, *(blocks if len(times) > 1 else []), torque]
    columns = [times[0], np.degrees(ANGLE), *times[1:], TORQUE]
    head = ["Name\tscope", "File\tC:\\scope.csv", "Starttime of export\t132959733843760000\tMontag, 2. Mai 2022", ""]
    head += [separator.join(line) for line in zip(*cells, strict=True)]
    head = [line.replace("\t", separator) for line in head]
    return "\r\n".join([*head, "", ""]) + rows(*columns, separator=separator, decimal=decimal) + end


@pytest.mark.parametrize(
    ("times", "decimal", "separator", "end"),
    [
        ([TIME * 1e3], ",", "\t", ""),
        ([TIME * 1e3], ".", "\t", "EOF\r\n"),
        ([TIME * 1e3, TIME * 1e3], ",", ";", ""),
        ([TIME * 1e3], ".", ",", ""),
    ],
)
def test_twincat_scope(times: list[np.ndarray], decimal: str, separator: str, end: str, tmp_path: Path) -> None:
    check(imported(tmp_path, scope(times, decimal, separator, end)))


@pytest.mark.parametrize("separator", ["\t", ","])
@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("kept", [("Starttime", "Name"), ("Starttime", "Name", "Unit"), ("Name",)])
def test_twincat_scope_with_few_lines_in_its_head(
    kept: tuple[str, ...], times: int, separator: str, tmp_path: Path
) -> None:
    if kept == ("Name",) and times == 1:
        return  # it looks like the log of another maker
    head, _, body = scope([TIME * 1e3] * times, ".", separator).partition("\r\n\r\n")
    channels, _, body = body.partition("\r\n\r\n")
    lines = [line for line in (*head.splitlines()[2:], *channels.splitlines()) if line.startswith(kept)]
    text = "\r\n".join([*lines, body])
    check(imported(tmp_path, text, *([] if "Unit" in kept else ["--angle-unit", "deg"])))


def test_full_time_stamps_of_twincat_scope(tmp_path: Path) -> None:
    ticks = [str(132_959_733_843_760_000 + 20_000 * k) for k in range(N)]
    text = scope([TIME * 1e3], ".")
    head, _, body = text.partition("\r\n\r\n0\t")
    lines = [line.partition("\t")[2] for line in ("0\t" + body).splitlines()]
    bag = imported(
        tmp_path, head + "\r\n\r\n" + "".join(f"{t}\t{row}\r\n" for t, row in zip(ticks, lines, strict=True))
    )
    check(bag)
    assert open_bag(bag).read_angles().stamps[0] == pytest.approx(1_651_499_784_376_000_000, abs=10_000)


def test_time_lines_that_differ_are_each_those_of_their_channels(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(scope([TIME * 1e3, TIME * 1e3 + 0.4]), newline="")
    command = ["import", str(log), "--out", str(tmp_path / "bag")]
    assert main(command) == 0
    assert "column 'fMotorTorque', N m (taken for granted); at column 'Time [ms]_2', ms" in capsys.readouterr().out
    check(tmp_path / "bag")
    angles, torques = open_bag(tmp_path / "bag").read_angles(), open_bag(tmp_path / "bag").read_torques()
    np.testing.assert_allclose((torques.stamps - angles.stamps) * 1e-9, 0.4e-3, atol=1e-9)
    assert main([*command, "--rate", "500", "--force"]) == 2
    assert "columns have times of their own" in capsys.readouterr().err


LVM = (
    "LabVIEW Measurement\t\r\nWriter_Version\t2\r\nReader_Version\t2\r\nSeparator\tTab\r\n"
    "Decimal_Separator\t{point}\r\n"
    "Multi_Headings\tNo\r\nX_Columns\t{columns}\r\nTime_Pref\tRelative\r\nOperator\tmill\r\nDate\t2026/07/22\r\n"
    "Time\t17:18:18{point}938945770263671875\r\n***End_of_Header***\t\r\n\t\r\nChannels\t2\t\t\r\n"
    "Samples\t2000\t2000\t\r\nDate\t2026/07/22\t2026/07/22\t\r\nTime\t17:18:18{point}9\t17:18:18{point}9\t\r\n"
    "X_Dimension\tTime\tTime\t\r\nX0\t0{point}0E+0\t0{point}0E+0\t\r\nDelta_X\t0{point}002000\t0{point}002000\t\r\n"
    "***End_of_Header***\t\t\t\r\n"
)


@pytest.mark.parametrize("point", [".", ","])
@pytest.mark.parametrize("columns", ["One", "Multi", "No"])
def test_labview(columns: str, point: str, tmp_path: Path) -> None:
    names = {"One": "X_Value\tAngle (rad)\tTorque", "Multi": "X_Value\tAngle (rad)\tX_Value\tTorque"}
    values = {"One": (TIME, ANGLE, TORQUE), "Multi": (TIME, ANGLE, TIME, TORQUE), "No": (ANGLE, TORQUE)}
    body = rows(*values[columns], decimal=point)
    if columns == "No":
        body = "".join(f"\t{line}\r\n" for line in body.splitlines())
    head = LVM.format(point=point, columns=columns) + names.get(columns, names["One"]) + "\tComment\r\n"
    check(imported(tmp_path, head + body))


def test_labview_with_commas_between_cells(tmp_path: Path) -> None:
    head = LVM.replace("Tab", "Comma").format(point=".", columns="No").replace("\t", ",")
    head += "X_Value,Angle (rad),Torque,Comment\r\n"
    body = "".join(f",{line}\r\n" for line in rows(ANGLE, TORQUE, separator=",").splitlines())
    check(imported(tmp_path, head + body))


def test_short_segments_of_labview_are_all_read(tmp_path: Path) -> None:
    head = LVM.format(point=".", columns="One").replace("Multi_Headings\tNo", "Multi_Headings\tYes")
    names = "X_Value\tAngle (rad)\tTorque\tComment\r\n"
    again = "\r\n" + head[head.index("Channels") :] + names
    cuts = [0, 3, 8, N]
    parts = [rows(TIME[a:b], ANGLE[a:b], TORQUE[a:b]) for a, b in itertools.pairwise(cuts)]
    check(imported(tmp_path, head + names + again.join(parts)))


def test_labview_without_an_interval_is_reported_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head = LVM.format(point=".", columns="No").replace("Delta_X", "Other") + "X_Value\tAngle (rad)\tTorque\r\n"
    text = head + "".join(f"\t{line}\r\n" for line in rows(ANGLE, TORQUE).splitlines())
    (tmp_path / "log.lvm").write_text(text, newline="")
    assert main(["import", str(tmp_path / "log.lvm"), "--out", str(tmp_path / "bag")]) == 2
    told = capsys.readouterr().err
    assert "no Delta_X" in told and "--rate" in told and told.count("\n") == 1
    check(imported(tmp_path, text, "--rate", "500"))


def test_times_with_an_exponent_are_rows_of_twincat_scope(tmp_path: Path) -> None:
    head, _, body = scope([TIME * 1e3], ".").rpartition("\r\n\r\n")
    lines = [f"{2.0 * k:.6E}{line[line.index(chr(9)) :]}" for k, line in enumerate(body.splitlines())]
    check(imported(tmp_path, head + "\r\n\r\n" + "\r\n".join(lines)))


def test_a_panels_log_is_refused_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.csv"
    log.write_text('"VarName";"TimeString";"VarValue";"Validity";"Time_ms"\n"Md";"01.04.26 11:02:52";66,00;1;3588,81\n')
    assert main(["import", str(log), "--out", str(tmp_path / "bag")]) == 2
    assert "a row for each value" in capsys.readouterr().err


HEADS = {
    "german": ("Zeitstempel [ms]", "Drehwinkel [°]", "Antriebsmoment [Nm]", "Drehzahl [U/min]"),
    "turkish": ("Zaman [sn]", "Mil açısı [derece]", "Motor torku [Nm]", "Devir [d/dk]"),
    "turkish, capitals": ("ZAMAN [sn]", "AÇI [derece]", "TORK [Nm]", "HIZ [d/dk]"),
    "italian": ("Tempo [s]", "Posizione albero [gradi]", "Coppia [Nm]", "Velocità [giri/min]"),
    "portuguese": ("Tempo [s]", "Ângulo [graus]", "Momento [Nm]", "Rotação [rpm]"),
    "spanish": ("Tiempo (s)", "Ángulo (grados)", "Par motor (N·m)", "Velocidad (rpm)"),
    "french": ("Temps [s]", "Angle [degrés]", "Couple [N.m]", "Vitesse [tr/min]"),
    "chinese": ("时间（秒）", "主轴角度（度）", "扭矩（N·m）", "转速（转/分）"),
    "traditional chinese": ("時間【ms】", "轉角【度】", "轉矩【牛米】", "轉速【r/min】"),
    "controller": (
        '"DB_Axis".Timestamp [ms]',
        '"DB_Axis".lrActPos [deg]',
        '"DB_Axis".fTorque',
        '"DB_Axis".nSpeed [rpm]',
    ),
    "english": ("Relative time [ms]", "Spindle Position (deg)", "ActTorque_Nm", "Speed [1/min]"),
}


@pytest.mark.parametrize("name", HEADS)
def test_columns_by_the_names_that_mills_use(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head = HEADS[name]
    time = TIME * (1e3 if "ms" in head[0] else 1.0)
    speed, force = np.full(N, 16.0 * 30.0 / math.pi), np.full(N, 3.0)
    text = ";".join((*head, "Kraft [N]", "Position [mm]")) + "\r\n"
    check(imported(tmp_path, text + rows(time, np.degrees(ANGLE), TORQUE, speed, force, force, separator=";")))
    assert open_bag(tmp_path / "bag").read_angles().velocities is not None, capsys.readouterr().out


@pytest.mark.parametrize(("name", "encoding"), [("chinese", "gbk"), ("turkish", "cp1254"), ("german", "cp1252")])
def test_code_pages_of_old_computers(name: str, encoding: str, tmp_path: Path) -> None:
    head = [cell.replace("·", ".") for cell in HEADS[name]]
    time = TIME * (1e3 if "ms" in head[0] else 1.0)
    speed = np.full(N, 16.0 * 30.0 / math.pi)
    text = ";".join(head) + "\r\n" + rows(time, np.degrees(ANGLE), TORQUE, speed, separator=";")
    check(imported(tmp_path, text, encoding=encoding))


def test_a_name_is_not_taken_for_what_it_is_not() -> None:
    names = [
        "Force [N]",
        "slider_N",
        "coupler",
        "Momentanwert",
        "Capacity",
        "Facility",
        "Position [mm]",
        "nMotor",
        "fast",
    ]
    assert {kind: choose(kind, names) for kind in ("time", "angle", "torque", "speed")} == {
        "time": [], "angle": [], "torque": [], "speed": [],
    }  # fmt: skip
    assert unit_in_name("角度（°）") == "deg" and unit_in_name("Winkelgeschwindigkeit [rad/s]") == "rad/s"
    assert choose("angle", ["Winkelgeschwindigkeit [rad/s]"]) == []


@pytest.mark.parametrize("ends", [("m", "m"), ("in", "in"), ("s", "m")])
def test_a_given_unit_precedes_the_end_of_a_name_that_looks_like_one(ends: tuple[str, str], tmp_path: Path) -> None:
    head = f"time_s,theta_{ends[0]},torque_{ends[1]}\r\n"
    text = head + rows(TIME, ANGLE, TORQUE, separator=",")
    check(imported(tmp_path, text, "--angle-unit", "rad", "--torque-unit", "N m"))


@pytest.mark.parametrize(("name", "unit"), [("torque_in", "in"), ("Torque [N]", "N")])
def test_a_torque_in_a_unit_of_something_else_is_refused_not_left_out(
    name: str, unit: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = f"time_s,angle_rad,{name}\r\n" + rows(TIME, ANGLE, TORQUE, separator=",")
    (tmp_path / "log.csv").write_text(text, newline="")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 2
    assert f"torque in '{unit}'? there are: " in capsys.readouterr().err
    check(imported(tmp_path, text, "--torque-scale", "1"))


def test_an_ambiguity_lists_the_columns_and_the_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t;kanal 1;kanal 2\r\n" + rows(TIME, np.degrees(ANGLE), TORQUE, separator=";"), newline="")
    assert main(["import", str(log), "--out", str(tmp_path / "bag")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "--angle" in told and "kanal 1 (" in told and "kanal 2 (" in told
