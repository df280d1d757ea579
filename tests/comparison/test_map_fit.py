"""Fits of one record: weight of the readings at standstill, and independence of the order of calls."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import healthy, torque_of
from tests.generators.planned_motion import run_up_and_down
from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.inference.chain import torque_filter
from textile_twin_core.inference.map_fit import Fit, map_fit
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import BUTTERWORTH, COULOMB, DELAY, GAIN, HELD, HIGH_PASS, LOW_PASS, OFFSET
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.inference.record import Record, Standstill
from textile_twin_core.inference.robust import rounding_bias
from textile_twin_core.inference.torque_model import TabulatedTorque
from textile_twin_core.machine.slots import changed

AS_CONFIGURED = Hypothesis(1.0, 1.0)
TIME = np.arange(0.0, 40.0, 0.01)
STANDING_NM = 0.05
LENGTH = "groups.l3.length_m"


def measured(error_Nm: FloatArray | float = 0.0, standstills: int = 0) -> Measurement:
    """Measurement of a loom, whose torque is off by an error; at standstill only by independent noise."""
    rng = np.random.default_rng(7)
    case = healthy("loom", 7)
    theta, omega, alpha = run_up_and_down(40.0, 16.0, rng).at(TIME)
    torque = torque_of(case, theta, omega, alpha)
    rest = torque_of(case, theta[:1], np.zeros(1), np.zeros(1))
    machine = configured_machine(case)
    known, slots = parameters(machine, WorkingPoint(float(np.percentile(np.abs(torque), 95.0)), 16.0, 0.01))
    still = [Standstill(0.0, float(rest[0] + STANDING_NM * each), STANDING_NM) for each in rng.normal(size=standstills)]
    track = ShaftTrack(TIME, theta, omega, alpha, 0.05)
    samples = Record(TIME, torque + error_Nm + 0.05 * rng.normal(size=TIME.size), track, 20.0, 16.0, 0.5, tuple(still))
    return Measurement(samples, TabulatedTorque(machine, known, slots), known, 10.0)


def test_readings_at_standstill_weigh_the_same_whether_the_inflation_is_known_or_estimated() -> None:
    """Errors of whole turns inflate the residuals; readings at standstill have their own standard deviation."""
    m = measured(0.3 * np.sin(0.8 * TIME), standstills=40)
    there = map_fit(m, AS_CONFIGURED, m.nominal, (OFFSET, GAIN)).x
    first = map_fit(m, AS_CONFIGURED, there, (OFFSET, GAIN), iterations=0)
    assert first.inflation > 5.0
    known = {"inflation": first.inflation, "scale": first.scale}
    again = map_fit(m, AS_CONFIGURED, there, (OFFSET, GAIN), iterations=0, **known)
    np.testing.assert_allclose(first.information, again.information, rtol=1e-12)
    np.testing.assert_allclose(first.gradient, again.gradient, rtol=1e-12, atol=1e-12 * np.abs(again.gradient).max())
    np.testing.assert_allclose(first.covariance, again.covariance, rtol=1e-9)


def test_a_trial_in_which_no_sample_is_known_gives_no_warning() -> None:
    m = measured()
    x = m.nominal.copy()
    x[m.place[DELAY]] = 1e3  # behind the end of the record
    seen = m.expected(AS_CONFIGURED, x)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        error, scale = m.error(seen)
    assert not seen.good.any() and error.shape == TIME.shape and 0.0 <= scale < 1e-200


@pytest.mark.parametrize("noise", [0.05, 0.16, 0.4])
def test_the_mean_error_of_rounded_readings_is_that_of_their_probabilities(noise: float) -> None:
    step, one = 0.5, 0.2
    torque = np.linspace(-1.4, 1.4, 57) + 1e-3
    values = one + step * np.arange(-12, 13)
    edges = np.append(values - 0.5 * step, np.inf)
    probability = np.diff(scipy.stats.norm.cdf((edges - torque[:, None]) / (noise * step)), axis=1)
    scale = step * np.sqrt(noise**2 + 1.0 / 12.0)
    bias = rounding_bias(torque, one, step, scale)
    exact = probability @ values - torque
    # three waves of it, of which more remain the less the noise
    assert np.sqrt(np.mean((bias - exact) ** 2)) < step * (0.02 if noise < 0.1 else 2e-3)


def test_rounded_readings_of_a_turn_that_repeats_are_no_independent_noise() -> None:
    """Rounding follows the torque, so it repeats in every turn: unmodelled, it inflates the residuals."""
    plain = measured()
    record = plain.record
    stepped = replace(record, torque_Nm=np.rint(record.torque_Nm / 0.5) * 0.5)
    blind = map_fit(plain.on(stepped), AS_CONFIGURED, plain.nominal, ())
    known = map_fit(plain.on(replace(stepped, step_Nm=0.5)), AS_CONFIGURED, plain.nominal, ())
    exact = map_fit(plain, AS_CONFIGURED, plain.nominal, ())
    k = plain.place[GAIN]
    assert known.rms < 0.8 * blind.rms
    assert known.inflation < 1.2 < 1.8 < blind.inflation
    assert abs(known.x - exact.x)[k] < 0.2 * abs(blind.x - exact.x)[k]


def test_values_beside_a_bound_are_the_best_that_the_bound_allows() -> None:
    """An offset against dry friction of at least zero, both beside readings at standstill, which know their sum."""
    m = measured(np.where(TIME > 0.0, -4.0, 0.0), standstills=3)
    off_nominal = (OFFSET, COULOMB, HELD)
    fit = map_fit(m, AS_CONFIGURED, m.nominal, off_nominal)
    friction = m.place[COULOMB]
    assert fit.x[friction] == 0.0
    others = [name for name in m.names if name != COULOMB]
    best = map_fit(m, AS_CONFIGURED, fit.x, off_nominal, free=others, iterations=60)
    sigma = np.sqrt(np.diag(best.covariance))
    assert np.all(np.abs(fit.x - best.x) < 0.1 * sigma)
    assert fit.rms < 1.01 * best.rms


def test_a_high_pass_enters_each_run_in_a_state_of_its_own() -> None:
    """Three runs of a constant speed behind an amplifier that blocks the mean, of which half has not settled."""
    fine = np.arange(0.0, 40.0, 1e-3)
    case = healthy("loom", 7)
    b, a, _ = scipy.signal.cont2discrete((np.array([1.0, 0.0]), np.array([1.0, 2.0 * np.pi * 0.2])), 1e-3, "foh")
    turning = 16.0 * fine, np.full(fine.size, 16.0), np.zeros(fine.size)
    torque = scipy.signal.lfilter(np.ravel(b), a, torque_of(case, *turning))
    m = measured()
    inside = (TIME < 3.0) | ((TIME > 14.0) & (TIME < 17.0)) | ((TIME > 30.0) & (TIME < 33.0))
    track = ShaftTrack(TIME, 16.0 * TIME, np.full(TIME.size, 16.0), np.zeros(TIME.size), 0.05)
    shown = torque[:: fine.size // TIME.size] + 0.05 * np.random.default_rng(8).normal(size=TIME.size)
    m = m.on(replace(m.record, time_s=TIME[inside], torque_Nm=shown[inside], motion=track)).with_starts()
    x = m.nominal.copy()
    x[m.place[HIGH_PASS]] = 0.4
    fit = map_fit(m, replace(AS_CONFIGURED, filters=frozenset({HIGH_PASS})), x, (HIGH_PASS,), iterations=25)
    k = m.place[HIGH_PASS]
    assert abs(fit.x[k] - 0.2) < 3.0 * np.sqrt(fit.covariance[k, k]) < 0.03
    assert fit.count > 0.9 * np.count_nonzero(inside) and fit.rms < 1.1 * 0.05


def test_a_fit_does_not_depend_on_fits_made_before_it() -> None:
    """Other values of the machine's numbers were fitted with the same model in between."""
    m = measured()
    place = m.place[LENGTH]
    away = m.nominal.copy()
    away[place] += 3.0 * m.parameters[place].departure

    def found(fit: Fit) -> list[FloatArray]:
        return [fit.x, fit.covariance, m.expected(AS_CONFIGURED, fit.x).torque_Nm, m.residual(AS_CONFIGURED, fit.x)[0]]

    first = map_fit(m, AS_CONFIGURED, m.nominal, (LENGTH,), relinearise=True)
    before = found(first)
    map_fit(m, AS_CONFIGURED, away, (LENGTH,), iterations=0, relinearise=True)
    after = found(first)
    again = map_fit(m, AS_CONFIGURED, m.nominal, (LENGTH,), relinearise=True)
    for one, other, later in zip(before, after, found(again), strict=True):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one, later)


@pytest.mark.parametrize("share", [0.4, 3.0])
def test_a_model_is_right_about_the_values_of_its_linearisation(share: float) -> None:
    """It agrees with the model of the machine that has this length."""
    m = measured()
    x = m.nominal.copy()
    x[m.place[LENGTH]] += share * m.parameters[m.place[LENGTH]].departure
    changes = changed(m.model.machine, {m.model.slot_name(LENGTH): float(x[m.place[LENGTH]])})
    known, slots = parameters(replace(m.model.machine, **changes), WorkingPoint(10.0, 16.0, 0.01))
    other = TabulatedTorque(replace(m.model.machine, **changes), known, slots)
    truth = Measurement(m.record, other, known, 10.0).expected(AS_CONFIGURED, np.array([p.nominal for p in known]))
    size = float(np.abs(truth.torque_Nm).max())
    shown = m.linearised(x, (LENGTH,)).expected(AS_CONFIGURED, x)
    np.testing.assert_allclose(shown.torque_Nm, truth.torque_Nm, atol=1e-4 * size)


@pytest.mark.parametrize(("low_pass", "value"), [(LOW_PASS, 0.08), (BUTTERWORTH, 0.08)])
def test_a_search_may_try_a_high_pass_above_the_low_pass(low_pass: str, value: float) -> None:
    """No sensor has one: its corner is taken just below that of the low pass, and every other value is kept."""
    none = dict.fromkeys((LOW_PASS, BUTTERWORTH, HIGH_PASS), 0.0)
    corner = 1.0 / (2.0 * np.pi * value)
    found = torque_filter({**none, low_pass: value, HIGH_PASS: 3.4})
    assert 0.5 * corner < found.high_pass_hz < corner
    assert torque_filter({**none, low_pass: value, HIGH_PASS: 0.3}).high_pass_hz == 0.3
    assert torque_filter({**none, HIGH_PASS: 3.4}).high_pass_hz == 3.4
