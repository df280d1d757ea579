"""Benchmark on the tufting machine: its rows, their errors, the limit in C, and the installed peers."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from textile_twin_core.bench import run, run_bench
from textile_twin_core.bench.ratios import ratios
from textile_twin_core.bench.run import Row, load_peers
from textile_twin_core.bench.scenes import scenes
from textile_twin_core.bench.text import ratio_lines, speed_table
from textile_twin_core.bench.timing import PINS, bench_core
from textile_twin_core.bench.yardsticks import YARDSTICK, plain_operations
from textile_twin_core.expression.traversal import operation_counts

KEYS = {"method", "peer", "outputs", "machine", "batch", "error_over_peak", "ns_per_sample", "us_per_call"}
SCENES = ("torque", "position", "torque and position", "everything")
LEAST_ERROR = {"mujoco, soft loop": 1e-4, "mujoco, soft loop, tight": 1e-7, "exudyn, time stepping": 1e-8}
PEERS = load_peers()


@pytest.fixture(scope="module", autouse=True)
def fewer_tables() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("textile_twin_core.bench.run.TOLERANCES", (1e-6, 1e-13))
        yield


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return run_bench(ttc.machines.tufting(), rounds=1, samples=2000)


@pytest.mark.slow
def test_rows_are_what_is_promised(rows: list[Row]) -> None:
    for row in json.loads(json.dumps([asdict(row) for row in rows])):
        assert row.keys() >= KEYS
        assert row["machine"] == "tufting" and row["batch"] == 2000
        assert row["ns_per_sample"] > 0.0 and (row["peer"] == YARDSTICK or row["us_per_call"] > 0.0)
    assert tuple(dict.fromkeys(row.outputs for row in rows)) == SCENES


def test_errors_are_below_the_tolerances(rows: list[Row]) -> None:
    ours = [row for row in rows if row.peer is None]
    assert {row.method for row in ours} == {"exact", *(f"table 1e-{k:02d}" for k in (6, 13))}
    for row in ours:
        tolerance = 1e-14 if row.method == "exact" else float(row.method.removeprefix("table "))
        assert row.error_over_peak is not None and row.error_over_peak < tolerance, row


@pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler here")
def test_the_limit_in_C_agrees(rows: list[Row]) -> None:
    limits = [row for row in rows if row.peer == "C"]
    assert [row.method for row in limits] == ["vectorised", "libm loop"] * len(SCENES)
    for row in limits:
        assert row.error_over_peak is not None and row.error_over_peak < 1e-14, row


def test_tables_name_every_row(rows: list[Row]) -> None:
    table = speed_table(rows)
    assert [line for line in table.splitlines() if line.startswith("tufting")] == [f"tufting: {s}" for s in SCENES]
    assert all(row.method in table for row in rows)
    if any(row.peer == "C" for row in rows):
        assert "exact / C, libm loop" in ratio_lines(ratios(rows))


@pytest.mark.slow
@pytest.mark.parametrize("library", PEERS.MODULES)
@pytest.mark.parametrize("number", [0, *more(*range(1, len(SCENES)))], ids=SCENES)
def test_peers_do_the_same_work(library: str, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    if find_spec(library) is None:
        pytest.skip(f"{library} is not installed here")
    monkeypatch.setattr(PEERS, "MODULES", {library: PEERS.MODULES[library]})
    scene, said = scenes(ttc.machines.tufting(), 2000)[number], list[str]()
    found = PEERS.peer_candidates(scene, said.append)
    assert said == []
    for candidate in found:
        name = f"{candidate.peer}, {candidate.method}"
        if candidate.error is not None:
            error = candidate.error()
        else:
            assert candidate.result is not None
            error = scene.error(candidate.result())
        least = 0.0 if scene.name == "position" else LEAST_ERROR.get(name, 0.0)
        assert least <= error < max(100.0 * least, 1e-12), name


def test_a_peer_that_is_not_installed_or_fails_costs_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    modules = {"no_such_library": "nothing", "numpy": "no_such_module"}
    monkeypatch.setattr(PEERS, "MODULES", modules)
    said: list[str] = []
    machine = ttc.machines.tufting()
    rows = run_bench(machine, with_peers=True, rounds=1, samples=100, scene_names=["position"], say=said.append)
    assert {row.peer for row in rows} <= {None, "C", YARDSTICK}
    assert said[0] == "no_such_library is left out: not installed (pip install -r requirements-peers.lock)"
    assert len(said) == 2 and said[1].startswith("numpy is left out of 'position': No module named")


def test_the_page_of_the_peers_states_the_versions_of_the_lock() -> None:
    root = Path(__file__).parents[2]
    stated = re.findall(r"\(`(\w+)`\) \| ([\d.]+) \|", (root / "tests/benchmarks/README.md").read_text())
    locked = re.findall(r"^(\w+)==([\d.]+) ", (root / "requirements-peers.lock").read_text(), re.M)
    assert len(stated) == len(PEERS.MODULES) and set(stated) <= set(locked)


def test_without_the_repository_the_peers_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, PEERS.__name__)
    monkeypatch.setattr(run, "__file__", str(tmp_path / "textile_twin_core/bench/run.py"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ttc.errors.SceneError):
        load_peers()


@pytest.mark.skipif(not PINS, reason="this system holds no process to a core")
def test_the_bench_keeps_to_one_core() -> None:
    before, seen = os.sched_getaffinity(0), list[set[int]]()
    run_bench(
        ttc.machines.tufting(), rounds=2, samples=100, scene_names=["position"],
        progress=lambda done, total: seen.append(os.sched_getaffinity(0)),
    )  # fmt: skip
    assert seen == [{bench_core()}] * 3
    assert os.sched_getaffinity(0) == before


def test_the_yardstick_has_as_many_operations() -> None:
    outputs = [ttc.machines.tufting().model.output("balancing_torque_Nm")]
    asked, found = operation_counts(outputs), operation_counts([plain_operations(outputs)])
    assert (found["div"], found["sqrt"]) == (asked["div"], asked["sqrt"]) == (3, 2)
    plain = sum(asked[op] for op in ("add", "sub", "mul", "square"))
    assert abs(found["add"] + found["mul"] - plain) <= 1 and plain > 100
    assert found.keys() == {"add", "mul", "div", "sqrt"}


def test_errors_are_relative_to_the_peak() -> None:
    scene = scenes(ttc.machines.tufting(), 500)[0]
    (name,) = scene.outputs
    off = scene.exact[name] + 1e-3 * np.abs(scene.exact[name]).max()
    assert scene.error({name: off}) == pytest.approx(1e-3, rel=1e-9)


def test_results_stay_where_peers_left_them() -> None:
    """Check that later candidates do not overwrite the results of earlier ones in the same process."""
    scene = scenes(ttc.machines.tufting(), 2000)[0]
    candidates = PEERS.peer_candidates(scene)
    before = [c.result() for c in candidates if c.result is not None]
    kept = [{name: values.copy() for name, values in found.items()} for found in before]
    for candidate in candidates:
        for work in (candidate.single, candidate.batch):
            if work is not None:
                work()
    for found, copy in zip(before, kept, strict=True):
        assert all(np.array_equal(found[name], copy[name]) for name in copy)
