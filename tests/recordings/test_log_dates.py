"""Dates and times of day of a log: read if unambiguous, otherwise reported."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag

N, STEP_S = 3000, 0.002
TIME = np.arange(N) * STEP_S
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
BEGIN = datetime(2026, 11, 22, 11, 59, 57)
"""Three seconds before noon: hours of twelve turn from AM to PM in the log."""


def moment(k: int) -> datetime:
    return BEGIN + timedelta(seconds=k * STEP_S)


def milliseconds(at: datetime) -> str:
    return f"{at.microsecond // 1000:03d}"


def noon(at: datetime) -> str:
    return f"{at:%I:%M:%S}.{milliseconds(at)} {at:%p}"


def import_rows(tmp_path: Path, head: str, rows: list[str]) -> int:
    log = tmp_path / "log.csv"
    log.write_text("\n".join([head, *rows]) + "\n")
    return main(["import", str(log), "--out", str(tmp_path / "bag")])


def rows_of(*cells: Callable[[int], str]) -> list[str]:
    return [";".join([*(cell(k) for cell in cells), f"{ANGLE[k]:.9f}"]) for k in range(N)]


@pytest.mark.parametrize(
    "written",
    [
        lambda at: f"{at:%m/%d/%Y %H:%M:%S}.{milliseconds(at)}",
        lambda at: f"{at:%d/%m/%Y %H:%M:%S},{milliseconds(at)}",
        lambda at: f"{at.month}/{at.day}/{at.year}, {noon(at)}",
        lambda at: f"{at:%d-%m-%Y} {noon(at).lower()}",
        lambda at: f"{at:%Y-%m-%d} {noon(at).replace('M', '.M.')}",
        lambda at: f"{at:%Y-%m-%d %H:%M:%S}:{milliseconds(at)}",
        lambda at: f"{at:%m/%d/%YT%H:%M:%S}:{milliseconds(at)}",
    ],
)
def test_unambiguous_dates_are_read(written: Callable[[datetime], str], tmp_path: Path) -> None:
    assert import_rows(tmp_path, "Timestamp;angle [rad]", rows_of(lambda k: written(moment(k)))) == 0
    stamps = open_bag(tmp_path / "bag").read_angles().stamps
    assert abs(int(stamps[0]) - int(np.datetime64(BEGIN, "ns").astype(np.int64))) < 1000
    np.testing.assert_allclose((stamps - stamps[0]) * 1e-9, TIME, atol=1e-6)


@pytest.mark.parametrize("written", [noon, lambda at: f"{at:%H:%M:%S}:{milliseconds(at)}"])
def test_times_of_day_in_twelve_hours_or_with_a_third_colon(written: Callable[[datetime], str], tmp_path: Path) -> None:
    rows = rows_of(lambda k: f"{moment(k):%m/%d/%Y}", lambda k: written(moment(k)))
    assert import_rows(tmp_path, "Date;Time;angle [rad]", rows) == 0
    stamps = open_bag(tmp_path / "bag").read_angles().stamps
    assert abs(int(stamps[0]) - int(np.datetime64(BEGIN, "ns").astype(np.int64))) < 1000
    np.testing.assert_allclose((stamps - stamps[0]) * 1e-9, TIME, atol=1e-6)


@pytest.mark.parametrize("date", ["03/04/2026", "3-4-2026"])
def test_ambiguous_dates_are_reported(date: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = rows_of(lambda k: f"{date} {moment(k):%H:%M:%S}.{milliseconds(moment(k))}")
    assert import_rows(tmp_path, "Timestamp;angle [rad]", rows) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and date in said and "day or the month" in said and "2026-10-25 23:59:50.5" in said
    assert not (tmp_path / "bag").exists()


def test_a_date_whose_day_is_its_month_has_one_meaning(tmp_path: Path) -> None:
    rows = rows_of(lambda k: f"11/11/2026 {moment(k):%H:%M:%S}.{milliseconds(moment(k))}")
    assert import_rows(tmp_path, "Timestamp;angle [rad]", rows) == 0
    first = np.datetime64(int(open_bag(tmp_path / "bag").read_angles().stamps[0]), "ns")
    assert abs(first - np.datetime64("2026-11-11T11:59:57")) < np.timedelta64(1000, "ns")


@pytest.mark.parametrize("when", ["11:59:50:12", "22/11/26 23:59:50", "25/25/2026 10:00:00"])
def test_other_dates_are_refused(when: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert import_rows(tmp_path, "Timestamp;angle [rad]", rows_of(lambda _: when)) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and when in said and "2026-10-25 23:59:50.5" in said


def test_thirteen_o_clock_in_twelve_hours_is_no_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert import_rows(tmp_path, "Timestamp;angle [rad]", rows_of(lambda _: "13:05:00 PM")) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "13:05:00 PM" in said


@pytest.mark.parametrize("whole", [True, False])
def test_a_date_beside_a_timer_that_goes_on_alike(
    whole: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Dates in whole seconds are dropped for the timer; dates as fine as the timer give the day as well."""
    rows = rows_of(
        lambda k: f"{moment(k):%Y-%m-%d %H:%M:%S}" + ("" if whole else f".{milliseconds(moment(k))}"),
        lambda k: f"{7.0 + TIME[k]:.3f}",
    )
    assert import_rows(tmp_path, "Timestamp;time [s];angle [rad]", rows) == 0
    told = capsys.readouterr().out
    assert ("column 'Timestamp' goes on as 'time [s]'" in told) == whole
    assert ("column 'time [s]' goes on as 'Timestamp'" in told) == (not whole)
    stamps = open_bag(tmp_path / "bag").read_angles().stamps
    np.testing.assert_allclose((stamps - stamps[0]) * 1e-9, TIME, atol=1e-6)


def test_a_date_beside_a_timer_that_goes_on_otherwise_is_asked_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = rows_of(lambda k: f"{moment(k):%Y-%m-%d %H:%M:%S}", lambda k: f"{3.0 * TIME[k]:.3f}")
    assert import_rows(tmp_path, "Timestamp;time [s];angle [rad]", rows) == 2
    assert "which column is the time? tell it with --time" in capsys.readouterr().err
