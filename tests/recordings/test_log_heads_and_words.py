"""Names of columns, units and words at any place of a log."""

from __future__ import annotations

import math
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag

N = 2000
TIME = np.arange(N) * 0.002
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0
ROWS = [f"{t:.3f},{math.degrees(a):.7f},{m:.7f}" for t, a, m in zip(TIME, ANGLE, TORQUE, strict=True)]


def bag_of(tmp_path: Path, lines: list[str], separator: str = ",") -> Path:
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines).replace(",", separator) + "\n", encoding="utf-8")
    assert main(["import", str(log), "--out", str(tmp_path / "bag")]) == 0
    return tmp_path / "bag"


def check(bag: Path, torque_from: int = 0) -> None:
    """Check that the recording equals the log, except for its first `torque_from` torques."""
    angles, torques = open_bag(bag).read_angles(), open_bag(bag).read_torques()
    np.testing.assert_allclose(angles.angles_rad, ANGLE, atol=2e-8)
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, TIME, atol=2e-6)
    np.testing.assert_allclose(torques.torque_Nm, TORQUE[torque_from:], atol=2e-7)


@pytest.mark.parametrize("word", ["#N/A", "n/a", "overflow"])
@pytest.mark.parametrize("rows", [1, 3, 300])
def test_words_in_the_first_rows_are_neither_names_nor_units(
    rows: int, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begin = [f"{row.rpartition(',')[0]},{word}" for row in ROWS[:rows]]
    check(bag_of(tmp_path, ["time [s],angle [deg],torque [Nm]", *begin, *ROWS[rows:]]), torque_from=rows)
    assert f"line 2: column 'torque [Nm]' has '{word}', no number" in capsys.readouterr().out


@pytest.mark.parametrize("empty", ["", '""'])
def test_a_first_row_that_ends_in_an_empty_cell_is_one(empty: str, tmp_path: Path) -> None:
    begin = [f"{row.rpartition(',')[0]},{empty}" for row in ROWS[:2]]
    check(bag_of(tmp_path, ["time [s],angle [deg],torque [Nm]", *begin, *ROWS[2:]]), torque_from=2)


def test_short_names_below_a_line_as_wide_are_no_units(tmp_path: Path) -> None:
    check(bag_of(tmp_path, ["Start,2026-11-22,10:00:00", "t(s),w(deg),Md(Nm)", *ROWS]))


def test_a_line_of_keys_and_values_as_wide_as_the_table_is_no_row(tmp_path: Path) -> None:
    check(bag_of(tmp_path, ["Rate,500,,", "state,t [s],phi [deg],M [Nm]", *(f"ON,{row}" for row in ROWS)]))


@pytest.mark.parametrize("place", [0, 1, 3])
def test_a_column_of_words_is_left_out(place: int, tmp_path: Path) -> None:
    lines = ["time [s],angle [deg],torque [Nm]", *ROWS]
    words = ["state", *("ON" if k % 7 else "OFF" for k in range(N))]
    cells = [line.split(",") for line in lines]
    for row, word in zip(cells, words, strict=True):
        row.insert(place, word)
    check(bag_of(tmp_path, [",".join(row) for row in cells]))


@pytest.mark.parametrize("separator", [",", "\t", " "])
@pytest.mark.parametrize("mark", ["# ", "#", "% ", "// "])
def test_names_in_a_comment(mark: str, separator: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(bag_of(tmp_path, [f"{mark}logger 7", f"{mark}time_s,angle_deg,torque_Nm", *ROWS], separator))
    assert "column 'time_s', s\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    "head",
    [
        ["t [s],phi [deg],[Nm]"],
        ["t_s,phi_deg,M_Nm"],
        ["t,phi,M", "s,deg,Nm"],
        ["t,phi,M", "[s],[deg],[Nm]"],
        ["t,phi,M", "(s),(deg),(Nm)"],
        ["Time (s),Ch1 (deg),Ch2 (Nm)"],
        ["Range,0,360", "Time (s),Ch1 (deg),Ch2 (Nm)"],
    ],
)
def test_angle_and_torque_are_known_by_their_unit_alone(
    head: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    check(bag_of(tmp_path, [*head, *ROWS]))
    assert "taken for granted" not in capsys.readouterr().out


def test_decimal_commas_within_quotation_marks(tmp_path: Path) -> None:
    rows = [",".join(f'"{cell.replace(".", ",")}"' for cell in row.split(",")) for row in ROWS]
    check(bag_of(tmp_path, ['"Zeit [s]","Winkel [deg]","Drehmoment [Nm]"', *rows]))


@pytest.mark.parametrize(
    ("unit", "newton_metres"),
    [("in-lbs", 0.112984829), ("lb-ft", 1.355817948), ("ft·lbf", 1.355817948), ("oz-in", 0.00706155183), ("N·m", 1.0)],
)
def test_units_as_they_are_written_in_other_countries(unit: str, newton_metres: float, tmp_path: Path) -> None:
    bag = bag_of(tmp_path, [f"Time (sec),Angle (Deg),Torque ({unit})", *ROWS])
    np.testing.assert_allclose(open_bag(bag).read_torques().torque_Nm, newton_metres * TORQUE, rtol=1e-6, atol=1e-7)


def test_a_unit_of_another_quantity_is_dropped(tmp_path: Path) -> None:
    rows = [f"{row},22.5,80" for row in ROWS]
    check(bag_of(tmp_path, ["time [s],phi [°],torque [Nm],T [°C],torque [%]", *rows]))


def test_a_torque_in_per_cent_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.csv").write_text("\n".join(["t [s],phi [deg],torque [%]", *ROWS]) + "\n", encoding="utf-8")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 2
    assert "torque in '%'? there are: N m," in capsys.readouterr().err


def test_two_columns_in_newton_metres_are_asked_about(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [f"{row},{k}" for k, row in enumerate(ROWS)]
    (tmp_path / "log.csv").write_text("\n".join(["t [s],phi [deg],a [Nm],b [Nm]", *lines]) + "\n", encoding="utf-8")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 2
    assert "which column is the torque? tell it with --torque" in capsys.readouterr().err


def test_columns_parted_by_spaces_may_hold_words_dates_and_comments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"2026-11-22   10:00:0{row.replace(',', '  ')}" for row in ROWS]
    rows[7] = rows[7].rpartition("  ")[0] + "  fault"
    (tmp_path / "log.txt").write_text("\n".join(["# date time angle_deg torque_Nm", *rows, "# end"]), encoding="utf-8")
    assert main(["import", str(tmp_path / "log.txt"), "--out", str(tmp_path / "bag")]) == 0
    said = capsys.readouterr().out
    assert "line 9: column 'torque_Nm' has 'fault', no number; it counts as empty" in said
    assert "1 of 2001 rows have other than 4 cells and are left out" in said
    angles, torques = open_bag(tmp_path / "bag").read_angles(), open_bag(tmp_path / "bag").read_torques()
    np.testing.assert_allclose(angles.angles_rad, ANGLE, atol=2e-8)
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, TIME, atol=2e-6)
    np.testing.assert_allclose(torques.torque_Nm, np.delete(TORQUE, 7), atol=2e-7)


@pytest.mark.parametrize(("form", "pause_s"), [("%Y-%m-%d %H:%M:%S.%f", 60), ("%Y/%m/%d %H:%M:%S.%f", 0)])
def test_a_column_of_dates_is_the_time_whatever_it_is_called(form: str, pause_s: int, tmp_path: Path) -> None:
    begin = datetime(2026, 11, 22, 23, 59, 58)
    since = [t + pause_s * (k > N // 2) for k, t in enumerate(TIME.tolist())]
    dates = [(begin + timedelta(seconds=each)).strftime(form) for each in since]
    lines = [f"{date},{k},{row.partition(',')[2]}" for k, (date, row) in enumerate(zip(dates, ROWS, strict=True))]
    angles = open_bag(bag_of(tmp_path, ["logged,count,angle [deg],torque [Nm]", *lines])).read_angles()
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, since, atol=2e-6)
    assert angles.stamps[0] == 1_795_391_998_000_000_000


def test_an_angle_that_rises_evenly_is_no_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [f"{16.0 * t:.6f},{m:.6f}" for t, m in zip(TIME, TORQUE, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["theta,torque", *lines]) + "\n", encoding="utf-8")
    options = ["--angle", "theta", "--angle-unit", "rad", "--out", str(tmp_path / "bag")]
    assert main(["import", str(tmp_path / "log.csv"), *options]) == 2
    assert "no column of times; give --time or --rate" in capsys.readouterr().err


def test_a_candidate_for_times_is_named_if_there_are_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [f"{row.partition(',')[2]},2.1.2026 10:00:00" for row in ROWS]
    (tmp_path / "log.csv").write_text("\n".join(["angle [deg],torque [Nm],Datum", *lines]) + "\n", encoding="utf-8")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 2
    assert "'Datum' holds text (line 2: '2.1.2026 10:00:00')" in capsys.readouterr().err
