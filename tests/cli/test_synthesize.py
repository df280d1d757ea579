"""textile-twin synthesize as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from textile_twin_core.cli.main import main


def test_designs_as_json_and_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "designs.json"
    code = main(["synthesize", "crank-rocker", "--swing", "30", "--rotation", "180", "--json", str(out)])
    shown = capsys.readouterr().out
    assert code == 0
    written = json.loads(out.read_text())
    assert [design["beta_deg"] for design in written["designs"]] == list(range(1, 76))
    assert written["best"]["beta_deg"] == 48
    assert written["best_continuous"]["r_over_l"] == pytest.approx(0.3, abs=1e-12)
    (row,) = [line.split() for line in shown.splitlines() if line.endswith("  best")]
    assert row == ["48", "0.1991", "0.6691", "0.7694", "0.298", "67.24", "best"]


def test_rotation_follows_from_the_criteria(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synthesize", "crank-rocker", "--swing", "30"]) == 0
    shown = capsys.readouterr().out
    assert "rotation 180 deg" in shown
    assert "48.2299   0.1998   0.6661   0.7721   0.300       67.14  best of any beta" in shown


def test_lengths_for_a_ground_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "designs.json"
    task = ["synthesize", "crank-rocker", "--swing", "30", "--rotation", "180", "--ground", "0.3"]
    assert main([*task, "--json", str(out)]) == 0
    best = json.loads(out.read_text())["best"]
    assert [round(best[f"{link}_m"], 4) for link in ("crank", "coupler", "rocker", "ground")] == [
        0.0597,
        0.2007,
        0.2308,
        0.3,
    ]
    task = ["synthesize", "crank-rocker", "--swing", "30", "--rotation", "180", "--ground", "0.3"]
    assert "crank 0.0597375 m, coupler 0.200739 m, rocker 0.230808 m (best)" in capsys.readouterr().out
    assert main([*task, "--choose", "continuous"]) == 0
    assert "crank 0.0599529 m, coupler 0.199843 m, rocker 0.23164 m (continuous)" in capsys.readouterr().out


def test_no_design_is_good_enough(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synthesize", "crank-rocker", "--swing", "30", "--rotation", "210"]) == 0
    shown = capsys.readouterr().out
    assert "no design keeps the transmission angle within 40 deg" in shown and "1 design\n" in shown


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--swing", "200", "--rotation", "180"], "swing 200 deg"),
        (["--swing", "-3", "--rotation", "180"], "swing -3 deg"),
        (["--swing", "30", "--rotation", "100"], "from 105 to 285 deg"),
        (["--swing", "30", "--rotation", "nan"], "must be a number"),
        (["--swing", "30", "--rotation", "180", "--ground", "0"], "positive number"),
        (["--swing", "30", "--rotation", "180", "--json", "/proc/designs.json"], "/proc"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["synthesize", "crank-rocker", *arguments]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


@pytest.mark.parametrize("task", ["points", "curve"])
def test_a_seed_below_zero_is_refused(task: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synthesize", task, "--points", "0,0 1,1", "--seed", "-1"]) == 2
    assert "whole number from 0 on" in capsys.readouterr().err


def test_crank_rocker_from_the_hand_becomes_a_machine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, turn = tmp_path / "loom.yaml", tmp_path / "turn.csv"
    hand = "-0.0776,0.28985 0,0.3 0.0776,0.28985"
    task = ["synthesize", "crank-rocker", "--hand", hand, "--time-ratio", "1", "--ground", "0.3"]
    assert main([*task, "--tool-mass", "2.5", "--section", "7850,0.03,0.01", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "swing 29." in shown or "swing 30." in shown
    assert "rocker pivot at" in shown and f"wrote {out}" in shown
    assert main(["simulate", str(out), "--rpm", "148", "--samples", "36", "--out", str(turn)]) == 0
    assert "beater_acceleration_m_s2" in turn.read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("task", "says"),
    [
        (["slider", "--stroke", "0.05", "--time-ratio", "1.1"], "offset 0.0178"),
        (["points", "--points", "0,0 0.1,0.02 0.15,0.1", "--seed", "2"], "crank angles at the points"),
        (["balance", "tufting", "--by", "counterweight"], "RMS gravity torque 0.393591 N m before"),
        (["balance", "tufting", "--by", "flywheel", "--ripple", "0.03"], "after, under a constant 5.24"),
        (["balance", "handloom_beatup", "--by", "force", "--links", "l1,l3"], "counterweight on l3"),
        (["balance", "handloom_beatup", "--by", "spring"], "spring from D to B"),
        (["balance", "handloom_beatup", "--by", "second-linkage", "--phase", "180"], "180.0000 deg ahead"),
    ],
)
def test_results_are_machine_files(
    task: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, result, turn = tmp_path / "made.yaml", tmp_path / "made.json", tmp_path / "turn.csv"
    assert main(["synthesize", *task, "--out", str(out), "--json", str(result)]) == 0
    assert says in capsys.readouterr().out
    assert json.loads(result.read_text())["kind"] == task[0]
    assert main(["simulate", str(out), "--rpm", "100", "--samples", "36", "--out", str(turn)]) == 0
    assert len(turn.read_text().splitlines()) == 37


def test_curve_from_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("x,y\n0,0\n0.1,0.02\n0.15,0.1\n0.1,0.16\n0.02,0.12\n0,0.06\n")
    search = ["synthesize", "curve", "--file", str(path), "--generations", "40"]
    assert main([*search, "--out", str(tmp_path / "bar.yaml")]) == 0
    capsys.readouterr()
    path.write_text("x,y\n0,0\n0.1,a\n")
    assert main(["synthesize", "curve", "--file", str(path)]) == 2
    assert "row 3" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("task", "says"),
    [
        ([], "TASK"),
        (["crank-rocker", "--rotation", "180"], "--swing"),
        (["crank-rocker", "--hand", "0,0 1,1", "--rotation", "180"], "three positions"),
        (["crank-rocker", "--swing", "30", "--rotation", "180", "--time-ratio", "1"], "same quantity"),
        (["crank-rocker", "--swing", "30", "--rotation", "180", "--out", "x.yaml"], "--ground"),
        (["slider", "--stroke", "-1"], "positive number"),
        (["points", "--points", "0,0 1"], "X,Y"),
        (["points", "--points", "0,0"], "2 to 5 points"),
        (["curve"], "--file or by --points"),
        (["balance", "elliptic_gear_beatup", "--by", "counterweight"], "lacks masses"),
        (["balance", "tufting", "--by", "counterweight", "--links", "l2"], "fixed point"),
        (["slider", "--stroke", "0.05", "--section", "1,2"], "DENSITY"),
    ],
)
def test_mistakes_of_every_task(task: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synthesize", *task]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


@pytest.mark.parametrize(
    "task",
    [
        ["crank-rocker", "--swing", "30", "--ground", "0.3"],
        ["slider", "--stroke", "0.05", "--time-ratio", "1.1"],
        ["points", "--points", "0,0 0.1,0.02 0.15,0.1"],
        ["curve", "--points", "0,0 0.1,0.02 0.15,0.1 0.1,0.16 0.02,0.12 0,0.06", "--generations", "2"],
        ["balance", "tufting", "--by", "counterweight"],
    ],
)
def test_a_machine_file_is_replaced_with_force_alone(
    task: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("# by hand\nmachine: tufting\n")
    assert main(["synthesize", *task, "--out", str(mine)]) == 2
    said = capsys.readouterr().err
    assert f"--out {mine}" in said and "--force" in said and said.count("\n") == 1
    assert mine.read_text().startswith("# by hand")
    assert main(["synthesize", *task, "--json", str(mine)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert mine.read_text().startswith("# by hand")
    assert main(["synthesize", *task, "--out", str(mine), "--force"]) == 0
    assert "# by hand" not in mine.read_text()


@pytest.mark.parametrize(
    ("task", "says"),
    [
        (["crank-rocker", "--swing", "30", "--ground", "1e14"], "points.C[0]: must be a finite number of at most"),
        (["slider", "--stroke", "0.05", "--slider-mass", "2e13"], "mass_kg: must be a finite number of at most 1e+12"),
        (["slider", "--stroke", "0.05", "--section", "1e14,0.5,0.5"], "must be a finite number of at most 1e+12"),
    ],
)
def test_a_machine_that_no_file_can_hold_is_not_written(
    task: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "big.yaml"
    assert main(["synthesize", *task, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and says in said and str(out) in said and not out.exists()
