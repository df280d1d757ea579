"""Pitch errors of a toothed wheel, estimated from a recording, also of a tooth whose readings the gate rejects."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN, make
from textile_twin_core.shaft import create_estimator

TEETH = 60
"""In a turn of `kinds.teeth`, the three that are missing counted."""


@pytest.mark.parametrize("seed", [0, 1, 3, 5, 6])
def test_pitch_errors_are_learnt_in_all_orders_that_motion_has_little_of(seed: int) -> None:
    """The readings do not assign the first orders, a quarter of the errors' variance, to wheel or motion."""
    record = make("pitch", seed)
    estimator = create_estimator("smooth", cycle_turns=2, teeth=TEETH)
    estimator.step(record.time_s, record.angle_rad)
    estimator.finish()
    tooth = np.rint(record.angle_rad / TURN * TEETH).astype(int) % TEETH
    there = np.arange(57)
    truth = np.array([np.mean((record.theta - record.angle_rad)[tooth == one]) for one in there])
    left = np.array(estimator.report.pitch_errors_rad)[there] - truth
    left, truth = left - left.mean(), truth - truth.mean()
    assert left.std() < 0.55 * truth.std()
    waves = np.exp(1j * np.outer(np.arange(7, 28), there * TURN / TEETH))
    high, errors = np.abs(waves @ left), np.abs(waves @ truth)
    assert np.sqrt(np.mean(high**2)) < 0.25 * np.sqrt(np.mean(errors**2))


@pytest.mark.parametrize(("view", "most"), [("causal", 0.1), ("smooth", 0.02)])
@pytest.mark.parametrize("seed", range(2))
def test_a_steady_wheel_with_unconfigured_errors_shows_no_acceleration(seed: int, view: str, most: float) -> None:
    """Errors of 0.03 mrad; counted as ripple they are 9 rad/s^2 and more. The shaft's own acceleration is 0.09."""
    rng, teeth = np.random.default_rng(seed), 60
    errors, time = rng.normal(0.0, 3e-5, teeth), np.linspace(0.0, 15.0, 1_500_001)
    theta = 100.0 * time + 0.1 / 1.3 * (1.0 - np.cos(1.3 * time))
    edge = np.arange(1, int(theta[-1] / TURN * teeth))
    stamps = np.interp(edge * TURN / teeth + errors[edge % teeth], theta, time) + rng.normal(0.0, 1e-7, edge.size)
    estimator = create_estimator(view)
    states = [estimator.step(stamps, edge * TURN / teeth), estimator.finish()][view == "smooth"]
    late = states.index > 6000
    off = states.alpha_rad_s2[late] - 0.13 * np.cos(1.3 * stamps[states.index[late]])
    assert np.sqrt(np.mean(off**2)) < most


def test_the_reported_ripple_is_the_shafts() -> None:
    """Beside that of the same shaft on a wheel without pitch errors, in the orders of the turn; taken whole: 0.0012."""
    off = []
    for seed in (0, 1, 3, 5, 6):
        truth, stated, unknown = (
            _ripple(kind, seed, teeth)[1::2] for kind, teeth in (("teeth", 0), ("pitch", TEETH), ("pitch", 0))
        )
        off.append([np.sqrt(np.mean((found - truth) ** 2)) for found in (stated, unknown)])
    assert np.all(np.median(off, axis=0) < 0.0009)


def _ripple(kind: str, seed: int, teeth: int) -> np.ndarray:
    record, estimator = make(kind, seed), create_estimator("smooth", cycle_turns=2, teeth=teeth)
    estimator.step(record.time_s, record.angle_rad)
    estimator.finish()
    return np.array(estimator.report.ripple)


@pytest.mark.parametrize("turns", [0, 150])
@pytest.mark.parametrize("cycle_turns", [1, 2])
@pytest.mark.parametrize("teeth", [3, 4, 7, 9, 12])
def test_a_wheel_of_few_teeth_has_too_few_orders_to_know_its_own_by(teeth: int, cycle_turns: int, turns: int) -> None:
    angles = np.arange(teeth * turns) * TURN / teeth
    estimator = create_estimator("smooth", teeth=teeth, cycle_turns=cycle_turns)
    estimator.step((angles + 0.05 * np.sin(angles)) / 50.0, angles)
    states = estimator.finish()
    assert np.isfinite(states.alpha_rad_s2).all() and np.isfinite(estimator.report.pitch_errors_rad).all()
    assert len(states) == max(angles.size - 2, 0)


@pytest.mark.parametrize("kind", ["teeth", "teeth+1%"])
def test_smooth_learns_the_teeth(kind: str) -> None:
    """But for orders of the turn that the motion has too, 0 to 6; one tooth stands wrong by 0.8 degrees."""
    rng, record = np.random.default_rng(4), make(kind, 4)
    clean = make("teeth", 4).angle_rad
    tooth = np.rint((clean - clean[0]) / TURN * TEETH).astype(int) % TEETH
    there = np.unique(tooth)
    errors = np.deg2rad(rng.normal(0.0, 0.04, TEETH))
    errors[there[30]] = np.deg2rad(0.8)
    estimator = create_estimator("smooth", teeth=TEETH, tooth_zero_rad=float(clean[0]), cycle_turns=2)
    estimator.step(record.time_s, record.angle_rad - errors[tooth])
    estimator.finish()
    off = np.array(estimator.report.pitch_errors_rad)[there] - errors[there]
    waves = np.outer(there * TURN / TEETH, np.arange(7))
    shared = np.concatenate([np.cos(waves), np.sin(waves[:, 1:])], axis=1)
    off -= shared @ np.linalg.lstsq(shared, off, rcond=None)[0]
    assert np.rad2deg(np.abs(off).max()) < 0.1
    assert np.rad2deg(np.sqrt(np.mean(off**2))) < 0.03
