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
    assert "crank 0.0597375 m, coupler 0.200739 m, rocker 0.230808 m (best)" in capsys.readouterr().out


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
        (["--swing", "30"], "--rotation"),
        (["--swing", "30", "--rotation", "180", "--ground", "0"], "positive number"),
        (["--swing", "30", "--rotation", "180", "--json", "/nowhere/designs.json"], "/nowhere"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["synthesize", "crank-rocker", *arguments]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1
