"""Block averages with triangular weights: that of an acceleration is a second difference of the angle."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.dynamics import Body
from textile_twin_core.inference import blocks
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.torque_model import TabulatedTorque
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import Crank

WIDTH_S = 0.05


def test_the_mean_of_an_acceleration_is_a_second_difference_of_the_angle() -> None:
    time = np.arange(0.0, 2.0, 1e-4)
    alpha = -81.0 * np.sin(9.0 * time + 0.3)
    found, whole = blocks.means(time / WIDTH_S, alpha[:, None], np.ones(time.size, np.bool_))
    nodes = WIDTH_S * np.arange(found.shape[0])
    angle = np.sin(9.0 * (nodes[:, None] + WIDTH_S * np.array([-1.0, 0.0, 1.0])) + 0.3)
    expected = (angle[:, 0] - 2.0 * angle[:, 1] + angle[:, 2]) / WIDTH_S**2
    assert np.flatnonzero(~whole).tolist() == [0, found.shape[0] - 1]  # half a triangle at either end
    assert found[whole, 0] == pytest.approx(expected[whole], abs=0.05)


def test_the_torque_of_a_flywheel_is_right_where_a_load_steps_and_no_acceleration_is_known() -> None:
    """Acceleration +-40 rad/s2 that changes sign every 0.1525 s, between two samples; the track has none at all."""
    inertia, half = 2.0, 0.1525
    time = np.arange(0.0, 4.0, 0.005)
    along, there = np.mod(time, 2.0 * half), np.mod(time, 2.0 * half) < half
    omega = 30.0 + 40.0 * np.where(there, along, 2.0 * half - along)

    def theta(t: FloatArray) -> FloatArray:
        cycle, rest = np.divmod(t, 2.0 * half)
        back = np.maximum(rest - half, 0.0)
        rising = 20.0 * np.minimum(rest, half) ** 2
        return np.asarray(30.0 * t + cycle * 40.0 * half**2 + rising + 40.0 * half * back - 20.0 * back**2)

    crank = Crank("crank", "O", "A", 0.05)
    machine = Machine("rotor", {"O": (0.0, 0.0)}, (crank,), (Body.flywheel(inertia),))
    known, slots = parameters(machine, WorkingPoint(80.0, 33.0, 0.01))
    track = ShaftTrack(time, theta(time), omega, np.zeros_like(time), 0.05)
    record = Record(time, np.zeros_like(time), track, 2.0, 33.0, 0.5, block_s=WIDTH_S)
    m = Measurement(record, TabulatedTorque(machine, known, slots), known, 80.0)
    found = m.expected(Hypothesis(1.0, 1.0), m.nominal)
    averages, whole = m.means(found.torque_Nm[:, None], found.good)
    nodes = WIDTH_S * np.arange(averages.shape[0])
    expected = inertia * (theta(nodes + WIDTH_S) - 2.0 * theta(nodes) + theta(nodes - WIDTH_S)) / WIDTH_S**2
    assert np.count_nonzero(whole) > 70
    assert averages[whole, 0][1:-1] == pytest.approx(expected[whole][1:-1], abs=1e-6)


def test_a_block_of_which_samples_are_missing_does_not_count() -> None:
    time = np.arange(0.0, 2.0, 1e-3)
    good = (time < 0.98) | (time > 1.06)
    found, whole = blocks.means(time / WIDTH_S, np.where(good, 1.0, np.nan)[:, None], good)
    assert whole[2:18].all() and not whole[20:22].any() and whole[24:38].all()
    assert found[whole, 0] == pytest.approx(1.0)


@pytest.mark.parametrize("most", [2000, 8000])
def test_fewer_samples_fill_blocks(most: int) -> None:
    taken = blocks.fewer(100_000, 40.0, most)
    assert 0.9 * most - 240 < taken.size <= most and taken[-1] < 100_000
    assert np.median(np.diff(taken)) == 4.0
    assert blocks.fewer(100, 5.0, most).tolist() == list(range(100))


def test_averages_of_white_noise_scatter_together_by_their_overlap() -> None:
    time = np.arange(0.0, 2000.0, 1e-2)
    noise = np.random.default_rng(3).standard_normal((time.size, 1))
    found, whole = blocks.means(time / 0.1, noise, np.ones(time.size, np.bool_))
    sums = found[whole, 0][:19900].reshape(-1, 100).sum(1)
    assert np.var(sums) / (100.0 * np.var(found[whole])) == pytest.approx(1.0 + blocks.OVERLAP, rel=0.25)
