"""textile-twin bench: table and file on a small workload, and mistakes."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from textile_twin_core.bench import run, scenes
from textile_twin_core.cli.main import main

KEYS = {"rows", "ratios"}


@pytest.fixture
def little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reduce samples and tables."""
    make: Callable[..., tuple[scenes.Scene, ...]] = scenes.scenes
    monkeypatch.setattr(run, "scenes", lambda machine, samples: make(machine, 2000)[:2])
    monkeypatch.setattr("textile_twin_core.bench.run.TOLERANCES", (1e-6, 1e-13))


@pytest.mark.slow
@pytest.mark.usefixtures("little_work")
def test_a_machine_of_a_file_is_measured_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report, loom = tmp_path / "bench.json", Path("examples/six_bar_loom.yaml")
    assert main(["bench", "--machine", str(loom), "--rounds", "1", "--json", str(report)]) == 0
    said = capsys.readouterr().out
    assert "six_bar_loom" in said
    found = json.loads(report.read_text())
    assert found.keys() == KEYS
    assert all(math.isfinite(row["error_over_peak"]) for row in found["rows"])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (["--rounds", "0"], "--rounds: must be a whole number from 1 on, not '0'"),
        (["--rounds", "many"], "must be a whole number from 1 on"),
        (["--json"], "--json: expected one argument"),
        (["--peer"], "unrecognized arguments: --peer; see textile-twin bench --help"),
        (["tufting"], "unrecognized arguments: tufting"),
        (["--machine", "tuftin"], "did you mean tufting?"),
        (["--machine", "needle_transfer"], "machine 'needle_transfer' is no linkage"),
        (["--set", "backing_force_N"], "--set backing_force_N: write NAME=VALUE"),
        (["--json", "no/such/folder/bench.json"], "no/such/folder"),
        (["--png", "bench.png"], "unrecognized arguments: --png bench.png"),
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


def test_a_run_that_fails_leaves_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("textile_twin_core.cli.bench.run_bench", stop)
    assert main(["bench", "--json", str(tmp_path / "a.json")]) == 130
    assert list(tmp_path.iterdir()) == []
