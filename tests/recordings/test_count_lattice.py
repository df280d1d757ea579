"""Counts of an encoder behind readings that a log has rounded to decimals, and the acceleration from such readings."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.arrays import FloatArray
from textile_twin_core.recordings.count_lattice import count_lattice
from textile_twin_core.shaft import create_estimator

TURN = 2.0 * np.pi
UNITS = {"degrees": 360.0, "turns": 1.0, "gon": 400.0, "radians": TURN}
COUNTS = (1000, 1024, 2500, 3600, 4096, 5000, 8192, 10000, 16384, 65536)


def motion(speed: float, samples: int, rate: float = 500.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times [s], angle [rad] and acceleration [rad/s^2] of a shaft whose speed ripples by 2 per cent."""
    t = np.arange(samples) / rate
    theta = speed * t + 0.02 * np.sin(speed * t + 0.7) + 0.006 * np.sin(2.0 * speed * t)
    return t, theta, -(speed**2) * (0.02 * np.sin(speed * t + 0.7) + 0.024 * np.sin(2.0 * speed * t))


def logged(theta: FloatArray, counts: int, turn: float, decimals: int, wrapped: bool = True) -> FloatArray:
    """Angles [rad] as a log has them: counts of the encoder (0: none) in a unit, rounded to decimals."""
    turns = np.rint(theta / TURN * counts) / counts if counts else theta / TURN
    turns = np.mod(turns, 1.0) if wrapped else turns
    return np.asarray(np.round(turns * turn, decimals) / turn * TURN)


def is_shown(counts: int, turn: float, decimals: int) -> bool:
    """Return whether rounding leaves the counts visible: less than two thirds of a count, and not the count itself."""
    unit, count = 10.0**-decimals, turn / counts
    finer = 1 if turn == TURN else 10**7
    whole = abs(count * finer - round(count * finer)) < 1e-9 and round(count * finer) in [10**k for k in range(8)]
    return unit < 0.66 * count and not whole


@pytest.mark.parametrize("counts", COUNTS)
@pytest.mark.parametrize("unit", UNITS)
def test_counts_are_estimated(counts: int, unit: str) -> None:
    turn = UNITS[unit]
    for decimals, (speed, wrapped) in zip(
        (2, 3, 4, 5, 6), ((6.0, True), (60.0, True), (13.7, False)) * 2, strict=False
    ):
        angle = logged(motion(speed, 768)[1], counts, turn, decimals, wrapped)
        found = count_lattice(np.unwrap(angle), turn)
        shown = is_shown(counts, turn, decimals)
        assert (found.counts if found else None) == (counts if shown else None), (decimals, speed)
        if found is not None:
            off = found.restored(angle) - logged(motion(speed, 768)[1], counts, 1.0, 15, wrapped)
            off = np.mod(off - off[0] + np.pi, TURN) - np.pi
            assert np.abs(off).max() < 1e-9, (decimals, speed)  # every reading, beside a common offset


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("decimals", [2, 3, 4, 5, 6])
def test_unrounded_readings_have_no_counts(unit: str, decimals: int) -> None:
    for speed in (6.0, 13.7, 60.0, TURN * 500.0 / 125.0):  # the last has 125 readings a turn
        angle = logged(motion(speed, 768)[1], 0, UNITS[unit], decimals)
        assert count_lattice(np.unwrap(angle), UNITS[unit]) is None
    even = np.round(np.mod(0.032 * np.arange(2000) / TURN * UNITS[unit], UNITS[unit]), decimals)
    assert count_lattice(np.unwrap(even / UNITS[unit] * TURN), UNITS[unit]) is None


@pytest.mark.parametrize("unit", UNITS)
def test_restored_readings_give_the_acceleration_of_unrounded_ones(unit: str) -> None:
    time, theta, truth = motion(13.7, 2000)
    own = logged(theta, 3600, 1.0, 15)
    rounded = logged(theta, 3600, UNITS[unit], 4)
    found = count_lattice(np.unwrap(rounded), UNITS[unit])
    readings = rounded if found is None else found.restored(rounded)  # 0.1 degree is a count of itself
    assert _error(time, readings, truth) < 1.001 * _error(time, own, truth)


def _error(time: FloatArray, angle: FloatArray, truth: FloatArray) -> float:
    """RMS error of the smooth acceleration [rad/s^2], without the ends."""
    estimator = create_estimator("smooth")
    stamps = 10**9 + np.rint(time * 1e9).astype(np.int64)
    parts = [estimator.step(stamps, angle), estimator.finish()]
    alpha = np.concatenate([part.alpha_rad_s2 for part in parts])
    place = np.searchsorted(stamps, np.concatenate([part.stamps for part in parts]))
    inner = (place > 200) & (place < time.size - 200)
    return float(np.sqrt(np.mean((alpha - truth[place])[inner] ** 2)))
