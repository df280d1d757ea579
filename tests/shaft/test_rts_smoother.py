"""The smoother against the joint distribution of all states, in 60 digits, around a long standstill."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from textile_twin_core.compiling import records
from textile_twin_core.shaft.rts_smoother import begin_at_state, filter_rows, new_smoother, smooth_back
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import ROW

COUNT = 24


def _rows(standstill_noise: float) -> Any:
    """Readings of a shaft that runs, stands and runs; at standstill they are far better, and some are missing."""
    rng = np.random.default_rng(5)
    rows = records(ROW, COUNT)
    rows["step"] = rng.uniform(0.5e-3, 2e-3, COUNT)
    rows["reading"] = np.cumsum(rng.normal(0.02, 0.02, COUNT))
    rows["noise"], rows["intensity"] = 1e-7, 1e9
    rows["noise"][8:16], rows["intensity"][8:16] = standstill_noise, 1e-3
    rows["reading"][8:16] = rows["reading"][8] + rng.normal(0.0, np.sqrt(standstill_noise), 8)
    rows["noise"][[5, 12, 20]] = 0.0
    rows["angle"] = rows["clock"] = rows["reading"]
    return rows


def _exact(rows: Any, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, 3) and covariances (n, 3, 3) of angle, speed, acceleration, all readings considered."""
    information, pull = mpmath.zeros(3 * COUNT), mpmath.zeros(3 * COUNT, 1)
    factor = mpmath.matrix([[start[8], start[7], start[5]], [0, start[6], start[4]], [0, 0, start[3]]])
    prior = (factor * factor.T) ** -1
    mean = mpmath.matrix([start[2], start[1], start[0]])
    _add(information, prior, 0, 0)
    for i in range(3):
        pull[i] += (prior * mean)[i]
    for k in range(1, COUNT):
        h, q = mpmath.mpf(float(rows["step"][k])), mpmath.mpf(float(rows["intensity"][k]))
        motion = mpmath.matrix([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]])
        jerk = q * mpmath.matrix(
            [[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]]
        )
        certain = jerk**-1
        _add(information, motion.T * certain * motion, 3 * k - 3, 3 * k - 3)
        _add(information, -motion.T * certain, 3 * k - 3, 3 * k)
        _add(information, -certain * motion, 3 * k, 3 * k - 3)
        _add(information, certain, 3 * k, 3 * k)
        if rows["noise"][k] > 0.0:
            information[3 * k, 3 * k] += 1 / mpmath.mpf(float(rows["noise"][k]))
            pull[3 * k] += mpmath.mpf(float(rows["reading"][k])) / mpmath.mpf(float(rows["noise"][k]))
    covariance = information**-1
    means = covariance * pull
    told = np.array([float(each) for each in means]).reshape(COUNT, 3)
    blocks = [[[float(covariance[3 * k + i, 3 * k + j]) for j in range(3)] for i in range(3)] for k in range(COUNT)]
    return told, np.array(blocks)


def _add(matrix: Any, block: Any, row: int, column: int) -> None:
    for i in range(3):
        for j in range(3):
            matrix[row + i, column + j] += block[i, j]


@pytest.mark.parametrize(("standstill_noise", "tolerance"), [(1e-7, 1e-11), (1e-17, 1e-4)])
def test_smoothed_states_and_covariances_are_those_of_the_joint_distribution(
    standstill_noise: float, tolerance: float
) -> None:
    """Errors in parts of a sigma. Where readings at standstill are 1e10 times as good, their own rounding counts."""
    rows = _rows(standstill_noise)
    smoother = new_smoother(ShaftSettings(), COUNT)
    start = smoother.filtered[0]
    start[3:] = 50.0, 0.1, 1e-4, 3.0, 1e-3, 1e-3
    bank = smoother.bank[0]
    begin_at_state(smoother, float(rows["reading"][0]), 15.0, 0.0, bank["models"]["second"])
    began = start.copy()
    filter_rows(smoother, rows)
    smooth_back(smoother, rows, 1, COUNT - 1)
    with mpmath.workdps(60):
        means, covariances = _exact(rows, began)
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    states = np.column_stack([rows["turns"] * 2.0 * np.pi + rows["phase"], rows["speed"], rows["acceleration"]])
    assert np.abs((states - means) / sigma)[1:].max() < tolerance
    covariance = rows["covariance"].reshape(-1, 3, 3)
    assert np.abs((covariance - covariances) / (sigma[:, :, None] * sigma[:, None, :]))[1:].max() < tolerance


def test_covariances_are_finite_and_positive_whatever_the_steps_noises_and_intensities() -> None:
    """Many decades of each, a third of the readings rejected: rounding destroys everything but the form."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        rows, smoother = _rows(1e-7), new_smoother(ShaftSettings(), COUNT)
        rows["step"], rows["intensity"] = 10.0 ** rng.uniform(-6, 3, COUNT), 10.0 ** rng.uniform(-40, 25, COUNT)
        rows["noise"] = 10.0 ** rng.uniform(-14, 0, COUNT) * (rng.uniform(size=COUNT) > 0.3)
        rows["unit"] = 1e-6
        smoother.filtered[0, 3:] = 10.0 ** rng.uniform(-6, 6, 6)
        begin_at_state(smoother, 0.0, 1.0, 0.0, smoother.bank[0]["models"]["second"])
        filter_rows(smoother, rows)
        smooth_back(smoother, rows, 1, COUNT - 1)
        assert np.all(np.isfinite(rows["covariance"][1:]))
        assert np.all(rows["covariance"][1:, ::4] > 0.0)
