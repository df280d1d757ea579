"""Invalid input: one line with the problem, exit code 2, and no output."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from textile_twin_core import machines
from textile_twin_core.cli.main import main
from textile_twin_core.errors import MachineError
from textile_twin_core.recordings import BagWriter

SETTINGS = [
    ("tufting", "l1_m=1e300", "l1_m"),
    ("tufting", "l1_m=1e-300", "computation fails"),
    ("tufting", "backing_force_N=1e308", "at most 1e+12"),
    ("handloom_beatup", "ground_m=0", "coincide at (0, 0) m"),
    ("handloom_beatup", "ground_angle_rad=inf", "ground_angle_rad"),
    ("handloom_beatup", "arm_m=1e300", "arm_m"),
    ("elliptic_gear_beatup", "centre_line_rad=nan", "centre_line_rad"),
    ("needle_transfer", "motion_law=0.5", "motion_law"),
    ("needle_transfer", "stroke_m=1e300", "stroke_m"),
    ("needle_transfer", "cycles_per_minute=1e-300", "computation fails"),
    ("needle_transfer", "pad_linear_N_mm=1e12", "too stiff"),
    ("needle_transfer", "pad_damping_Ns_m=1e12", "too stiff"),
    ("needle_transfer", "element_3_kg=1e-12", "too stiff"),
    ("needle_transfer", "spring_1_Ns_m=1e12", "too stiff"),
]


def _refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    return lines[0]


@pytest.mark.parametrize(("machine", "setting", "word"), SETTINGS)
def test_sizes_that_no_machine_has(
    machine: str, setting: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = ["--rpm", "250", "--samples", "5", "--out", str(tmp_path / "o.csv")]
    assert word in _refused(["simulate", machine, "--set", setting, *motion], capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("[" * 3000, "too deep"),
        (f"machine: tufting\nparameters: {{l1_m: {'9' * 5000}}}\n", "not YAML"),
        ("machine: tufting\nparameters: {l1_m: .inf}\n", "parameters.l1_m"),
        ("machine: needle_transfer\nparameters: {motion_law: 0.5}\n", "parameters.motion_law"),
        ("machine: handloom_beatup\nparameters: {ground_m: 0}\n", "coincide at (0, 0) m"),
    ],
)
def test_machine_files(text: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "garbage.yaml"
    path.write_text(text)
    line = _refused(["machines", str(path)], capsys)
    assert word in line and str(path) in line


def test_more_samples_than_memory_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "tufting", "--rpm", "1", "--samples", "1" + "0" * 15, "--out", str(tmp_path / "o.csv")]
    assert "memory" in _refused(words, capsys)
    assert not list(tmp_path.iterdir())


def test_a_speed_beyond_arithmetic(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion = tmp_path / "motion.csv"
    motion.write_text(
        "theta_rad,omega_rad_s,alpha_rad_s2,time_s\n" + "".join(f"{k},1e300,0,{k}e-300\n" for k in range(5))
    )
    words = ["simulate", "needle_transfer", "--input", str(motion), "--out", str(tmp_path / "o.csv")]
    assert "computation fails" in _refused(words, capsys)


def test_a_cell_without_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion = tmp_path / "motion.csv"
    motion.write_text(f"theta_rad,omega_rad_s,alpha_rad_s2\n{'1' * 200_000},1,1\n")
    words = ["simulate", "tufting", "--input", str(motion), "--out", str(tmp_path / "o.csv")]
    assert "motion.csv, line 2" in _refused(words, capsys)


def test_a_recording_with_flipped_bits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Flip bits in the descriptions of the messages: the intact data are read, or refused in one or two lines."""
    whole, damaged, stamps = tmp_path / "whole", tmp_path / "damaged.mcap", np.arange(50) * 2_000_000 + 10**18
    with BagWriter(whole, {"place": "mill"}) as bag:
        bag.add_topic("main_shaft/angle", "sensor_msgs/msg/JointState")
        bag.write_joint_states(
            "main_shaft/angle", stamps, ["main_shaft"], stamps[:, None] * 1e-9, stamps[:, None] * 0.0
        )
    raw = next(whole.glob("*.mcap")).read_bytes()
    for number in range(0, len(raw), 29):
        damaged.write_bytes(raw[:number] + bytes([raw[number] ^ 0x80]) + raw[number + 1 :])
        code = main(["recover", str(damaged), "--out", str(tmp_path / "out.mcap"), "--force"])
        assert code in (0, 2), (number, capsys.readouterr().err)


def test_a_machine_made_in_python_is_refused_alike() -> None:
    with pytest.raises(MachineError):
        machines.tufting(l1_m=1e300)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["compare", "nowhere", "--machine", "tufting", "--torque-unit", "0"], "other than zero"),
        (["view", "nowhere"], "no such file"),
        (["monitor", "nowhere", "--machine", "tufting", "--parquet", "x.csv"], "must end in .parquet"),
        (["published", "--json", "x.txt"], "must end in .json"),
    ],
)
def test_options_that_would_mislead(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert says in _refused(words, capsys)


@pytest.mark.parametrize("command", ["drive tufting --torque 0 --time 1", "simulate tufting --rpm 160"])
def test_more_samples_than_memory_holds_are_refused(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*command.split(), "--samples", "10000001", "--out", str(tmp_path / "out.csv")]
    assert "--samples: must be at most 10000000, not '10000001'" in _refused(words, capsys)


def test_the_module_of_the_command_runs_it() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "textile_twin_core.cli.main", "machines"], capture_output=True, text=True, check=True
    )
    assert "tufting" in ran.stdout
