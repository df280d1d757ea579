"""Acceleration with errors: least squares underestimates the inertia, instruments do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import healthy, torque_of
from tests.generators.planned_motion import run_up_and_down
from tests.generators.shaft_law import Friction
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.repeating_motion import excess_of, repeating_motion
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.comparison.smooth_fit import SmoothFit, instrumented_fit, least_squares_fit
from textile_twin_core.comparison.torque_model import GAIN, INERTIA, TorqueModel
from textile_twin_core.comparison.torque_terms import TorqueTerms
from textile_twin_core.comparison.uncertainty import uncertainty_by_turns

FREE = ("backing_force_N", "free_force_N", "shaft_viscous_Nms", "shaft_coulomb_Nm", INERTIA, GAIN)
TIME = np.arange(0.0, 40.0, 0.002)
ADDED = 0.004


def record(seed: int, errors: str) -> tuple[TorqueModel, ShaftTrack, dict[str, float], np.ndarray]:
    """Model of the tufting machine, its motion for instruments, start values, and the samples to use."""
    rng = np.random.default_rng([seed, 40])
    case = replace(healthy("tufting", seed), friction=Friction(0.05, 0.3), added_inertia_kgm2=ADDED)
    theta, omega, alpha = run_up_and_down(40.0, 16.755, rng).at(TIME)
    torque = torque_of(case, theta, omega, alpha) + 0.08 * rng.standard_normal(TIME.size)
    off, off1, off2 = np.zeros((3, TIME.size))
    if errors == "of each sample":
        off2 = 1.5 * rng.standard_normal(TIME.size)
    elif errors == "of every turn":  # high orders of an estimated ripple, wrong throughout
        wave = 1.5e-4 * np.exp(9.0j * theta)
        off, off1, off2 = wave.real, (9.0j * wave).real * omega, (-81.0 * wave).real * omega**2
    track = ShaftTrack(TIME, theta + off, omega + off1, alpha + off2, 0.01)
    machine = configured_machine(case)
    evidence = Evidence(TIME, torque, track, TorqueTerms(machine), 20.0)
    model = TorqueModel(evidence, machine, 1, 0.002)
    excess = excess_of(track, TIME, np.mod(theta + 3e-4 * rng.standard_normal(TIME.size), TURN), TURN)
    steady = repeating_motion(track, 1, evidence.slow_rad_s, excess)
    values = model.start()
    away = ~model.near_event(theta, values, 0.02)
    return model, steady, values, away


def fitted(seed: int, errors: str) -> tuple[float, SmoothFit, TorqueModel]:
    """Inertia by least squares, and the fit by instruments."""
    model, steady, values, away = record(seed, errors)
    least = least_squares_fit(model, values, FREE, away, 10)
    return least[INERTIA], instrumented_fit(model, steady, least, FREE, away), model


@pytest.mark.parametrize("errors", ["of each sample", "of every turn"])
def test_errors_of_the_acceleration_do_not_become_inertia(errors: str) -> None:
    least, fit, model = fitted(1, errors)
    turn = model.turn(fit.values)[fit.good]
    known = uncertainty_by_turns(fit.slopes, fit.residual, turn, fit.instruments)
    found = known.estimate(FREE.index(INERTIA), fit.values[INERTIA])
    assert abs(least - ADDED) > 4.0 * found.sigma
    assert abs(found.value - ADDED) < 3.0 * found.sigma
    assert found.sigma < 5e-4


@pytest.mark.slow
@pytest.mark.campaign
def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    inside = []
    for seed in range(2, 14):
        _, fit, model = fitted(seed, "of each sample")
        known = uncertainty_by_turns(fit.slopes, fit.residual, model.turn(fit.values)[fit.good], fit.instruments)
        low, high = known.estimate(FREE.index(INERTIA), fit.values[INERTIA]).interval95
        inside.append(low < ADDED < high)
    assert sum(inside) >= 9


def test_a_parameter_that_cannot_be_negative_stops_at_zero() -> None:
    model, steady, values, away = record(3, "none")
    values = values | {"free_force_N": 3.0}
    torque = model.evidence.torque_Nm - 0.5 * model.parts(values).per_unit["free_force_N"]
    evidence = replace(model.evidence, torque_Nm=torque)
    fit = instrumented_fit(model.with_evidence(evidence), steady, values, FREE, away)
    assert fit.values["free_force_N"] == 0.0
    assert fit.values[INERTIA] == pytest.approx(ADDED, abs=1.5e-3)


def test_without_a_whole_turn_the_motion_stays() -> None:
    track = ShaftTrack(TIME[:500], 0.5 * TIME[:500], np.full(500, 0.5), np.zeros(500), 0.01)
    assert repeating_motion(track, 1, 0.01) is track


@pytest.mark.parametrize("seed", range(4))
def test_useless_instruments_leave_least_squares(seed: int) -> None:
    """The steps would diverge on the motion of another record: the values of least squares stay."""
    model, _, values, away = record(seed, "of each sample")
    least = least_squares_fit(model, values, FREE, away, 10)
    rng = np.random.default_rng([seed, 41])
    track = model.evidence.track
    strange = replace(
        track, theta_rad=rng.permutation(track.theta_rad), alpha_rad_s2=100.0 * rng.standard_normal(track.time_s.size)
    )
    fit = instrumented_fit(model, strange, least, FREE, away)
    before = np.std((model.evidence.torque_Nm - model.expected(least))[fit.good])
    assert np.std(fit.residual) < 2.0 * before
