"""Tables of motion: numbers are preserved bit for bit, common formats are read, errors name the cell."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from textile_twin_core.errors import MotionError, OutputError
from textile_twin_core.files import read_motion_table, write_table

MOTION = ("theta_rad", "omega_rad_s", "alpha_rad_s2")


def _random_doubles(count: int) -> dict[str, np.ndarray]:
    """Return doubles of every size from random bits, with subnormal ones and both zeros."""
    bits = np.random.default_rng(8).integers(0, 2**64, (3, count), dtype=np.uint64)
    values = bits.view(np.float64)
    values[~np.isfinite(values)] = 0.1
    values[:, :4] = 5e-324, -0.0, 0.0, 1.7976931348623157e308
    return dict(zip(MOTION, values, strict=True))


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_every_double_survives(tmp_path: Path, suffix: str) -> None:
    columns = _random_doubles(20_000)
    write_table(tmp_path / f"m.{suffix}", columns)
    table = read_motion_table(tmp_path / f"m.{suffix}")
    for name in MOTION:
        np.testing.assert_array_equal(getattr(table, name).view(np.uint64), columns[name].view(np.uint64))
    assert table.time_s is None


def test_other_programs_read_the_same_doubles(tmp_path: Path) -> None:
    """Apply Python's float(), which rounds correctly, to every cell."""
    columns = _random_doubles(2_000)
    write_table(tmp_path / "m.csv", columns)
    with (tmp_path / "m.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in MOTION:
        np.testing.assert_array_equal([float(row[name]) for row in rows], columns[name])


@pytest.mark.parametrize(
    "text",
    [
        "theta_rad,omega_rad_s,alpha_rad_s2\n1,2,3\n4,5,6\n",
        "theta_rad,omega_rad_s,alpha_rad_s2\r\n1,2,3\r\n4,5,6",
        "\ufefftheta_rad, omega_rad_s ,alpha_rad_s2\n1, 2,3\n4,5,6\n\n",
        '"alpha_rad_s2","theta_rad","comment","omega_rad_s"\n3,1,"a, b",2\n6e0,4.,c,+5\n',
    ],
)
def test_forms_that_people_write(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.csv").write_text(text, encoding="utf-8", newline="")
    table = read_motion_table(tmp_path / "m.csv")
    np.testing.assert_array_equal(np.stack(list(table.columns().values()), axis=1), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"theta_rad": [1.0, 2.0], "omega_rad_s": [1.0, 2.0]}, "column alpha_rad_s2 is missing"),
        ({name: [1.0, None] for name in MOTION}, "row 2: theta_rad is nan"),
        ({name: ["fast", "slow"] for name in MOTION}, "not a Parquet table of numbers"),
        (dict.fromkeys(MOTION, pa.array([], pa.float64())), "no rows"),
    ],
)
def test_bad_parquet(tmp_path: Path, columns: dict[str, object], says: str) -> None:
    pyarrow.parquet.write_table(pa.table(columns), tmp_path / "m.parquet")
    with pytest.raises(MotionError, match=says) as caught:
        read_motion_table(tmp_path / "m.parquet")
    assert "\n" not in str(caught.value)


def test_a_column_given_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("theta_rad,omega_rad_s,theta_rad,alpha_rad_s2\n1,2,3,4\n")
    with pytest.raises(MotionError, match="there are 2 columns theta_rad; leave one"):
        read_motion_table(tmp_path / "m.csv")


@pytest.mark.parametrize("suffix", ["csv", "parquet", "xlsx"])
def test_what_is_no_table(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"m.{suffix}"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(MotionError) as caught:
        read_motion_table(path)
    assert "\n" not in str(caught.value)


def test_only_tables_are_written(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"must end in .csv or .parquet"):
        write_table(tmp_path / "m.xlsx", {})
