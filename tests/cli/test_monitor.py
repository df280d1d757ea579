"""textile-twin monitor: a folder of recordings, in processes, with trends and alarms written."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from tests.generators.faults import faulty
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter


def write(path: Path, kind: str, size: float, seed: int) -> None:
    made = faulty(kind, size, seed, duration_s=26.0, onset_s=18.0, rate=200.0).recording
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", made.angle_stamps_ns, ["main_shaft"], made.angle)
        out.write_wrenches("balancing_torque/measured", made.torque_stamps_ns, made.torque)


def alike(a: Any, b: Any) -> bool:
    """Compare up to the last digits, which depend on compilation; a process compiles only if it has much to do."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(alike(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(alike, a, b))
    return a == pytest.approx(b, rel=1e-9, abs=1e-9, nan_ok=True) if isinstance(a, float) else a == b


@pytest.mark.slow
def test_a_folder_is_watched_alike_by_one_process_and_by_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "bags"
    folder.mkdir()
    write(folder / "b_healthy", "", 0.0, 991)
    write(folder / "a_friction.mcap", "friction", 1.2, 992)
    tables, rows = [], []
    for workers in ("1", "2"):
        table, alarms = tmp_path / f"{workers}.parquet", tmp_path / f"{workers}.json"
        options = ["--machine", "tufting", "--learn", "40", "--workers", workers]
        code = main(["monitor", str(folder), *options, "--parquet", str(table), "--json", str(alarms)])
        assert code == 3
        tables.append(parquet.read_table(table))
        rows.append(json.loads(alarms.read_text()))
    assert alike(tables[0].to_pydict(), tables[1].to_pydict()) and alike(rows[0], rows[1])
    assert [len(each["alarms"]) for each in rows[0]] == [1, 0]
    assert rows[0][0]["alarms"][0]["kind"] == "constant_torque"
    assert {"bag", "turn", "stamp_ns", "rms_Nm", "load_force_size"} <= set(tables[0].column_names)


@pytest.mark.campaign
@pytest.mark.slow
def test_recordings_on_a_cluster_give_the_table_of_one_process(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="no Dask: pip install distributed")
    folder = tmp_path / "bags"
    folder.mkdir()
    for number in range(6):
        kind = "friction" if number % 5 == 0 else ""
        made = faulty(kind, 1.2, number, duration_s=20.0, onset_s=14.0, rate=150.0).recording
        with BagWriter(folder / f"bag_{number:02d}") as out:
            out.write_joint_states("main_shaft/angle", made.angle_stamps_ns, ["main_shaft"], made.angle)
            out.write_wrenches("balancing_torque/measured", made.torque_stamps_ns, made.torque)
    command = ["monitor", str(folder), "--machine", "tufting", "--learn", "30"]
    tables = {}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        for name, how in (("one", ["--workers", "1"]), ("two", ["--dask", cluster.scheduler_address])):
            table = tmp_path / f"{name}.parquet"
            assert main([*command, *how, "--parquet", str(table)]) == 3
            tables[name] = parquet.read_table(table).to_pydict()
    assert alike(tables["one"], tables["two"])
    assert sorted(set(tables["one"]["bag"])) == [f"bag_{number:02d}" for number in range(6)]


def test_what_cannot_be_watched_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("no recording")
    assert main(["monitor", str(tmp_path), "--machine", "tufting"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["monitor", str(tmp_path / "none"), "--machine", "tufting"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_recording_that_cannot_be_watched_sets_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "healthy", "", 0.0, 991)
    (tmp_path / "spoilt.mcap").write_text("no recording")
    given = ["monitor", str(tmp_path / "healthy"), str(tmp_path / "spoilt.mcap"), "--machine", "tufting"]
    assert main([*given, "--learn", "40", "--workers", "1", "--json", str(tmp_path / "alarms.json")]) == 2
    out, err = capsys.readouterr()
    assert "healthy: " in out and "spoilt.mcap: " in out
    assert "1 of 2 recordings could not be watched: spoilt.mcap" in err
    assert [bool(each["error"]) for each in json.loads((tmp_path / "alarms.json").read_text())] == [False, True]

    write(tmp_path / "friction", "friction", 1.2, 992)
    assert main(["monitor", str(tmp_path / "friction"), *given[2:], "--learn", "40", "--workers", "1"]) == 3
    err = capsys.readouterr().err
    assert "1 alarm in 1 recording; 1 of 2 recordings could not be watched: spoilt.mcap" in err


def test_a_truncated_recording_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "whole.mcap", "", 0.0, 991)
    written = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(written[: len(written) - 3000])
    given = ["monitor", str(tmp_path / "cut.mcap"), "--machine", "tufting", "--json", str(tmp_path / "rows.json")]
    assert main([*given, "--learn", "40"]) == 0
    capsys.readouterr()
    (rows,) = json.loads((tmp_path / "rows.json").read_text())
    assert ["cut.mcap: the recording was cut off" in note for note in rows["notes"]] == [True] and not rows["error"]


def test_few_turns_to_learn_from_are_enough_to_be_alarmed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Learn from fewer turns than the moving mean spans; recordings of the same name are distinguished and
    watched once.
    """
    for place, kind in (("old", ""), ("new", "friction")):
        (tmp_path / place).mkdir()
        write(tmp_path / place / "bag", kind, 1.2, 992)
    given = [str(tmp_path / place) for place in ("old", "new", "old/bag")]
    table = tmp_path / "trend.parquet"
    options = ["--machine", "tufting", "--learn", "8", "--workers", "1", "--parquet", str(table)]
    assert main(["monitor", *given, *options, "--json", str(tmp_path / "alarms.json")]) == 3
    out, err = capsys.readouterr()
    assert f"{tmp_path}/new/bag: " in out and out.count("8 learnt") == 2 and "RuntimeWarning" not in err
    rows = {each["bag"]: each["alarms"] for each in json.loads((tmp_path / "alarms.json").read_text())}
    assert [alarm["kind"] for alarm in rows[f"{tmp_path}/new/bag"]] == ["constant_torque"]
    assert not rows[f"{tmp_path}/old/bag"]
    at = re.search(r"alarm at ([0-9.]+) s", out)
    assert at is not None and 18.0 < float(at[1]) < 22.0, out  # onset at 18 s
    assert set(parquet.read_table(table)["bag"].to_pylist()) == {f"{tmp_path}/{place}/bag" for place in ("old", "new")}


def test_a_recording_that_is_given_with_a_file_of_it_is_watched_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "bag", "", 0.0, 991)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    table = tmp_path / "trend.parquet"
    options = ["--machine", "tufting", "--learn", "40", "--workers", "1", "--parquet", str(table)]
    for _ in range(2):
        assert main(["monitor", str(tmp_path / "bag"), str(file), *options]) == 0
        out, err = capsys.readouterr()
        assert f"{file}: is part of the recording {tmp_path / 'bag'}, which is read once" in err
        assert out.count("turns watched, ") == 1
        turns = parquet.read_table(table)["turn"].to_pylist()
        assert len(turns) == len(set(turns)) > 10
    assert main(["monitor", str(file), *options]) == 0


def test_a_trend_is_not_replaced_by_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "spoilt.mcap").write_text("no recording")
    table = tmp_path / "trend.parquet"
    table.write_bytes(b"of yesterday")
    assert main(["monitor", str(tmp_path / "spoilt.mcap"), "--machine", "tufting", "--parquet", str(table)]) == 2
    assert f"--parquet {table}: not written, as no turn was watched" in capsys.readouterr().err
    assert table.read_bytes() == b"of yesterday"


def test_a_recording_of_another_machine_is_noted(capsys: pytest.CaptureFixture[str]) -> None:
    bags = Path(__file__).parents[2] / "bags"
    for machine, noted in (("tufting", False), ("handloom_beatup", True)):
        main(["monitor", str(bags / "tufting_160rpm_synthetic"), "--machine", machine, "--learn", "20"])
        assert ("faults are named by chance" in capsys.readouterr().out) == noted
