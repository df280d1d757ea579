"""Recordings whose stamps or angles come from a counter that passes its end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.machine import Encoder
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.machine_topics import MachineTopics
from textile_twin_core.recordings.recorded_clock import clock_notes

N = 4000
TIME = 2_000_000 * np.arange(N, dtype=np.int64)
COUNTS = np.rint(4000.0 / (2.0 * np.pi) * np.cumsum(0.0524 * (1.0 + 0.1 * np.sin(0.05 * np.arange(N)))))
TORQUE = np.sin(0.03 * np.arange(N))


def wrapped_bag(path: Path, stamps: np.ndarray, angle: np.ndarray) -> Path:
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], angle, log_times_ns=TIME + 10**18)
        out.write_wrenches("balancing_torque/measured", stamps, TORQUE, log_times_ns=TIME + 10**18)
    return path


@pytest.mark.parametrize("count_ns", [1_000, 1_000_000, 1])
@pytest.mark.parametrize("epoch_ns", [0, 1_700_000_000 * 10**9])
def test_stamps_of_a_wrapping_clock_go_on(tmp_path: Path, count_ns: int, epoch_ns: int) -> None:
    true = TIME + 2**32 * count_ns - 2_500_000_000
    bag = open_bag(wrapped_bag(tmp_path / "bag", epoch_ns + true % (2**32 * count_ns), 0.01 * np.arange(N)))
    angles = MachineTopics().read_angles(bag, Encoder())
    torques = MachineTopics().read_torques(bag)
    for samples in (angles, torques):
        assert np.array_equal(samples.stamps - samples.stamps[0], true - true[0])
        assert "counter of 32 bits" in clock_notes(samples)[0]


@pytest.mark.parametrize(("bits", "signed"), [(16, False), (16, True)])
@pytest.mark.parametrize("resolution", [None, 2.0 * np.pi / 4000.0])
def test_angles_of_a_wrapping_counter_go_on(tmp_path: Path, bits: int, signed: bool, resolution: float | None) -> None:
    low = -(2 ** (bits - 1)) if signed else 0
    logged = (COUNTS - low) % 2.0**bits + low
    bag = open_bag(wrapped_bag(tmp_path / "bag", TIME + 10**18, logged * 2.0 * np.pi / 4000.0))
    angles = MachineTopics().read_angles(bag, Encoder(resolution_rad=resolution))
    assert np.allclose(np.diff(angles.angles_rad), np.diff(COUNTS) * 2.0 * np.pi / 4000.0, atol=1e-9)
    assert "no multiple of a turn" in clock_notes(angles)[0]


def test_replay_of_a_wrapping_clock_predicts_each_sample_at_its_own_stamp(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stamps = (TIME + 2**32 * 1000 - 2_500_000_000) % (2**32 * 1000)
    bag = wrapped_bag(tmp_path / "bag", stamps, 0.0524 * np.arange(N))
    assert main(["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out")]) == 0
    captured = capsys.readouterr()
    assert "counter of 32 bits" in captured.out + captured.err
    made = open_bag(tmp_path / "out")
    (predicted,) = (made.read_torques("balancing_torque/predicted"),)
    assert set(predicted.recorded_ns.tolist()) <= set(stamps.tolist()) and len(predicted) > N - 10
