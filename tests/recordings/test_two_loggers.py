"""Angle and torque in the files of two loggers, each with a clock of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators.two_loggers import Pair, pair
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag


def write(path: Path, head: str, *columns: np.ndarray, separator: str = ",") -> Path:
    table = np.stack(columns, axis=1)
    np.savetxt(path, table, fmt="%.7f", delimiter=separator, header=head.replace(",", separator), comments="")
    return path


@pytest.fixture(scope="module")
def logged() -> Pair:
    return pair(21, longest_s=45.0)


@pytest.fixture(scope="module")
def torque(logged: Pair) -> np.ndarray:
    twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
    return np.asarray(twin.evaluate(logged.theta, logged.omega, logged.alpha)["balancing_torque_Nm"])


def angle_log(folder: Path, logged: Pair) -> str:
    return str(write(folder / "angle.csv", "time_s,angle_rad", logged.angle_s, logged.angle_rad))


def check(bag: Path, logged: Pair, torque: np.ndarray, within_s: float = 1e-3) -> None:
    """Compare the torque's stamps with the moments by the encoder's clock."""
    angles, torques = open_bag(bag).read_angles(), open_bag(bag).read_torques()
    first = torque.size - len(torques)
    since = (torques.stamps - angles.stamps[0]) * 1e-9 + logged.angle_s[0]
    assert np.abs(since - logged.true_s[first:]).max() < within_s
    np.testing.assert_allclose(torques.torque_Nm, torque[first:], atol=1e-6)


@pytest.mark.parametrize(
    ("head", "unit_s", "columns", "options"),
    [
        ("t [ms];n [rpm];M [Ncm]", 1e3, "speed", []),
        ("clock;command;actual speed;torque [Ncm]", 1.0, "set and speed", ["--torque-time", "clock"]),
        ("us;x;M [Ncm]", 1e6, "speed", ["--torque-time", "us", "--torque-time-unit", "us", "--torque-log-speed", "x"]),
    ],
)
def test_the_torques_clock_is_found_by_a_speed_of_both(
    head: str,
    unit_s: float,
    columns: str,
    options: list[str],
    tmp_path: Path,
    logged: Pair,
    torque: np.ndarray,
    capsys: pytest.CaptureFixture[str],
) -> None:
    speed = logged.omega * 30.0 / np.pi
    held = [np.full(speed.size, 150.0), speed] if "set" in columns else [speed]
    clock = (logged.drive_s - logged.drive_s[0] + 5.0) * unit_s
    drive = tmp_path / "drive.csv"
    write(drive, head.replace(";", ","), clock, *held, torque * 100.0, separator=";")
    command = ["import", angle_log(tmp_path, logged), "--torque-log", str(drive), "--out", str(tmp_path / "bag")]
    assert main([*command, *options]) == 0
    check(tmp_path / "bag", logged, torque)
    assert "clocks  the torque's times" in capsys.readouterr().out
    (tmp_path / "mine.yaml").write_text((tmp_path / "bag.mapping.yaml").read_text())
    assert main([*command, "--force", "--mapping", str(tmp_path / "mine.yaml")]) == 0  # the next pair, without options
    check(tmp_path / "bag", logged, torque)


def test_rows_before_the_first_value_move_no_stamp(tmp_path: Path, logged: Pair, torque: np.ndarray) -> None:
    """The drive's log begins with rows without a speed and a torque, as before its fieldbus runs."""
    waited = np.arange(-60.0, 0.0, 0.1) + logged.drive_s[0]
    empty = np.full(waited.size, np.nan)
    columns = [(waited, logged.drive_s), (empty, logged.omega * 30.0 / np.pi), (empty, torque)]
    drive = write(tmp_path / "drive.csv", "time_s,speed [rpm],torque [Nm]", *map(np.concatenate, columns))
    command = ["import", angle_log(tmp_path, logged), "--torque-log", str(drive), "--out", str(tmp_path / "bag")]
    assert main(command) == 0
    check(tmp_path / "bag", logged, torque)


@pytest.mark.parametrize("delay_s", [0.0, 0.02])
def test_the_torques_clock_is_found_by_the_predicted_torque(
    delay_s: float, tmp_path: Path, logged: Pair, torque: np.ndarray
) -> None:
    """The torque sensor's delay of the machine file is no offset of its clock."""
    late = np.interp(logged.true_s - delay_s, logged.true_s, torque)
    drive = write(tmp_path / "drive.csv", "time_s,torque_Nm", logged.drive_s, late)
    (tmp_path / "mine.yaml").write_text(f"machine: tufting\nsensors: {{torque: {{delay_s: {delay_s}}}}}\n")
    command = ["import", angle_log(tmp_path, logged), "--torque-log", str(drive), "--out", str(tmp_path / "bag")]
    assert main([*command, "--machine", str(tmp_path / "mine.yaml")]) == 0
    check(tmp_path / "bag", logged, late)


def test_without_anything_in_common_the_offset_is_asked_for(
    tmp_path: Path, logged: Pair, torque: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write(tmp_path / "drive.csv", "time_s,torque_Nm", logged.drive_s, torque)
    command = ["import", angle_log(tmp_path, logged), "--torque-log", str(drive), "--out", str(tmp_path / "bag")]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "--machine" in said and "--torque-offset" in said
    offset_s = float(np.median(logged.true_s - logged.drive_s))
    assert main([*command, "--torque-offset", f"{offset_s:.6f}"]) == 0
    check(tmp_path / "bag", logged, torque, within_s=6e-3)  # the drift is left out


def test_an_even_speed_is_refused_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steady = pair(3, steady=True, wander=0.0, longest_s=60.0)
    drive = write(tmp_path / "drive.csv", "time_s,speed,torque_Nm", steady.drive_s, steady.omega, steady.omega)
    command = ["import", angle_log(tmp_path, steady), "--torque-log", str(drive), "--out", str(tmp_path / "bag")]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "fit alike" in said and "--torque-offset" in said
    assert not (tmp_path / "bag").exists()
