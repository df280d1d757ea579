"""Recordings with little information, at every command that judges one: clear messages, an exit code, no
invented fit.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.generators.mill_recordings import MillRecording, Stamps, healthy, record
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter

CASE = healthy("tufting", 911, duration_s=14.0)
COMMANDS = ["compare", "calibrate", "identify", "monitor"]


def write(path: Path, made: MillRecording, torque: bool = True) -> Path:
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", made.angle_stamps_ns, ["main_shaft"], made.angle)
        if torque:
            out.write_wrenches("balancing_torque/measured", made.torque_stamps_ns, made.torque)
    return path


def between(made: MillRecording, *parts_s: tuple[float, float]) -> MillRecording:
    """Return the samples logged in these parts of the recording."""

    def inside(stamps: Stamps) -> np.ndarray:
        second = (stamps - made.angle_stamps_ns[0]) * 1e-9
        return np.logical_or.reduce([(second > first) & (second < last) for first, last in parts_s])

    angle, torque = inside(made.angle_stamps_ns), inside(made.torque_stamps_ns)
    return replace(
        made,
        angle_stamps_ns=made.angle_stamps_ns[angle],
        angle=made.angle[angle],
        torque_stamps_ns=made.torque_stamps_ns[torque],
        torque=made.torque[torque],
    )


def run(command: str, bag: Path, folder: Path) -> int:
    out = ["--out", str(folder / "made.yaml")] if command == "calibrate" else []
    return main([command, str(bag), "--machine", "tufting", *out, "--json", str(folder / "found.json")])


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("command", COMMANDS)
def test_what_cannot_be_judged_is_said_in_one_line(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = record(CASE)
    still, short = between(made, (-1.0, 0.9)), between(made, (6.0, 6.2))
    hour = replace(made, torque_stamps_ns=made.torque_stamps_ns + 3_600 * 10**9)
    words = {"still": "stands still", "short": "of a turn", "hour": "clock", "alone": "no topic"}
    if command == "monitor":
        words |= dict.fromkeys(("still", "short", "hour"), "nothing is watched")
    for name, part in (("still", still), ("short", short), ("hour", hour), ("alone", made)):
        bag = write(tmp_path / name, part, torque=name != "alone")
        code = run(command, bag, tmp_path)
        shown = capsys.readouterr()
        assert not (tmp_path / "made.yaml").exists()
        if command == "compare" and name in ("still", "short"):
            # Errors are defined for any two torques, but a delay or a cause is not.
            found = json.loads((tmp_path / "found.json").read_text())
            assert code == 0 and found["verdict"] == [] and found["torque"]["delay_s"] == 0.0
            assert words[name] in shown.out and "nothing can be determined" in shown.out and "clocks" not in shown.out
            continue
        assert code == 2, (name, shown.err)
        assert shown.err.count("\n") == 1 and words[name] in shown.err, (name, shown.err)


@pytest.mark.campaign
def test_gaps_do_no_harm_and_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write(tmp_path / "gaps", between(record(CASE), (-1.0, 6.0), (7.0, 9.0), (9.6, 20.0)))
    assert run("compare", bag, tmp_path) == 0
    assert "gaps in the shaft angle" in capsys.readouterr().out
    assert json.loads((tmp_path / "found.json").read_text())["verdict"] == []
    assert run("calibrate", bag, tmp_path) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    low, high = found["zero_rad"]["interval95"]
    assert low - 2e-3 < 0.0 < high + 2e-3 and high - low < 0.01


@pytest.mark.campaign
def test_a_controller_that_is_polled_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Simulate a controller that reads the encoder every 10 ms and is polled at 100 Hz by another clock with
    random delay.
    """
    made, cycle_ns = record(CASE), 1.003e7
    first, last = made.angle_stamps_ns[[0, -1]]
    stamps = np.arange(first + 3e7, last, 1e7)
    stamps += np.random.default_rng(1).exponential(3e5, stamps.size)
    read = np.floor((stamps - first) / cycle_ns) * cycle_ns
    angle = np.interp(read, made.angle_stamps_ns - first, np.unwrap(made.angle))
    bag = write(tmp_path / "polled", replace(made, angle_stamps_ns=stamps.astype(np.int64), angle=angle))
    command = ["compare", str(bag), "--machine", "tufting"]
    assert main(command) == 0
    assert "as no shaft does" in capsys.readouterr().out
    assert main([*command, "--stamp-jitter", "0.003"]) == 0
    assert "as no shaft does" not in capsys.readouterr().out


def test_clocks_that_drift_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write(tmp_path / "drift", record(replace(CASE, torque=replace(CASE.torque, drift=8e-4))))
    assert run("compare", bag, tmp_path) == 0
    (cause,) = json.loads((tmp_path / "found.json").read_text())["verdict"]
    assert cause["cause"] == "clocks_drift" and cause["value"] == pytest.approx(8e-4, rel=0.03)
    assert "drift apart by 8" in capsys.readouterr().out
