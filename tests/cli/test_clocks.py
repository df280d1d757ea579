"""A clock set back within a recording: reported by every command, with the discarded samples."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.campaign import more
from tests.cli.test_poor_recordings import write
from tests.generators.mill_recordings import MillRecording, Stamps, healthy, record
from textile_twin_core.cli.main import main

MADE = record(healthy("tufting", 931, duration_s=24.0))


def set_back(stamps: Stamps, after_s: float, by_s: int = 3600) -> Stamps:
    """Set the clock back by an hour, as at the end of summer time."""
    late = (stamps - MADE.angle_stamps_ns[0]) * 1e-9 > after_s
    return stamps - late * by_s * 1_000_000_000


def both(after_s: float) -> MillRecording:
    angle, torque = (set_back(stamps, after_s) for stamps in (MADE.angle_stamps_ns, MADE.torque_stamps_ns))
    return replace(MADE, angle_stamps_ns=angle, torque_stamps_ns=torque)


def verdict(bag: Path, folder: Path, *options: str) -> list[dict[str, object]]:
    """Return the verdict of compare."""
    numbers = folder / "numbers.json"
    assert main(["compare", str(bag), "--machine", "tufting", "--json", str(numbers), *options]) == 0
    found: list[dict[str, object]] = json.loads(numbers.read_text())["verdict"]
    return found


@pytest.mark.parametrize(("after_s", "code"), [(16.0, 0), (8.0, 2)])
def test_a_clock_that_was_set_back(
    after_s: float, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Check that the later samples are discarded if they are the smaller part; otherwise the user has to agree."""
    bag = write(tmp_path / "bag", both(after_s))
    at = int(np.argmin(np.diff(both(after_s).angle_stamps_ns))) + 1
    for command in (["compare"], ["monitor", "--learn", "5"], ["replay", "--out", str(tmp_path / "out")]):
        assert main([command[0], str(bag), "--machine", "tufting", *command[1:]]) == code
        printed = capsys.readouterr()
        said = f"at sample {at}, {after_s:.0f}" if code == 0 else f"at sample {at}, "
        assert "a clock was set back: the stamps go back by 3599.99" in printed.err + printed.out
        assert said in printed.err + printed.out and printed.err.count("\n") <= 2


@pytest.mark.campaign
def test_discarded_samples_of_a_clock_set_back_are_of_one_part(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(tmp_path / "bag", both(8.0))
    assert verdict(bag, tmp_path, "--skip-bad-samples") == []
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("command", [["compare"], ["monitor", "--learn", "5"]])
def test_a_torque_whose_clock_was_set_back_alone(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(tmp_path / "bag", replace(MADE, torque_stamps_ns=set_back(MADE.torque_stamps_ns, 16.0)))
    assert main([command[0], str(bag), "--machine", "tufting", *command[1:]]) == 0
    printed = capsys.readouterr()
    assert (printed.err + printed.out).count("/balancing_torque/measured") == 1


@pytest.mark.parametrize("which", ["torque", *more("angle", "both")])
def test_a_clock_that_was_set_back_by_some_seconds_gives_no_verdict(
    which: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Set the clock back as a time server does; the recording continues beyond the time at which it was set back."""
    made = MADE
    if which != "angle":
        made = replace(made, torque_stamps_ns=set_back(MADE.torque_stamps_ns, 12.0, 3))
    if which != "torque":
        made = replace(made, angle_stamps_ns=set_back(MADE.angle_stamps_ns, 12.0, 3))
    bag = write(tmp_path / "bag", made)
    assert verdict(bag, tmp_path) == []
    assert ("torque from there on is not used" in capsys.readouterr().err) == (which != "both")
    assert main(["monitor", str(bag), "--machine", "tufting", "--learn", "12"]) == 0


def test_a_replay_discards_torque_as_the_other_commands_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--machine", "tufting", "--out", str(tmp_path / "out"), "--force"]
    assert main(["replay", str(write(tmp_path / "bag", both(8.0))), *arguments, "--skip-bad-samples"]) == 0
    printed = capsys.readouterr()
    (line,) = (line for line in printed.out.splitlines() if line.startswith("/balancing_torque/residual"))
    after = np.count_nonzero(MADE.torque_stamps_ns - MADE.angle_stamps_ns[0] > 8_000_000_000)
    assert int(line.split()[1]) > 0.95 * after and printed.err == ""
    alone = replace(MADE, torque_stamps_ns=set_back(MADE.torque_stamps_ns, 16.0))
    assert main(["replay", str(write(tmp_path / "alone", alone)), *arguments]) == 0
    assert capsys.readouterr().err.count("\n") == 1


def test_a_replay_without_any_torque_on_the_clock_of_the_angles_predicts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    later = MADE.torque_stamps_ns + 100 * 10**9
    bag = write(tmp_path / "bag", replace(both(16.0), torque_stamps_ns=later))
    assert main(["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert "torque from there on is not used" in printed.err and "/balancing_torque/predicted " in printed.out
    assert "/balancing_torque/residual" not in printed.out


def test_samples_out_of_order_are_not_a_clock_set_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    order = np.arange(MADE.angle.size)
    order[::10][:-1] += 2
    order[2::10][: order[::10].size - 1] -= 2
    stamps = MADE.angle_stamps_ns[np.clip(order, 0, order.size - 1)]
    bag = write(tmp_path / "bag", replace(MADE, angle_stamps_ns=stamps))
    assert main(["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out"), "--skip-bad-samples"]) == 0
    assert capsys.readouterr().err == ""
