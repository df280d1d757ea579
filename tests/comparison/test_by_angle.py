"""Bins of the shaft angle: blocks of any size give the bins of the whole, to rounding, also far from zero."""

from __future__ import annotations

import numpy as np

from textile_twin_core.comparison import RunningAngleBins


def test_blocks_together_give_the_statistics_of_the_whole() -> None:
    rng = np.random.default_rng(5)
    theta = rng.uniform(-40.0, 90.0, 20_000)
    residual = 1e6 + rng.normal(0.0, 1e-3, theta.size)  # a large mean would cancel in a sum of squares
    running = RunningAngleBins(36)
    for block in np.split(np.arange(theta.size), np.sort(rng.integers(0, theta.size, 50))):
        running.add(theta[block], residual[block])
    bins = running.bins()
    place = np.floor(np.mod(theta, 2 * np.pi) / (2 * np.pi / 36)).astype(int)
    for k in range(36):
        mine = residual[place == k]
        assert bins.count[k] == mine.size
        assert abs(bins.mean_Nm[k] - mine.mean()) < 1e-9
        assert abs(bins.std_Nm[k] - mine.std()) < 1e-8
        assert (bins.min_Nm[k], bins.max_Nm[k]) == (mine.min(), mine.max())


def test_bins_without_samples_say_so() -> None:
    running = RunningAngleBins(4)
    running.add(np.array([0.1, 0.2]), np.array([1.0, 3.0]))
    bins = running.bins()
    assert bins.count.tolist() == [2, 0, 0, 0]
    assert bins.mean_Nm[0] == 2.0
    assert bins.std_Nm[0] == 1.0
    assert np.isnan(bins.mean_Nm[1:]).all()
    assert np.isnan(bins.max_Nm[1:]).all()
