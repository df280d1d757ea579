"""Encodings of logs, and files that are no text."""

from __future__ import annotations

import gzip
import math
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter, open_bag

N = 2000
TIME = np.arange(N) * 0.002
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
HEAD = "Zeit [s];Winkel [°];Moment [Nm];Zustand"
ROWS = [
    f"{t:.3f};{math.degrees(a):.7f};{'gestört' if k == 5 else k % 7};läuft".replace(".", ",")
    for k, (t, a) in enumerate(zip(TIME, ANGLE, strict=True))
]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252"])
def test_encodings(encoding: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.csv").write_bytes("\r\n".join([HEAD, *ROWS, ""]).encode(encoding))
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    assert "line 7: column 'Moment [Nm]' has 'gestört', no number; it counts as empty" in capsys.readouterr().out
    np.testing.assert_allclose(open_bag(tmp_path / "bag").read_angles().angles_rad, ANGLE, atol=2e-8)
    assert open_bag(tmp_path / "bag").read_torques().torque_Nm.size == N - 1


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
@pytest.mark.parametrize("place", [2, 3])
def test_a_word_far_below_that_is_no_utf_8(
    place: int, encoding: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{0.002 * k:.3f},{(2.0 * k) % 360:.6f},{k % 7}.123456789,ok".split(",") for k in range(8000)]
    rows[7900][place] = "gestört"
    lines = ["time [s],angle [deg],torque [Nm],state", *map(",".join, rows)]
    (tmp_path / "log.csv").write_bytes("\n".join(lines).encode(encoding))
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    told = "line 7902: column 'torque [Nm]' has 'gestört', no number; it counts as empty" in capsys.readouterr().out
    assert told == (place == 2)
    assert open_bag(tmp_path / "bag").read_torques().torque_Nm.size == 8000 - told


def _workbook(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as out:
        out.writestr("xl/workbook.xml", "<workbook/>")


def _recording(path: Path) -> None:
    with BagWriter(path) as out:
        out.write_wrenches("balancing_torque/measured", np.arange(1, 9), np.ones(8))


@pytest.mark.parametrize(
    ("name", "make", "says"),
    [
        ("log.xlsx", _workbook, "as Excel's workbooks are (.xlsx); save its table as CSV"),
        ("log.csv", lambda path: path.write_bytes(gzip.compress(HEAD.encode())), "compressed by gzip; unpack it"),
        ("log.tdms", lambda path: path.write_bytes(b"TDSm" + bytes(99)), "log.tdms: cannot be read, it may be damaged"),
        ("log.dat", lambda path: path.write_bytes(b"TDSm" + bytes(99)), "a TDMS file of LabVIEW; let its name end"),
        ("log.bin", lambda path: path.write_bytes(np.arange(999.0).tobytes()), "is no text (it has zero bytes)"),
        ("log.txt", lambda path: savemat(path, {"t": TIME}, appendmat=False), "let its name end in .mat"),
        ("log.mcap", _recording, "a recording already; give it to compare"),
        ("log", _recording, "is a recording already; give the file that the logger wrote"),
        ("logs", lambda path: path.mkdir(), "is a folder; give the file"),
    ],
)
def test_a_file_that_is_no_text_is_named_in_a_line(
    name: str, make: Callable[[Path], object], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path / name)
    assert main(["import", str(tmp_path / name), "--out", str(tmp_path / "bag")]) == 2
    told = capsys.readouterr().err
    assert says in told and told.count("\n") == 1
