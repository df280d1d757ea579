"""TDMS, MDF4, HDF5 and MATLAB 7.3, each as its own library writes it."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag

N, STEP_S = 2000, 0.002
TIME = np.arange(N) * STEP_S
ANGLE = np.mod(16.0 * TIME + 0.3, 2.0 * math.pi)
DEG = np.degrees(ANGLE)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0
BEGIN = datetime(2026, 11, 22, 10, 0, tzinfo=UTC)
BEGIN_NS = 1_795_341_600_000_000_000


def tdms_waveforms(path: Path) -> tuple[float, int]:
    """Waveforms with their interval and start, the torque at half the rate."""
    start = np.datetime64("2026-11-22T10:00:00")
    wave = {"wf_start_offset": 0.0, "wf_start_time": start}
    with TdmsWriter(path) as out:
        angle = {**wave, "wf_increment": STEP_S, "unit_string": "deg"}
        torque = {"wf_start_time": start, "wf_increment": 2.0 * STEP_S, "unit_string": "Nm"}
        out.write_segment(
            [ChannelObject("log", "angle", DEG, angle), ChannelObject("log", "torque", TORQUE[::2], torque)]
        )
    return 2, BEGIN_NS


def tdms_time_channel(path: Path) -> tuple[float, int]:
    """A channel of times in the group, in two segments."""
    with TdmsWriter(path) as out:
        for part in (slice(0, 700), slice(700, N)):
            names = (("Time", TIME, "s"), ("Winkel", DEG, "deg"), ("Drehmoment", TORQUE, "Nm"))
            out.write_segment(
                [
                    ChannelObject("Messung", name, values[part], {"NI_UnitDescription": unit})
                    for name, values, unit in names
                ]
            )
    return 1, 1_000_000_000


def tdms_time_stamps(path: Path) -> tuple[float, int]:
    """A channel of moments."""
    moments = np.datetime64("2026-11-22T10:00:00", "us") + (TIME * 1e6).astype("timedelta64[us]")
    with TdmsWriter(path) as out:
        out.write_segment([ChannelObject("g", "Time", moments), ChannelObject("g", "angle_deg", DEG),
                           ChannelObject("g", "torque_Nm", TORQUE)])  # fmt: skip
    return 1, BEGIN_NS


def mdf(path: Path) -> tuple[float, int]:
    """Two groups, each with its master; the torque at half the rate."""
    file = MDF(version="4.10")
    file.start_time = BEGIN
    file.append([Signal(DEG, TIME, name="ShaftAngle", unit="deg")])
    file.append([Signal(TORQUE[::2], TIME[::2], name="Torque", unit="Nm")])
    file.save(path, overwrite=True)
    file.close()
    return 2, BEGIN_NS


def hdf5(path: Path) -> tuple[float, int]:
    """Data sets in groups, with units and times of their own."""
    with h5py.File(path, "w") as file:
        for name, values, unit, every in (("angle", DEG, "deg", 1), ("torque", TORQUE, "Nm", 2)):
            group = file.create_group(f"log/{name}")
            group.create_dataset("time", data=TIME[::every]).attrs["units"] = "s"
            group.create_dataset(name, data=values[::every]).attrs["units"] = unit
    return 2, 1_000_000_000


def hdf5_table(path: Path) -> tuple[float, int]:
    """A table of several fields, as pandas and PyTables write one."""
    rows = np.zeros(N, [("time_s", "<f8"), ("angle_deg", "<f4"), ("torque_Nm", "<f8"), ("state", "S4")])
    rows["time_s"], rows["angle_deg"], rows["torque_Nm"] = TIME, DEG, TORQUE
    with h5py.File(path, "w") as file:
        file.create_dataset("log", data=rows)
    return 1, 1_000_000_000


def matlab_73(path: Path) -> tuple[float, int]:
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
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as written:
        written.write(head)
    return 1, 1_000_000_000


KINDS: dict[str, tuple[str, Callable[[Path], tuple[float, int]]]] = {
    "tdms, waveforms": ("log.tdms", tdms_waveforms),
    "tdms, a channel of times": ("log.tdms", tdms_time_channel),
    "tdms, time stamps": ("log.tdms", tdms_time_stamps),
    "mdf": ("log.mf4", mdf),
    "hdf5, groups": ("log.h5", hdf5),
    "hdf5, table": ("log.hdf5", hdf5_table),
    "matlab 7.3": ("log.mat", matlab_73),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_its_own_library_writes(kind: str, tmp_path: Path) -> None:
    name, make = KINDS[kind]
    every, begin = make(tmp_path / name)
    assert main(["import", str(tmp_path / name), "--out", str(tmp_path / "bag")]) == 0
    angles, torques = open_bag(tmp_path / "bag").read_angles(), open_bag(tmp_path / "bag").read_torques()
    np.testing.assert_allclose(angles.angles_rad, ANGLE, atol=1e-6 if "table" in kind else 1e-12)
    np.testing.assert_allclose(torques.torque_Nm, TORQUE[:: int(every)], atol=1e-12)
    assert abs(int(angles.stamps[0]) - begin) < 1000
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, TIME, atol=1e-6)
    np.testing.assert_allclose((torques.stamps - angles.stamps[0]) * 1e-9, TIME[:: int(every)], atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_one_is_one_line(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, make = KINDS[kind]
    make(tmp_path / name)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[:40] + bytes(len(whole) // 3))
    capsys.readouterr()
    assert main(["import", str(tmp_path / name), "--out", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and name in said and "damaged" in said
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("kind", ["tdms, waveforms", "mdf", "hdf5, groups", "matlab 7.3"])
def test_a_missing_library_is_named_in_one_line(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    name, make = KINDS[kind]
    make(tmp_path / name)
    for package in ("nptdms", "asammdf", "h5py"):
        monkeypatch.setitem(sys.modules, package, None)
    assert main(["import", str(tmp_path / name), "--out", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "in a checkout pip install '.[logs]'" in said
