"""Acceleration with errors: least squares underestimates the inertia, instruments do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import healthy, torque_of
from tests.generators.planned_motion import run_up_and_down
from tests.generators.shaft_law import Friction
from textile_twin_core.comparison.identified_machine import Candidates
from textile_twin_core.comparison.instrumented_fit import InstrumentedFit, instrumented_fit
from textile_twin_core.comparison.repeating_motion import excess_of, repeating_motion
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import COULOMB, GAIN, ROTOR, VISCOUS
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.torque_model import TabulatedTorque

FORCE, FREE_FORCE = "loads.backing.force_N", "loads.backing.free_force_N"
FREE = (FORCE, FREE_FORCE, VISCOUS, COULOMB, ROTOR, GAIN)
AS_CONFIGURED = Hypothesis(1.0, 1.0)
TIME = np.arange(0.0, 40.0, 0.002)
ADDED = 0.004


def record(seed: int, errors: str) -> tuple[Measurement, ShaftTrack]:
    """Measurement of the tufting machine, and its motion for instruments."""
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
    known, slots = parameters(machine, WorkingPoint(30.0, 16.755, 0.006))
    samples = Record(TIME, torque, track, 20.0, 16.755, 0.5)
    whole = Measurement(samples, TabulatedTorque(machine, known, slots), known, 30.0)
    excess = excess_of(track, TIME, np.mod(theta + 3e-4 * rng.standard_normal(TIME.size), TURN), TURN)
    return Candidates(machine).measurement(whole, samples), repeating_motion(track, 1, 0.5, excess)


def inertia(fit: InstrumentedFit, m: Measurement) -> float:
    return float(fit.x[m.place[ROTOR]])


@pytest.mark.parametrize("errors", ["of each sample", "of every turn"])
def test_errors_of_the_acceleration_do_not_become_inertia(errors: str) -> None:
    m, steady = record(1, errors)
    least, fit = (instrumented_fit(m, AS_CONFIGURED, m.nominal, FREE, clean) for clean in (None, steady))
    sigma = float(np.sqrt(fit.uncertainty.covariance[fit.free.index(ROTOR), fit.free.index(ROTOR)]))
    assert abs(inertia(least, m) - ADDED) > 3.0 * sigma
    assert abs(inertia(fit, m) - ADDED) < 3.0 * sigma
    assert sigma < 1e-3


@pytest.mark.slow
@pytest.mark.campaign
def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    inside = []
    for seed in range(2, 14):
        m, steady = record(seed, "of each sample")
        fit = instrumented_fit(m, AS_CONFIGURED, m.nominal, FREE, steady)
        half = float(fit.uncertainty.half_width[fit.free.index(ROTOR)])
        inside.append(abs(inertia(fit, m) - ADDED) < half)
    assert sum(inside) >= 9


def test_a_parameter_that_cannot_be_negative_stops_at_zero() -> None:
    """Half a newton less than nothing above the backing."""
    m, steady = record(3, "none")
    slopes = m.expected(AS_CONFIGURED, m.nominal, slopes=True).slopes
    assert slopes is not None
    backing = healthy("tufting", 3).backing
    assert backing is not None
    less = m.record.torque_Nm - (backing.free_force_N + 0.5) * slopes[:, m.place[FREE_FORCE]]
    m = m.on(replace(m.record, torque_Nm=less))
    fit = instrumented_fit(m, AS_CONFIGURED, m.nominal, FREE, steady)
    assert fit.x[m.place[FREE_FORCE]] == 0.0
    assert inertia(fit, m) == pytest.approx(ADDED, abs=1.5e-3)


def test_without_a_whole_turn_the_motion_stays() -> None:
    track = ShaftTrack(TIME[:500], 0.5 * TIME[:500], np.full(500, 0.5), np.zeros(500), 0.01)
    assert repeating_motion(track, 1, 0.01) is track


@pytest.mark.parametrize("seed", range(2))
def test_useless_instruments_leave_least_squares(seed: int) -> None:
    """The motion of another record determines nothing."""
    m, _ = record(seed, "of each sample")
    track = m.record.motion
    assert isinstance(track, ShaftTrack)
    rng = np.random.default_rng([seed, 41])
    strange = replace(
        track, theta_rad=rng.permutation(track.theta_rad), alpha_rad_s2=100.0 * rng.standard_normal(track.time_s.size)
    )
    least, fit = (instrumented_fit(m, AS_CONFIGURED, m.nominal, FREE, clean) for clean in (None, strange))
    assert np.array_equal(fit.x, least.x)
