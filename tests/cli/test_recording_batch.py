"""compare and identify over a folder of recordings: processes, a Dask cluster, one table, failures by name."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from tests.generators.faults import faulty
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write two recordings of a tufting machine, one with more friction from the start, and an invalid file."""
    made_in = tmp_path_factory.mktemp("shift")
    for name, kind in (("friction", "friction"), ("healthy", "")):
        made = faulty(kind, 1.2, 71, duration_s=9.0, onset_s=0.0, rate=120.0).recording
        with BagWriter(made_in / name) as out:
            out.write_joint_states("main_shaft/angle", made.angle_stamps_ns, ["main_shaft"], made.angle)
            out.write_wrenches("balancing_torque/measured", made.torque_stamps_ns, made.torque)
    (made_in / "spoilt.mcap").write_text("no recording")
    return made_in


def same(a: Any, b: Any) -> bool:
    """Compare up to the last digits, in which compiled and interpreted loops differ."""
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return a == pytest.approx(b, rel=1e-9, abs=1e-9, nan_ok=True) if isinstance(a, float) else a == b


def kill_a_busy_worker(cluster: Any, killed: list[int]) -> None:
    """Kill the first worker that processes a recording, as a kernel without free memory does."""
    from distributed import Client

    with Client(cluster.scheduler_address, set_as_default=False) as client:
        for _ in range(6000):
            busy = [worker for worker, tasks in client.processing().items() if tasks]
            if busy:
                pids = {nanny.worker_address: nanny.pid for nanny in cluster.workers.values()}
                os.kill(pids[busy[0]], signal.SIGKILL)
                killed.append(pids[busy[0]])
                return
            time.sleep(0.01)


@pytest.mark.campaign
@pytest.mark.slow
def test_compare_gives_one_table_wherever_it_runs_though_a_worker_is_killed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    distributed = pytest.importorskip("distributed", reason="no Dask: pip install distributed")
    command = ["compare", str(folder), "--machine", "tufting", "--json", str(tmp_path / "numbers.json")]
    alone, shared = tmp_path / "alone.parquet", tmp_path / "shared.parquet"
    assert main([*command, "--workers", "1", "--parquet", str(alone)]) == 2
    out, err = capsys.readouterr()
    assert all(f"{name}: " in out for name in ("healthy", "friction", "spoilt.mcap"))
    assert "1 of 3 recordings could not be read: spoilt.mcap" in err

    killed: list[int] = []
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        killer = threading.Thread(target=kill_a_busy_worker, args=(cluster, killed))
        killer.start()
        assert main([*command, "--dask", cluster.scheduler_address, "--parquet", str(shared)]) == 2
        killer.join()
    assert killed
    one, two = parquet.read_table(alone).to_pydict(), parquet.read_table(shared).to_pydict()
    assert list(one) == list(two) and all(same(one[name], two[name]) for name in one)
    assert one["bag"] == ["friction", "healthy", "spoilt.mcap"]
    assert [error is None for error in one["error"]] == [True, True, False]
    assert one["verdict.cause"][0] == ["unmodelled_friction"]
    assert one["verdict.value"][0][0] == pytest.approx(1.2, abs=0.1)
    told = json.loads((tmp_path / "numbers.json").read_text())
    assert [each["bag"] for each in told] == one["bag"]
    errors = [each.get("torque", {}).get("rms_error_Nm") for each in told]
    assert errors == [error and pytest.approx(error, rel=1e-12) for error in one["torque.rms_error_Nm"]]


@pytest.mark.slow
def test_a_limit_names_the_recordings_beyond_it(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["compare", str(folder / "healthy"), "--machine", "tufting", "--parquet", str(tmp_path / "t.parquet")]
    assert main([*given, "--max-rms", "0.001"]) == 3
    assert "healthy: " in capsys.readouterr().err
    assert parquet.read_table(tmp_path / "t.parquet").num_rows == 1


@pytest.mark.slow
def test_identify_writes_a_row_of_parameters(folder: Path, tmp_path: Path) -> None:
    table = tmp_path / "t.parquet"
    given = ["identify", str(folder / "friction"), str(folder / "spoilt.mcap"), "--machine", "tufting"]
    assert main([*given, "--workers", "1", "--parquet", str(table)]) == 2
    found = parquet.read_table(table).to_pydict()
    assert found["bag"] == ["friction", "spoilt.mcap"]
    assert found["parameters.shaft_coulomb_Nm.value"] == [pytest.approx(1.2, abs=0.1), None]


def test_what_is_for_one_recording_is_refused_for_several(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command, option in ((["compare"], ["--png", "p.png"]), (["identify"], ["--out", "m.yaml"])):
        assert main([*command, str(folder), "--machine", "tufting", *option]) == 2
        assert f"{option[0]} is for one recording" in capsys.readouterr().err
    assert main(["compare", str(folder / "healthy"), "--machine", "tufting", "--dask", "tcp://127.0.0.1:1"]) == 2
    assert "--dask works on several recordings" in capsys.readouterr().err
