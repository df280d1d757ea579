"""Order analysis against MATLAB's documented signals, another route of order tracking, and a recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import chirp
from scipy.signal.windows import flattop

from textile_twin_core.arrays import FloatArray
from textile_twin_core.cli.main import main
from textile_twin_core.comparison.orders import OrderMap, order_map
from textile_twin_core.errors import RecordingError

FS, LAST = 600.0, 5.0


def run_up() -> tuple[FloatArray, FloatArray]:
    """Times and angle of MathWorks' example for `rpmordermap`: 600 Hz, 5 s, 10 to 40 revolutions per second."""
    time = np.arange(int(FS * LAST) + 1) / FS
    speed = np.linspace(10.0, 40.0, time.size)
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) / FS
    return time, 2.0 * np.pi * turns


def amplitude(found: OrderMap, order: float) -> FloatArray:
    return np.asarray(found.amplitude[round(order * found.turns)])


def test_the_documented_example_of_rpmordermap_within_one_percent() -> None:
    """Orders 1, 0.5, 4 and 6 of amplitudes 1, 1, 2 and 1; rpmordermap gives their RMS."""
    time, angle = run_up()
    signal = np.array([1.0, 1.0, 2.0, 1.0]) @ np.cos(np.array([[1.0], [0.5], [4.0], [6.0]]) * angle)
    found = order_map(time, angle, signal)
    assert found.peaks()[0].order == 4.0
    assert {peak.order for peak in found.peaks()} == {0.5, 1.0, 4.0, 6.0}
    for order, true in ((1.0, 1.0), (0.5, 1.0), (4.0, 2.0), (6.0, 1.0)):
        rms = amplitude(found, order) / np.sqrt(2.0)
        assert np.abs(rms / (true / np.sqrt(2.0)) - 1.0).max() < 1e-3, order
    assert found.order[-1] == pytest.approx(7.5, abs=0.1)  # as far as 600 Hz reach at 40 revolutions per second


def test_the_documented_waterfall_example_within_one_percent() -> None:
    """Chirps of orders 1 and 2.5 with amplitudes 2 and 1 beside a quadratic one that is no order."""
    time, angle = run_up()
    signal = 2.0 * chirp(time, 10.0, LAST, 40.0) + chirp(time, 25.0, LAST, 100.0)
    signal += 0.8 * chirp(time, 60.0, LAST, 240.0, "quadratic")
    found = order_map(time, angle, signal)
    assert np.abs(amplitude(found, 1.0) / 2.0 - 1.0).max() < 0.01
    assert np.abs(amplitude(found, 2.5) / 1.0 - 1.0).max() < 0.01


def test_another_route_of_order_tracking_gives_the_same_amplitudes() -> None:
    """Integrals over the angle of the samples without resampling (time variant Fourier transform)."""
    rng = np.random.default_rng(3)
    time = np.arange(40_000) / 1000.0
    angle = 2.0 * np.pi * (4.0 * time + 0.05 * time**2) + 0.3 * np.sin(2.0 * np.pi * 0.2 * time)
    signal = sum(rng.normal() * np.cos(k * angle + rng.uniform(0.0, 6.0)) for k in (1, 2, 2.5, 7, 13))
    signal = np.asarray(signal + 0.5 + 0.3 * rng.normal(size=time.size))
    found = order_map(time, angle, signal, max_order=15.0)
    speed = np.gradient(angle, time, edge_order=2)
    span = found.turns * 2.0 * np.pi
    shape = flattop(4097, sym=True)
    for k in range(0, found.time_s.size, 9):
        first = angle[0] + k * span / 4.0
        inside = (angle >= first) & (angle < first + span)
        window = np.interp((angle[inside] - first) / span, np.linspace(0.0, 1.0, shape.size), shape)
        weight = window * speed[inside] / 1000.0
        lines = np.exp(-1j * found.order[16:, None] * angle[inside]) @ (
            weight * (signal[inside] - signal[inside].mean())
        )
        tracked = 2.0 * np.abs(lines) / (span * shape[:-1].mean())
        assert np.abs(found.amplitude[16:, k] - tracked).max() < 0.01 * tracked.max()


def test_holes_and_standstills_do_not_count_as_motion() -> None:
    time = np.arange(0.0, 60.0, 0.002)
    speed = np.interp(time, [0, 5, 7, 30, 32, 36, 38, 60], [0, 0, 20, 20, 0, 0, 15, 15])
    angle = np.cumsum(speed) * 0.002
    signal = 3.0 + np.cos(2.0 * angle)
    kept = np.random.default_rng(1).uniform(size=time.size) > 0.02  # dropped messages
    signal[100:200:7] = np.nan
    found = order_map(time[kept], angle[kept], signal[kept], max_order=8.0)
    assert amplitude(found, 2.0) == pytest.approx(1.0, abs=0.01)
    assert found.amplitude[0] == pytest.approx(3.0, abs=0.01)
    assert np.abs(amplitude(found, 3.0)).max() < 0.01
    assert found.speed_rad_s.min() > 10.0


def test_too_few_turns_are_refused_in_words() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    with pytest.raises(RecordingError, match=r"is 1\.6 turns of the shaft, and order analysis needs 6; record longer"):
        order_map(time, 5.0 * time, np.cos(time))


@pytest.mark.parametrize("turns", [0.8, 2.5, 5.0])
def test_a_shaft_that_rocks_is_refused_as_one(turns: float) -> None:
    """Order analysis of a shaft that swings farther than its window works."""
    time = np.arange(0.0, 40.0, 0.004)
    with pytest.raises(RecordingError, match=rf"reverses after at most {turns:.1f} turns"):
        order_map(time, np.pi * turns * np.cos(time), np.cos(time))
    theta = 60.0 * np.pi * np.cos(0.3 * time)
    assert amplitude(order_map(time, theta, np.cos(2.0 * theta), max_order=4.0), 2.0) == pytest.approx(1.0, abs=0.02)


def test_the_command_finds_the_orders_of_the_torque(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The synthetic loom's torque, whose orders are those of the twin over a turn at the same speed."""
    out = tmp_path / "orders.json"
    bag = "bags/handloom_beatup_synthetic"
    assert main(["orders", bag, "--json", str(out), "--png", str(tmp_path / "o.png"), "--signal", "torque"]) == 0
    numbers = json.loads(out.read_text())["signals"]["torque [N m]"]
    assert [peak["order"] for peak in numbers["peaks"][:3]] == [1.0, 2.0, 3.0]
    assert "order resolution 0.236" in capsys.readouterr().out
    assert main(["orders", bag, "--signal", "needle"]) == 2
    assert main(["orders", bag, "--signal", "residual"]) == 2
