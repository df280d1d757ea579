"""textile-twin bench: tables, files and pictures on a small workload, and mistakes."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import pytest

import textile_twin_core as ttc
from textile_twin_core.bench import growth, impact_table, run, scenes, shaft_table
from textile_twin_core.cli.main import main

KEYS = {"rows", "ratios", "growth", "shaft", "impacts"}


@pytest.fixture
def little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reduce the samples, sizes and conditions of all tables."""
    make: Callable[..., tuple[scenes.Scene, ...]] = scenes.scenes
    monkeypatch.setattr(run, "scenes", lambda machine, samples: make(machine, 2000)[:2])
    monkeypatch.setattr("textile_twin_core.bench.run.TOLERANCES", (1e-6, 1e-13))
    monkeypatch.setattr(growth, "SAMPLES", (100, 1000))
    monkeypatch.setattr(growth, "MACHINES", (1,))
    monkeypatch.setattr(growth, "LINKAGES", (1, 4))
    speed = ttc.machines.tufting().nominal_speed_rad_s
    wanted = [(shaft_table.Condition(16, speed, "steady"), ("causal", "smooth"))]
    monkeypatch.setattr(shaft_table, "conditions", lambda machine: wanted)
    ways = impact_table.ways
    monkeypatch.setattr(impact_table, "ways", lambda: [way for way in ways() if "1e+08" not in way[1]])


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.usefixtures("little_work")
def test_all_tables_files_and_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report, picture = tmp_path / "bench.json", tmp_path / "bench.png"
    assert main(["bench", "--all", "--rounds", "2", "--json", str(report), "--png", str(picture)]) == 0
    said = capsys.readouterr().out
    for title in (
        "2 rounds of turns", "tufting: torque\n", "tufting: position\n", "ratios, time per sample",
        "exact, position / exact", "samples, table", "linkages, exact", "steady, 16 bit", "acceleration left out",
        "needle transfer", "penalty contact", "ratios, time for a run",
    ):  # fmt: skip
        assert title in said
    found = json.loads(report.read_text())
    assert found.keys() == KEYS and all(found.values())
    for row in found["rows"]:
        assert row["machine"] == "tufting" and len(row["ns_per_round"]) == len(row["us_per_round"]) == 2
        assert min(row["ns_per_round"]) <= row["ns_per_sample"] <= max(row["ns_per_round"])
    assert {row["estimator"] for row in found["shaft"]} == {shaft_table.NO_ALPHA, "causal", "smooth"}
    assert max(row["torque_rms_Nm"] for row in found["shaft"] if row["estimator"] == "causal") < 1e-3
    assert min(row["error_s"] for row in found["impacts"]) < 2e-15
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "bench.json", "bench.png", "bench_impacts.png", "bench_shaft.png",
    ]  # fmt: skip
    for drawn in tmp_path.glob("*.png"):
        pixels = matplotlib.image.imread(drawn)
        assert pixels.shape[1] > 800 and pixels.std() > 0.01


@pytest.mark.slow
@pytest.mark.usefixtures("little_work")
def test_speed_alone_is_the_default(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report, loom = tmp_path / "bench.json", Path("examples/six_bar_loom.yaml")
    assert main(["bench", "--machine", str(loom), "--rounds", "1", "--json", str(report)]) == 0
    said = capsys.readouterr().out
    assert "six_bar_loom" in said
    found = json.loads(report.read_text())
    assert found.keys() == KEYS
    assert found["rows"] and not (found["growth"] or found["shaft"] or found["impacts"])
    assert all(math.isfinite(row["error_over_peak"]) for row in found["rows"])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (["--rounds", "0"], "--rounds: must be a whole number from 1 on, not '0'"),
        (["--rounds", "many"], "must be a whole number from 1 on"),
        (["--png", "bench.svg"], "--png bench.svg: the name must end in .png"),
        (["--json"], "--json: expected one argument"),
        (["--peer"], "unrecognized arguments: --peer; see textile-twin bench --help"),
        (["tufting"], "unrecognized arguments: tufting"),
        (["--machine", "tuftin"], "did you mean tufting?"),
        (["--machine", "needle_transfer"], "machine 'needle_transfer' is no linkage"),
        (["--set", "backing_force_N"], "--set backing_force_N: write NAME=VALUE"),
        (["--json", "no/such/folder/bench.json"], "no/such/folder"),
        (["--png", "no/such/folder/bench.png"], "no/such/folder"),
    ],
)
def test_a_mistake_is_one_line_before_any_work(
    wrong: list[str], words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("the bench ran")

    monkeypatch.setattr("textile_twin_core.cli.bench.run_bench", work)
    assert main(["bench", *wrong]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("textile-twin: ") and told.err.count("\n") == 1
    assert words in told.err


def test_a_picture_without_matplotlib_is_refused_before_any_work(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    assert main(["bench", "--png", str(tmp_path / "bench.png")]) == 2
    assert "matplotlib" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_fails_leaves_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("textile_twin_core.cli.bench.run_bench", stop)
    assert main(["bench", "--json", str(tmp_path / "a.json"), "--png", str(tmp_path / "a.png")]) == 130
    assert list(tmp_path.iterdir()) == []


def test_help_names_every_table(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["bench", "--help"])
    assert end.value.code == 0
    said = capsys.readouterr().out
    assert all(word in said for word in ("--shaft", "--impacts", "--all", "_shaft", "_impacts", "--peers"))
