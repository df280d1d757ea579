"""Missing units, and cells that are no numbers: resolved from the values and reported, or refused in one line."""

from __future__ import annotations

import decimal
import math
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag

N = 4000
STEP_S = 0.002
TIME = np.arange(N) * STEP_S
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0


def write(path: Path, times: list[str], head: str = "time,angle_rad,torque_Nm", encoding: str = "utf-8") -> list[str]:
    rows = [f"{t},{a:.9f},{m:.9f}" for t, a, m in zip(times, ANGLE, TORQUE, strict=False)]
    path.write_text("\n".join([head, *rows]) + "\n", encoding=encoding)
    return [head, *rows]


def since_first_s(bag: Path) -> np.ndarray:
    stamps = open_bag(bag).read_angles().stamps
    return np.asarray((stamps - stamps[0]) * 1e-9)


@pytest.mark.parametrize(
    ("times", "says"),
    [
        ([f"{2 * k}" for k in range(N)], "ms (taken for granted"),
        ([f"{2000 * k}" for k in range(N)], "us (taken for granted"),
        ([f"{2_000_000 * k}" for k in range(N)], "ns (taken for granted"),
        ([f"{1_700_000_000_000 + 2 * k}" for k in range(N)], "ms since 1970 (taken for granted"),
        ([f"{46000.0 + k * STEP_S / 86400.0:.12f}" for k in range(N)], "Excel's days since 1900 (taken for granted"),
        ([f"{k * STEP_S:.3f}" for k in range(N)], "s (taken for granted"),
    ],
)
def test_the_unit_of_times_follows_from_the_interval(
    times: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "log.csv", times)
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    assert says in capsys.readouterr().out
    np.testing.assert_allclose(since_first_s(tmp_path / "bag"), TIME, atol=2e-6)


def test_milliseconds_since_1970_that_rise_by_one_are_no_count_of_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "log.csv", [f"{1_700_000_000_000 + k}" for k in range(N)], "column,angle_rad,torque_Nm")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    assert "ms since 1970 (taken for granted" in capsys.readouterr().out
    np.testing.assert_allclose(since_first_s(tmp_path / "bag"), 1e-3 * np.arange(N), atol=2e-6)


@pytest.mark.parametrize(
    ("head", "times", "says"),
    [
        ("n,angle_rad,torque_Nm", [f"{k}" for k in range(N)], "--rate"),
        ("sample,angle_rad,torque_Nm", [f"{k}" for k in range(N)], "--rate"),
        ("row,angle_rad,torque_Nm", [f"{2 * k}" for k in range(N)], "--rate"),
        ("time,angle_rad,torque_Nm", [f"{k}" for k in range(N)], "--time-unit"),
        ("time,angle_rad,torque_Nm", [f"{2 * k}" for k in range(100)], "--time-unit"),
        ("time,angle_rad,torque_Nm", [f"{0.5 * k:.1f}" for k in range(N)], "--time-unit"),
        ("time,angle_rad,torque_Nm", [f"{100 * k}" for k in range(N)], "ms or us"),
        ("time,angle_rad,torque_Nm", ["7"] * N, "does not rise"),
    ],
)
def test_times_that_may_be_several_units_are_asked_about(
    head: str, times: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "log.csv", times, head)
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1
    assert not (tmp_path / "bag").exists()


def test_a_given_unit_is_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "log.csv", [f"{k}" for k in range(N)])
    told = ["--time", "time", "--time-unit", "ms"]
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag"), *told]) == 0
    np.testing.assert_allclose(since_first_s(tmp_path / "bag"), np.arange(N) * 1e-3, atol=1e-9)
    write(tmp_path / "log.csv", [f"{1_700_000_000_000 + k}" for k in range(N)])
    told[-1] = "s"
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "b"), *told]) == 2
    assert "is no time" in capsys.readouterr().err


def clock(k: int, comma: bool = False) -> str:
    at = 86390.0 + k * STEP_S
    text = f"{int(at // 3600) % 24:02d}:{int(at // 60) % 60:02d}:{at % 60:06.3f}"
    return text.replace(".", ",") if comma else text


def test_times_of_day_go_on_at_midnight(tmp_path: Path) -> None:
    more = [clock(k * 4) for k in range(N)]  # 32 s from 23:59:50 on
    write(tmp_path / "log.csv", more)
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    np.testing.assert_allclose(since_first_s(tmp_path / "bag"), TIME * 4.0, atol=1e-6)


def test_date_and_time_in_two_columns_are_one_time(tmp_path: Path) -> None:
    rows = [
        f"25.11.2026;{clock(k, comma=True)};{f'{a:.9f};{m:.9f}'.replace('.', ',')}"
        for k, (a, m) in enumerate(zip(ANGLE, TORQUE, strict=True))
    ]
    log = tmp_path / "log.csv"
    log.write_text("Datum;Uhrzeit;Winkel [rad];Moment [Nm]\n" + "\n".join(rows) + "\n")
    assert main(["import", str(log), "--out", str(tmp_path / "bag")]) == 0
    first = open_bag(tmp_path / "bag").read_angles().stamps[0]
    assert abs(int(first) - int(np.datetime64("2026-11-25T23:59:50", "ns").astype(np.int64))) < 1000
    np.testing.assert_allclose(since_first_s(tmp_path / "bag"), TIME, atol=1e-6)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("MNm", 1e6), ("MN m", 1e6), ("MN·m", 1e6), ("mNm", 1e-3), ("mN.m", 1e-3), ("NM", 1.0), ("KNM", 1e3)],
)
def test_milli_and_mega_are_distinguished(unit: str, factor: float, tmp_path: Path) -> None:
    write(tmp_path / "log.csv", [f"{t:.3f}" for t in TIME], f"time_s,angle_rad,torque [{unit}]")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    np.testing.assert_allclose(open_bag(tmp_path / "bag").read_torques().torque_Nm / factor, TORQUE, atol=1e-8)


@pytest.mark.parametrize(
    "head",
    ["time [Ms],angle [rad],torque [Nm]", "time [s],angle [rad],torque [MNM]", "time [s],angle [Mrad],torque [Nm]"],
)
def test_a_large_m_that_may_be_mega_is_refused(head: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "log.csv", [f"{t:.3f}" for t in TIME], head)
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "there are: " in said and not (tmp_path / "bag").exists()


@pytest.mark.parametrize(("unit", "taken"), [("MM", 1e-3), ("mm", 1e-3), ("Mm", None)])
def test_a_displacement_in_millimetres(
    unit: str, taken: float | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "log.csv", [f"{t:.3f}" for t in TIME], f"time_s,angle_rad,camera [{unit}]")
    told = ["--quantity", f"sley_position_m=camera [{unit}]"]
    code = main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag"), *told])
    assert code == (0 if taken else 2)
    if taken is None:
        assert "a quantity in 'Mm'? there are: m, mm" in capsys.readouterr().err


@pytest.mark.parametrize("begin", [1.0, -4.0])
def test_a_minus_sign_is_one(begin: float, tmp_path: Path) -> None:
    """U+2212, as office programs write it in some languages, from the first row on or far below."""
    rows = [f"{t:.3f};{a:.9f};{m + begin - 1.0:.9f}" for t, a, m in zip(TIME, ANGLE, TORQUE, strict=True)]
    text = "\n".join(["time_s;angle_rad;torque_Nm", *rows]).replace(";-", ";\u2212").replace(".", ",")
    (tmp_path / "log.csv").write_text(text + "\n", encoding="utf-8")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    np.testing.assert_allclose(open_bag(tmp_path / "bag").read_torques().torque_Nm, TORQUE + begin - 1.0, atol=1e-8)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_a_byte_order_mark_tells_the_encoding(encoding: str, tmp_path: Path) -> None:
    write(tmp_path / "log.csv", [f"{t:.3f}" for t in TIME], encoding=encoding)
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    np.testing.assert_allclose(open_bag(tmp_path / "bag").read_angles().angles_rad, ANGLE, atol=1e-8)


def test_cells_without_a_number_are_reported_with_their_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = write(tmp_path / "log.csv", [f"{t:.3f}" for t in TIME], "time_s,angle_rad,torque_Nm")
    rows[2500] = rows[2500].replace(rows[2500].split(",")[1], "#ERR")
    rows.insert(3001, rows[0])  # the header once more
    for k in range(1001, 1012):
        time, _, torque = rows[k].split(",")
        rows[k] = f"{time},nan,{torque}"
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    told = capsys.readouterr().out
    assert "line 2501: column 'angle_rad' has '#ERR'" in told
    assert "line 3002: the header once more, in 1 row" in told
    assert "12 rows without a number are not used, first row 1001" in told
    bag = open_bag(tmp_path / "bag")
    assert (len(bag.read_angles()), len(bag.read_torques())) == (N - 12, N)


def with_thousands(value: float, decimals: int, sign: str, decimal_sign: str) -> str:
    """Write a number with grouped digits."""
    return f"{value:,.{decimals}f}".replace(",", "x").replace(".", decimal_sign).replace("x", sign)


@pytest.mark.parametrize(
    ("separator", "sign", "decimal_sign"),
    [(";", ",", "."), (";", ".", ","), (",", ",", "."), ("\t", "'", "."), (";", " ", ","), (";", "\u202f", ",")],
)
def test_thousands_separators_are_read(separator: str, sign: str, decimal_sign: str, tmp_path: Path) -> None:
    torque = 1000.0 * TORQUE - 1500.0
    rows = [separator.join(("time_s", "angle_rad", "torque_Nm"))]
    for numbers in zip(TIME, ANGLE, torque, strict=True):
        cells = [with_thousands(x, places, sign, decimal_sign) for x, places in zip(numbers, (3, 9, 4), strict=True)]
        rows.append(separator.join(f'"{cell}"' if separator in cell else cell for cell in cells))
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    bag = open_bag(tmp_path / "bag")
    np.testing.assert_allclose(bag.read_angles().angles_rad, ANGLE, atol=1e-8)
    np.testing.assert_allclose(bag.read_torques().torque_Nm, torque, atol=1e-4)


@pytest.mark.parametrize("few", [True, False])
def test_signs_that_may_be_decimal_ones_are_not_read(
    few: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """'1,234' may be 1234 or 1.234, beside whole numbers or in a column of such cells."""
    torque = np.where(np.arange(N) % 3, 1000.0, 100.0) * TORQUE
    cells = [f"{m:,.0f}" if few else f"{1.0 + abs(m):.3f}".replace(".", ",") for m in torque]
    rows = [f"{t:.3f};{a:.9f};{cell}" for t, a, cell in zip(TIME, ANGLE, cells, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["time_s;angle_rad;torque_Nm", *rows]) + "\n")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == (0 if few else 2)
    told = capsys.readouterr()
    line, cell = next((k + 2, cell) for k, cell in enumerate(cells) if "," in cell)
    assert f"line {line}: '{cell}': its sign may be one of thousands" in told.out + told.err
    assert (tmp_path / "bag").exists() == few


def test_a_quoted_separator_does_not_split(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "log.csv", [f"{t:.3f}" for t in TIME], '"time, s","angle, shaft [rad]","torque, measured [Nm]"')
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    assert "column 'angle, shaft [rad]', rad" in capsys.readouterr().out


def test_parquet_of_decimals_and_of_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.parquet"
    for torque in ([decimal.Decimal(f"{m:.9f}") for m in TORQUE], [f"{m:.9f}" for m in TORQUE]):
        parquet.write_table(pyarrow.table({"time_s": TIME, "angle_rad": ANGLE, "torque_Nm": torque}), log)
        assert main(["import", str(log), "--out", str(tmp_path / "bag"), "--force"]) == 0
        np.testing.assert_allclose(open_bag(tmp_path / "bag").read_torques().torque_Nm, TORQUE, atol=1e-8)
    parquet.write_table(pyarrow.table({"time_s": TIME, "angle_rad": ANGLE, "torque_Nm": ["high"] * N}), log)
    capsys.readouterr()
    assert main(["import", str(log), "--out", str(tmp_path / "bag"), "--force"]) == 0
    assert "column 'torque_Nm' holds text ('high'), no numbers" in capsys.readouterr().out
    assert main(["import", str(log), "--out", str(tmp_path / "bag"), "--force", "--torque", "torque_Nm"]) == 2
    assert "holds text ('high')" in capsys.readouterr().err


def test_a_table_without_rows_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.parquet"
    parquet.write_table(pyarrow.table({"time": TIME[:0], "angle_rad": ANGLE[:0], "torque_Nm": TORQUE[:0]}), log)
    assert main(["import", str(log), "--out", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert "no rows" in said and said.count("\n") == 1 and not (tmp_path / "bag").exists()
