"""Every further table of the benchmark on a small workload, with its rows and pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import pytest

import textile_twin_core as ttc
from tests.benchmarks import growth, impact_table, shaft_table, tables
from textile_twin_core.bench import run, scenes


@pytest.mark.campaign
@pytest.mark.slow
def test_all_tables_files_and_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
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
    report, picture = tmp_path / "bench.json", tmp_path / "bench.png"
    tables.main(["--rounds", "2", "--json", str(report), "--png", str(picture)])
    said = capsys.readouterr().out
    for title in (
        "tufting: torque\n", "tufting: position\n", "ratios, time per sample", "exact, position / exact",
        "samples, table", "linkages, exact", "steady, 16 bit", "acceleration left out", "needle transfer",
        "penalty contact", "ratios, time for a run",
    ):  # fmt: skip
        assert title in said
    found = json.loads(report.read_text())
    assert found.keys() == {*tables.TABLES} and all(found.values())
    for row in found["speed"]:
        assert row["machine"] == "tufting" and len(row["ns_per_round"]) == len(row["us_per_round"]) == 2
        assert min(row["ns_per_round"]) <= row["ns_per_sample"] <= max(row["ns_per_round"])
    assert {row["estimator"] for row in found["shaft"]} == {shaft_table.NO_ALPHA, "causal", "smooth"}
    assert max(row["torque_rms_Nm"] for row in found["shaft"] if row["estimator"] == "causal") < 1e-3
    assert min(row["error_s"] for row in found["impacts"]) < 2e-15
    assert {path.name for path in tmp_path.glob("*.png")} == {"bench.png", "bench_impacts.png", "bench_shaft.png"}
    for drawn in tmp_path.glob("*.png"):
        pixels = matplotlib.image.imread(drawn)
        assert pixels.shape[1] > 800 and pixels.std() > 0.01
