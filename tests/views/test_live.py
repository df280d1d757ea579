"""Tests of the live view: every sample arrives, buffers are bounded, the server listens on loopback only."""

from __future__ import annotations

import socket
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from tests.views.conftest import START_NS, Run, rows_of, scalars_of
from textile_twin_core.errors import TwinError
from textile_twin_core.views import LiveView
from textile_twin_core.views.buffer import Buffer
from textile_twin_core.views.live_recording import Port

PATIENCE_S = 60.0
NEVER_S = 3600.0
"""Flush period beyond the end of a test, so that the test itself draws block by block."""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def feed(view: LiveView, run: Run, block: int = 100, pause_s: float = 0.0) -> None:
    residual = run.comparison.residual_Nm
    for first in range(0, run.stamps_ns.size, block):
        part = slice(first, first + block)
        view.add_predicted(run.stamps_ns[part], run.theta_rad[part], run.predicted_Nm[part], run.sigma_Nm[part])
        view.add_measured(run.measured_ns[part], run.measured_Nm[part])
        view.add_residual(run.measured_ns[part], residual[part])
        time.sleep(pause_s)


def test_every_sample_is_in_the_recording(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    with LiveView(run.machine, port=None, path=path, flush_s=0.02, limit_Nm=1.0) as view:
        feed(view, run, pause_s=0.01)
    assert view.error is None
    assert view.dropped == 0
    times, measured = scalars_of(path, "/torque/measured")
    np.testing.assert_allclose(times, (run.measured_ns - START_NS) * 1e-9, atol=1e-9)
    np.testing.assert_array_equal(measured, run.measured_Nm)
    _, predicted = scalars_of(path, "/torque/predicted", "Measurements:values")
    np.testing.assert_allclose(predicted, 1.01 * run.predicted_Nm, rtol=1e-14)
    _, residual = scalars_of(path, "/residual/residual")
    np.testing.assert_array_equal(residual, run.comparison.residual_Nm)
    times, _ = rows_of(path, "/world/base/links/l1", "Transform3D:translation")
    assert 50 * 6 * 0.8 < times.size <= 60 * 6 + 1  # at most 60 pictures a second
    _, states = rows_of(path, "/phase/needle_backing", "StateChange:state")
    # No phase is missing or repeated at the seams of blocks.
    assert all(a != b for a, b in zip(states[1:], states[:-1], strict=True))
    turns = np.count_nonzero(np.diff(np.floor((run.theta_rad - 0.38312100023839724) / (2 * np.pi))))
    assert len(states) == 2 * turns + 1


def test_the_predicted_curve_passes_the_filter_of_the_sensor(run: Run, tmp_path: Path) -> None:
    """A first-order low pass of samples between which the torque is linear, from rest at the first one."""
    sensor = replace(run.machine.sensors.torque, low_pass_s=0.01)
    machine = replace(run.machine, sensors=replace(run.machine.sensors, torque=sensor))
    path = tmp_path / "live.rrd"
    with LiveView(machine, port=None, path=path, flush_s=NEVER_S) as view:
        for part in (slice(0, 40), slice(40, 100)):
            view.add_predicted(run.stamps_ns[part], run.theta_rad[part], run.predicted_Nm[part])
    values = run.predicted_Nm[:100]
    _, filtered, _ = scipy.signal.lsim(([1.0], [0.01, 1.0]), values - values[0], np.arange(100) * 2e-3)
    _, predicted = scalars_of(path, "/torque/predicted", "Measurements:values")
    np.testing.assert_allclose(predicted, 1.01 * (filtered + values[0]), rtol=1e-8)


def test_wrapped_angles_and_torque_that_comes_first_are_drawn_in_place(run: Run, tmp_path: Path) -> None:
    """Check that the curve over the angle ends at the angle of its last sample, for any division into blocks."""
    path = tmp_path / "live.rrd"
    with LiveView(run.machine, port=None, path=path, flush_s=0.02) as view:
        for first in range(1000, 2000, 20):
            late, part = slice(first - 10, first + 10), slice(first, first + 20)
            wrapped = np.mod(run.theta_rad[late], 2 * np.pi)
            view.add_predicted(run.stamps_ns[late], wrapped, run.predicted_Nm[late])
            view.add_measured(run.measured_ns[part], run.measured_Nm[part])
            time.sleep(0.03)
    assert view.error is None
    origin = run.stamps_ns[990]
    times, strips = rows_of(path, "/angle/measured", "LineStrips2D:strips")
    theta = np.interp(times, (run.stamps_ns - origin) * 1e-9, run.theta_rad)
    ends = np.array([strip[0][-1][0] for strip in strips]) * (2 * np.pi / 720.0)
    off = np.abs(np.angle(np.exp(1j * (ends - theta))))
    assert np.count_nonzero(off > 1e-3) <= 6  # the strips that end with one of the five turns
    assert len(strips) > 100


def test_serves_on_loopback_and_closes_its_port(run: Run) -> None:
    port = free_port()
    with LiveView(run.machine, port=port) as view:
        assert view.url == f"rerun+http://127.0.0.1:{port}/proxy"
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S):
            pass
        with (
            pytest.raises(ConnectionRefusedError),
            socket.create_connection((other_address(), port), timeout=PATIENCE_S),
        ):
            pass
        feed(view, run)
    assert view.error is None
    view.close()  # a second time does nothing


def other_address() -> str:
    """Return an address of this machine other than 127.0.0.1; Linux answers on all of 127/8."""
    return "127.0.0.2"


def test_a_taken_port_gives_the_next(run: Run) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = int(taken.getsockname()[1])
        with LiveView(run.machine, port=port) as view, LiveView(run.machine, port=port) as second:
            ports = [int(one.url.split(":")[-1].split("/")[0]) for one in (view, second) if one.url]
            assert port < ports[0] < ports[1] <= port + 100
            for number in ports:
                with socket.create_connection(("127.0.0.1", number), timeout=PATIENCE_S):
                    pass


def test_no_free_port_is_an_error() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 65535))
        with pytest.raises(TwinError, match=r"127\.0\.0\.1: all ports from 65535 to 65535 are taken"):
            Port("127.0.0.1", 65535)


def test_an_address_of_another_computer_is_an_error() -> None:
    with pytest.raises(TwinError, match=r"192\.0\.2\.1:98\d\d: Cannot assign"):
        Port("192.0.2.1", 9876)


def test_nowhere_to_show_is_refused(run: Run) -> None:
    with pytest.raises(TwinError, match="a port to serve on or a file"):
        LiveView(run.machine, port=None)


def test_a_buffer_loses_no_block_that_arrives_while_it_is_emptied(monkeypatch: pytest.MonkeyPatch) -> None:
    buffer, block = Buffer(10), (np.zeros(1),)

    class Slow(deque[Any]):
        """A queue whose reader is interrupted: another thread puts a block meanwhile."""

        def __iter__(self) -> Iterator[Any]:
            held = list(super().__iter__())
            filling.append(pool.submit(buffer.put, block))
            time.sleep(0.05)
            return iter(held)

    filling: list[Future[None]] = []
    monkeypatch.setattr(buffer, "_blocks", Slow())
    with ThreadPoolExecutor(1) as pool:
        buffer.put(block)
        (first,) = buffer.take()
        filling[0].result()
        (second,) = buffer.take()
    assert (first.size, second.size) == (1, 1)


def test_a_full_buffer_drops_the_oldest_and_counts_them() -> None:
    buffer = Buffer(10)
    for k in range(5):
        buffer.put((np.full(4, float(k)), np.full(4, -float(k))))
    assert buffer.dropped == 12
    first, second = buffer.take()
    assert first.tolist() == [3.0] * 4 + [4.0] * 4
    assert second.tolist() == [-3.0] * 4 + [-4.0] * 4
    assert buffer.take() == ()


def test_a_torque_that_cannot_be_spoils_no_statistics(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    part = slice(0, 2500)
    measured, residual = run.measured_Nm[part].copy(), run.comparison.residual_Nm[part].copy()
    measured[1500], residual[1500] = -1e300, -1e300
    with LiveView(run.machine, port=None, path=path, flush_s=NEVER_S) as view:
        for stamps in np.array_split(np.arange(2500), 25):
            times = run.stamps_ns[stamps]
            view.add_predicted(times, run.theta_rad[stamps], run.predicted_Nm[stamps])
            view.add_measured(times, measured[stamps])
            view.add_residual(times, residual[stamps])
            view._take_and_draw()
    assert view.error is None
    assert 0.05 < logged_rms(path)[-1] < 2.0
    _, drawn = scalars_of(path, "/torque/measured")
    assert np.flatnonzero(np.isnan(drawn)).tolist() == [1500]


def test_one_wrong_torque_is_forgotten_after_two_minutes(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    rng = np.random.default_rng(5)
    with LiveView(run.machine, port=None, path=path, flush_s=NEVER_S, frames_hz=1.0) as view:
        for second in range(150):
            at = second + np.arange(50) / 50.0
            stamps, theta = START_NS + np.round(at * 1e9).astype(np.int64), 16.755 * at
            predicted, residual = 10.0 * np.sin(theta), rng.normal(0.0, 0.1, 50)
            if second == 12:
                residual[25] = 1e6
            view.add_predicted(stamps, theta, predicted)
            view.add_measured(stamps, predicted + residual)
            view.add_residual(stamps, residual)
            view._take_and_draw()
    assert view.error is None
    rms = logged_rms(path)
    assert max(rms) > 1e4
    np.testing.assert_allclose(rms[-1], 0.1, rtol=0.1)
    for entity in ("/angle/last", "/by_angle/extremes"):
        _, rows = rows_of(path, entity, "LineStrips2D:strips")
        heights = np.array([point[1] for strips in rows[-30:] for strip in strips for point in strip])
        assert np.ptp(heights) > 200.0, entity


def logged_rms(path: Path) -> list[float]:
    """Return the RMS residual of each summary [N m]."""
    _, summaries = rows_of(path, "/summary", "TextDocument:text")
    lines = [line for summary in summaries for line in summary[0].splitlines() if "RMS" in line]
    return [float(line.split("|")[2].removesuffix(" N m ")) for line in lines]
