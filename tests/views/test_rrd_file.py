"""Recordings for the viewer on a full disk: an error, and a complete file is never replaced by a partial one."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from tests.full_disk import full_disk
from tests.views.conftest import Run
from tests.views.test_live import PATIENCE_S
from textile_twin_core.comparison.orders import order_map
from textile_twin_core.errors import RecordingError
from textile_twin_core.views import (
    LiveView,
    screenshot,
    write_comparison_recording,
    write_motion_recording,
    write_orders_recording,
)
from textile_twin_core.views.rrd_file import check_whole, written


def test_a_comparison_that_does_not_fit_leaves_the_old_file(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"old")
    with full_disk(300_000), pytest.raises(RecordingError, match="File too large"):
        write_comparison_recording(path, run.comparison, run.machine, title="a test")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]
    assert path.read_bytes() == b"old"


def test_a_motion_that_does_not_fit_is_an_error(run: Run, tmp_path: Path) -> None:
    with full_disk(500_000), pytest.raises(RecordingError):
        write_motion_recording(tmp_path / "m.rrd", run.machine, run.stamps_ns, run.theta_rad, title="a test")


def test_a_file_without_its_footer_is_an_error(tmp_path: Path) -> None:
    """Leave room for all logged data but not for the footer of the file."""

    def write(path: Path, limit: int) -> None:
        with full_disk(limit):
            stream = rr.RecordingStream("test", recording_id="test")
            with written(stream, path, rrb.Blueprint()):
                stream.log("numbers", rr.Scalars(np.arange(1000.0)), static=True)

    write(tmp_path / "whole.rrd", 1_000_000)
    whole = (tmp_path / "whole.rrd").stat().st_size
    with pytest.raises(RecordingError):
        write(tmp_path / "cut.rrd", whole - 20)


def test_a_live_view_reports_a_full_disk_while_it_runs(run: Run, tmp_path: Path) -> None:
    with (
        full_disk(600_000),
        LiveView(run.machine, port=None, path=tmp_path / "live.rrd", flush_s=0.02) as view,
    ):
        end = time.monotonic() + PATIENCE_S
        while view.error is None and time.monotonic() < end:
            view.add_predicted(run.stamps_ns, run.theta_rad, run.predicted_Nm)
            time.sleep(0.1)
        assert isinstance(view.error, RecordingError)


def test_a_live_view_reports_an_incomplete_file(run: Run, tmp_path: Path) -> None:
    with LiveView(run.machine, port=None, path=tmp_path / "live.rrd", flush_s=60.0) as view:
        view.add_predicted(run.stamps_ns, run.theta_rad, run.predicted_Nm)
        with full_disk(500_000):
            view.close()
    assert isinstance(view.error, RecordingError)


def test_a_file_that_the_viewer_cannot_open_is_an_error_at_once(run: Run, tmp_path: Path) -> None:
    whole = write_comparison_recording(tmp_path / "run.rrd", run.comparison, run.machine, title="a test").read_bytes()
    check_whole(tmp_path / "run.rrd")
    for content, words in ((b"", "is no recording"), (b"junk" * 99, "is no recording"), (whole[:-200], "has no end")):
        (tmp_path / "spoilt.rrd").write_bytes(content)
        with pytest.raises(RecordingError, match=words):
            screenshot(tmp_path / "spoilt.rrd", tmp_path / "run.png")
    with pytest.raises(RecordingError, match="cannot be read"):
        screenshot(tmp_path, tmp_path / "run.png")


def test_order_maps_are_written_as_a_whole_recording(tmp_path: Path) -> None:
    time = np.arange(20_000) / 1000.0
    angle = 2.0 * np.pi * (5.0 * time + 0.2 * time**2)
    found = order_map(time, angle, 3.0 * np.cos(4.0 * angle), max_order=10.0)
    write_orders_recording(tmp_path / "orders.rrd", {"signal [m]": found}, title="orders")
    check_whole(tmp_path / "orders.rrd")
