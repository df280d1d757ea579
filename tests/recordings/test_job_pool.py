"""Jobs in processes and on a Dask cluster: a killed process loses no job, and failures are named."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.generators.killed_worker import marked
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.job_pool import run_jobs


def jobs_of(folder: Path, *what: str) -> list[tuple[Path, str, int]]:
    return [(folder, each, number) for number, each in enumerate(what)]


def test_each_job_ends_in_its_result_or_in_one_line(tmp_path: Path) -> None:
    ended = list(run_jobs(marked, jobs_of(tmp_path, "", "mistake", "fault", "")))
    assert [(each.index, each.result) for each in ended] == [(0, 0), (1, None), (2, None), (3, 3)]
    assert ended[1].error == "recording 1 is empty"
    assert "ZeroDivisionError: division by zero" in ended[2].error and not ended[0].error + ended[3].error
    assert {each.worker for each in ended} == {ended[0].worker} and ended[0].peak_bytes > 10e6


def test_a_killed_process_loses_no_job(tmp_path: Path) -> None:
    kinds = ["", "", "once", "", "always", "", "", "mistake"]
    ended = {each.index: each for each in run_jobs(marked, jobs_of(tmp_path, *kinds), workers=2)}
    assert sorted(ended) == list(range(8))
    assert [k for k in range(8) if ended[k].result != k] == [4, 7]
    assert "its process was killed" in ended[4].error and ended[7].error == "recording 7 is empty"


@pytest.mark.slow
def test_a_killed_worker_of_a_cluster_loses_no_job(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="no Dask: pip install distributed")
    kinds = ["", "once", "", "mistake", "", "once"]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        found = run_jobs(marked, jobs_of(tmp_path, *kinds), scheduler=cluster.scheduler_address)
        ended = {each.index: each for each in found}
    assert sorted(ended) == list(range(6))
    assert [k for k in range(6) if ended[k].result != k] == [3] and ended[3].error == "recording 3 is empty"


def test_a_cluster_that_does_not_answer_is_one_line() -> None:
    pytest.importorskip("distributed", reason="no Dask: pip install distributed")
    with pytest.raises(RecordingError, match="no scheduler answers there"):
        list(run_jobs(marked, [], scheduler="nonsense://127.0.0.1:1"))
