"""Outputs that cannot be written are reported before the work, even if the recording is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter

COMMANDS = [
    ["calibrate", "gone", "--machine", "tufting", "--out", "OUT.yaml"],
    ["calibrate", "gone", "--machine", "tufting", "--out", "fine.yaml", "--json", "OUT.json"],
    ["identify", "gone", "--machine", "tufting", "--out", "OUT.yaml"],
    ["identify", "gone", "--machine", "tufting", "--json", "OUT.json"],
    ["monitor", "gone", "--machine", "tufting", "--parquet", "OUT.parquet"],
    ["monitor", "gone", "--machine", "tufting", "--json", "OUT.json"],
    ["compare", "gone", "--machine", "tufting", "--html", "OUT.html"],
    ["compare", "gone", "--machine", "tufting", "--quantity", "needle_position_m", "--png", "OUT.png"],
    ["replay", "gone", "--machine", "tufting", "--out", "fine", "--rrd", "OUT.rrd"],
    ["recover", "gone", "--out", "OUT"],
    ["import", "gone", "--out", "OUT"],
    ["view", "gone", "--machine", "tufting", "--png", "OUT.png"],
    ["drive", "tufting", "--torque", "gone.csv", "--time", "1", "--out", "OUT.csv"],
    ["simulate", "tufting", "--input", "gone.csv", "--out", "OUT.csv"],
    ["simulate", "tufting", "--rpm", "9", "--samples", "9", "--png", "fine.png", "--out", "OUT.csv"],
]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_place_that_cannot_be_written_is_reported_first(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([word.replace("OUT", "no/folder/out") for word in command]) == 2
    assert "the folder no does not exist; make it first" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [["recover"], ["replay", "--machine", "tufting"]], ids=" ".join)
def test_a_recording_is_not_replaced_by_its_own_output(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag) as out:
        out.write_joint_states("main_shaft/angle", np.arange(1, 999) * 2_000_000, ["main_shaft"], np.arange(998) * 0.03)
    before = (bag / "bag_0.mcap").read_bytes()
    assert main([command[0], str(bag), *command[1:], "--out", str(bag), "--force"]) == 2
    assert "is what is read, and would be lost; choose another name" in capsys.readouterr().err
    assert (bag / "bag_0.mcap").read_bytes() == before


def test_a_folder_in_the_place_of_a_file_is_reported_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out.json").mkdir()
    assert main(["identify", "gone", "--machine", "tufting", "--json", str(tmp_path / "out.json")]) == 2
    assert "a folder of that name exists; give the name of a file" in capsys.readouterr().err
