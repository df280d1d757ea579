"""MATLAB, HDF5, TDMS, MDF4 and Parquet files, each as its own library writes it; damaged ones, and other files."""

from __future__ import annotations

import decimal
import gzip
import math
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from pyarrow import parquet
from scipy.io import savemat

from tests.generators.logs import ANGLE, DEG, TIME, TORQUE, N, table
from textile_twin_core.cli.main import main
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.log_apply import apply
from textile_twin_core.recordings.log_files import read_table
from textile_twin_core.recordings.log_guess import guess
from textile_twin_core.recordings.log_mapping import Channel, LogMapping

BEGIN = datetime(2026, 11, 22, 10, 0, tzinfo=UTC)
MOMENT = np.datetime64("2026-11-22T10:00:00")
PLAIN = {"time": TIME, "angle_deg": DEG, "torque_Nm": TORQUE}
CHANNELS = np.array([(DEG, "angle [deg]"), (TORQUE, "torque [Nm]")], dtype=[("values", object), ("label", object)])
MATRIX = np.c_[DEG, TORQUE]
NAMED = LogMapping(angle=Channel("q_1", "deg"), torque=Channel("q_2"))


def mat(**content: Any) -> Callable[[Path], None]:
    return lambda path: savemat(path, content)


def tdms(*segments: list[tuple[str, np.ndarray, dict[str, Any]]]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with TdmsWriter(path) as out:
            for channels in segments:
                out.write_segment([ChannelObject("log", *each) for each in channels])

    return write


WAVE = {"wf_start_offset": 0.0, "wf_start_time": MOMENT}
LOG = (("Time", TIME, "s"), ("Winkel", DEG, "deg"), ("Drehmoment", TORQUE, "Nm"))


def mdf(path: Path) -> None:
    file = MDF(version="4.10")
    file.start_time = BEGIN
    file.append([Signal(DEG, TIME, name="ShaftAngle", unit="deg")])
    file.append([Signal(TORQUE[::2], TIME[::2], name="Torque", unit="Nm")])
    file.save(path, overwrite=True)
    file.close()


def hdf5(path: Path) -> None:
    """Data sets in groups, with units and times of their own."""
    with h5py.File(path, "w") as file:
        for name, values, unit, every in (("angle", DEG, "deg", 1), ("torque", TORQUE, "Nm", 2)):
            group = file.create_group(f"log/{name}")
            group.create_dataset("time", data=TIME[::every]).attrs["units"] = "s"
            group.create_dataset(name, data=values[::every]).attrs["units"] = unit


def hdf5_table(path: Path) -> None:
    """A table of several fields, as pandas and PyTables write one."""
    rows = np.zeros(N, [("time_s", "<f8"), ("angle_deg", "<f4"), ("torque_Nm", "<f8"), ("state", "S4")])
    rows["time_s"], rows["angle_deg"], rows["torque_Nm"] = TIME, DEG, TORQUE
    with h5py.File(path, "w") as file:
        file.create_dataset("log", data=rows)


def hdf5_matrix(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["q"], file["q"].attrs["note"] = TIME, MATRIX, "deg, Nm"


def matlab_73(path: Path) -> None:
    """A structure as MATLAB stores it with -v7.3: columns first, texts as numbers, fields of cells by reference."""
    with h5py.File(path, "w", userblock_size=512) as file:
        log = file.create_group("log")
        log.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in (("time", TIME), ("angle_deg", DEG), ("torque_Nm", TORQUE)):
            log.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        about = log.create_dataset("about", data=np.array([[ord(each)] for each in "loom 3"], np.uint16))
        about.attrs["MATLAB_class"] = np.bytes_("char")
        kept = file.create_group("#refs#").create_dataset("a", data=np.ones((1, 9)))
        cell = log.create_dataset("cells", (1, 1), dtype=h5py.ref_dtype)
        cell[0, 0] = kept.ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
    with path.open("r+b") as written:
        written.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def matlab_73_matrix(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("time", TIME[None, :]), ("q", MATRIX.T)):
            file.create_dataset(name, data=values).attrs["MATLAB_class"] = np.bytes_("double")


def columns_of(torque: list[Any] | np.ndarray) -> Callable[[Path], None]:
    return lambda path: parquet.write_table(
        pyarrow.table({"time_s": TIME, "shaft_angle_deg": DEG, "torque_Nm": torque}), path
    )


DATA = {"time": TIME, "data": DEG, "unit": "deg"}
HALF = {"time": TIME[::2], "data": TORQUE[::2], "unit": "Nm"}
Made = tuple[str, Callable[[Path], None], LogMapping, int]
FILES: dict[str, Made] = {
    "parquet": ("log.parquet", columns_of(TORQUE), LogMapping(), 1),
    "parquet, decimals": ("log.parquet", columns_of([decimal.Decimal(f"{m:.9f}") for m in TORQUE]), LogMapping(), 1),
    "parquet, text": ("log.parquet", columns_of([f"{m:.9f}" for m in TORQUE]), LogMapping(), 1),
    "matlab, vectors": ("log.mat", mat(**PLAIN, fs=500.0), LogMapping(), 1),
    "matlab, a matrix": ("log.mat", mat(data=np.c_[TIME, DEG, TORQUE]), LogMapping(
        angle=Channel("column_2", "deg"), torque=Channel("column_3")), 1),
    "matlab, structure": ("log.mat", mat(log=PLAIN), LogMapping(), 1),
    "matlab, inner structure": ("log.mat", mat(log={"about": "loom 3", "signals": PLAIN}), LogMapping(), 1),
    "matlab, scope": ("log.mat", mat(scope={"time": TIME, "signals": CHANNELS}), LogMapping(), 1),
    "matlab, scope of a matrix": ("log.mat", mat(scope={"time": TIME, "signals": {"values": MATRIX, "label": "q"}}),
                                  NAMED, 1),
    "matlab, structure of a matrix": ("log.mat", mat(log={"time": TIME, "q": MATRIX}), LogMapping(
        angle=Channel("q_1", "deg"), torque=Channel("q_2")), 1),
    "matlab, channels": ("log.mat", mat(angle=DATA, torque={**HALF}), LogMapping(), 2),
    "matlab, matrix beside a vector": ("log.mat", mat(time=TIME, q=MATRIX), NAMED, 1),
    "matlab, matrix across": ("log.mat", mat(time=TIME[None, :], q=MATRIX.T), NAMED, 1),
    "matlab, two matrices": ("log.mat", mat(time=TIME, angle=np.c_[DEG, DEG + 1.0], torque=np.c_[TORQUE, TORQUE]),
                             LogMapping(angle=Channel("angle_1", "deg"), torque=Channel("torque_2")), 1),
    "matlab 7.3": ("log.mat", matlab_73, LogMapping(), 1),
    "matlab 7.3, matrix": ("log.mat", matlab_73_matrix, NAMED, 1),
    "tdms, waveforms": ("log.tdms", tdms([
        ("angle", DEG, {**WAVE, "wf_increment": 0.002, "unit_string": "deg"}),
        ("torque", TORQUE[::2], {"wf_start_time": MOMENT, "wf_increment": 0.004, "unit_string": "Nm"})]),
        LogMapping(), 2),
    "tdms, a channel of times": ("log.tdms", tdms(*(
        [(name, values[part], {"NI_UnitDescription": unit}) for name, values, unit in LOG]
        for part in (slice(0, 300), slice(300, N)))), LogMapping(), 1),
    "tdms, time stamps": ("log.tdms", tdms([
        ("Time", MOMENT + (TIME * 1e6).astype("timedelta64[us]"), {}), ("angle_deg", DEG, {}),
        ("torque_Nm", TORQUE, {})]), LogMapping(), 1),
    "mdf": ("log.mf4", mdf, LogMapping(), 2),
    "hdf5, groups": ("log.h5", hdf5, LogMapping(), 2),
    "hdf5, table": ("log.hdf5", hdf5_table, LogMapping(), 1),
    "hdf5, matrix beside a vector": ("log.h5", hdf5_matrix, NAMED, 1),
}  # fmt: skip
DATED = ("tdms, waveforms", "tdms, time stamps", "mdf")


@pytest.mark.parametrize("kind", FILES)
def test_what_its_own_library_writes(kind: str, tmp_path: Path) -> None:
    name, make, wished, every = FILES[kind]
    make(tmp_path / name)
    columns, head = read_table(tmp_path / name)
    samples = apply(guess(columns, head, wished).mapping, columns)
    angle, torque = samples.angle, samples.torque
    assert torque is not None
    turned = np.mod(angle.values - ANGLE + math.pi, 2.0 * math.pi) - math.pi
    np.testing.assert_allclose(turned, 0.0, atol=1e-6 if "table" in kind else 1e-9)
    np.testing.assert_allclose(torque.values, TORQUE[::every], atol=1e-8)
    np.testing.assert_allclose((angle.stamps - angle.stamps[0]) * 1e-9, TIME, atol=1e-6)
    np.testing.assert_allclose((torque.stamps - angle.stamps[0]) * 1e-9, TIME[::every], atol=1e-6)
    begin = int(MOMENT.astype("datetime64[ns]").astype(np.int64)) if kind in DATED else 1_000_000_000
    assert abs(int(angle.stamps[0]) - begin) < 1000


def test_values_that_an_mdf_marks_as_invalid_are_none(tmp_path: Path) -> None:
    """Before a bus sends the first value, loggers write a placeholder and set its invalidation bit."""
    waits = np.arange(N) < 50
    with MDF(version="4.10") as file:
        file.append([Signal(DEG, TIME, name="angle", unit="deg")])
        shown = np.where(waits, -9999.0, TORQUE)
        file.append([Signal(shown, TIME, name="torque", unit="Nm", invalidation_bits=waits)])
        file.save(tmp_path / "log.mf4")
    columns, head = read_table(tmp_path / "log.mf4")
    torque = apply(guess(columns, head).mapping, columns).torque
    assert torque is not None and "50 rows without a number" in torque.note
    np.testing.assert_allclose(torque.values, TORQUE[50:], atol=1e-8)


def test_every_variable_is_named_in_a_question(tmp_path: Path) -> None:
    """Vectors, matrices, and what cannot be read."""
    content = {"time": TIME, "q": MATRIX, "short": TORQUE[::3], "odd": np.ones((7, 5)), "many": np.ones((4, 5, 6))}
    savemat(tmp_path / "log.mat", content)
    columns, head = read_table(tmp_path / "log.mat")
    with pytest.raises(RecordingError) as caught:
        guess(columns, head)
    assert all(name in str(caught.value) for name in ("time", "q_1", "q_2", "short", "odd", "many"))
    with pytest.raises(RecordingError, match=r"no variable 'log'; available: .*many"):
        read_table(tmp_path / "log.mat", table="log")


@pytest.mark.parametrize("kind", ["matlab, vectors", "tdms, waveforms", "mdf", "hdf5, groups", "matlab 7.3", "parquet"])
def test_a_damaged_one_is_one_line(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, make, *_ = FILES[kind]
    make(tmp_path / name)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[:40] + bytes(len(whole) // 3))
    capsys.readouterr()
    assert main(["import", str(tmp_path / name), "--out", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and name in said and ("damaged" in said or "not a" in said)
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("kind", ["tdms, waveforms", "mdf", "hdf5, groups", "matlab 7.3"])
def test_a_missing_library_is_named(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name, make, *_ = FILES[kind]
    make(tmp_path / name)
    for package in ("nptdms", "asammdf", "h5py"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RecordingError, match=r"in a checkout pip install '\.\[logs\]'"):
        read_table(tmp_path / name)


def test_a_damaged_file_is_one_line_even_where_its_reader_crashes(tmp_path: Path) -> None:
    """Byte 176 is the kind of numbers of the first variable: with an unknown kind scipy crashes."""
    savemat(tmp_path / "log.mat", {"t": TIME, "angle_deg": DEG})
    damaged = bytearray((tmp_path / "log.mat").read_bytes())
    damaged[176] = 67
    (tmp_path / "log.mat").write_bytes(damaged)
    command = [sys.executable, "-m", "textile_twin_core.cli.main", "import", str(tmp_path / "log.mat")]
    ended = subprocess.run([*command, "--out", str(tmp_path / "bag")], capture_output=True, text=True, check=False)
    assert ended.returncode == 2 and ended.stderr.count("\n") == 1 and str(tmp_path / "log.mat") in ended.stderr


def _workbook(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as out:
        out.writestr("xl/workbook.xml", "<workbook/>")


def _recording(path: Path) -> None:
    with BagWriter(path) as out:
        out.write_wrenches("balancing_torque/measured", np.arange(1, 9), np.ones(8))


@pytest.mark.parametrize(
    ("name", "make", "says"),
    [
        ("log.xlsx", _workbook, r"\.xlsx"),
        ("log.csv", lambda path: path.write_bytes(gzip.compress(b"time;angle")), "gzip; unpack"),
        ("log.dat", lambda path: path.write_bytes(b"TDSm" + bytes(99)), r"\.tdms"),
        ("log.bin", lambda path: path.write_bytes(np.arange(999.0).tobytes()), "zero bytes"),
        ("log.txt", lambda path: savemat(path, {"t": TIME}, appendmat=False), r"\.mat"),
        ("old.bag", lambda path: path.write_bytes(b"#ROSBAG V2.0\n" + bytes(99)), "ROS 1 bag.*rosbags-convert"),
        ("log.mcap", _recording, "compare"),
        ("log", _recording, "a recording already"),
        ("logs", lambda path: path.mkdir(), "a folder"),
        ("gone.csv", lambda _: None, "no such file"),
        ("log.csv", lambda path: path.touch(), "empty"),
        ("log.csv", lambda path: path.write_text("hello\nworld\n"), "no table of numbers"),
        ("log.parquet", lambda path: parquet.write_table(pyarrow.table({"time": TIME[:0], "angle": DEG[:0]}), path),
         "no rows"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_log_is_named_with_advice(
    name: str, make: Callable[[Path], object], says: str, tmp_path: Path
) -> None:
    make(tmp_path / name)
    with pytest.raises(RecordingError, match=says):
        read_table(tmp_path / name)


def test_a_part_of_the_file_of_an_imported_log_has_all_its_topics(tmp_path: Path) -> None:
    time = np.arange(15_000) / 500.0
    (tmp_path / "log.csv").write_text(table("time,angle_rad,torque", time, np.mod(16.0 * time, 6.28), np.sin(time)))
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "log.mcap")]) == 0
    os.truncate(tmp_path / "log.mcap", (tmp_path / "log.mcap").stat().st_size * 6 // 10)
    bag = open_bag(tmp_path / "log.mcap")
    for stamps in (bag.read_angles().stamps, bag.read_torques().stamps):
        assert 0.4 < stamps.size / time.size < 0.8
