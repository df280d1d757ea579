"""Inertia on the shaft that the machine file lacks: named as such, without a false cause at a sensor."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case, healthy, record
from tests.generators.shaft_law import Backing
from tests.generators.speed_controlled_motion import speed_controlled_motion
from textile_twin_core.comparison import Assessment, Readings, assess, calibrate, identify
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.dynamics import Body
from textile_twin_core.inference.parameter import DELAY, ROTOR
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.inference.torque_model import TabulatedTorque

SECONDS = 14.0
ADDED_KGM2 = 0.05
"""Eight times the tufting machine's own inertia, three times the loom's largest."""


def heavier(machine: str, duration_s: float = SECONDS) -> Case:
    return healthy(machine, 1, duration_s=duration_s, added_inertia_kgm2=ADDED_KGM2)


def planned(case: Case) -> Readings:
    made = record(case)
    return Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)


def speed_controlled(
    case: Case,
    gain_Nms: float,
    late_s: float = 0.0,
    speeds: tuple[float, float] = (9.0, 14.0),
    jitter_s: float = 3e-5,
) -> Readings:
    """13 bits and torque at 1 kHz; noise of 0.05 N m."""
    fine, angle, _, torque = speed_controlled_motion(case, gain_Nms, speeds)
    rng = np.random.default_rng([1, 13])
    time, step = np.arange(0.1, case.duration_s - 0.1, 0.001), 2.0 * np.pi / 2**13
    true = time + jitter_s * rng.standard_normal(time.size)
    stamps = np.rint(time * 1e9).astype(np.int64)
    read = np.rint(np.interp(true, fine, angle) / step) * step
    shown = np.interp(true - late_s, fine, torque) + 0.05 * rng.standard_normal(time.size)
    return Readings(stamps, read, stamps, shown)


def inertia(found: Assessment) -> float:
    cause = found.verdict[0]
    assert cause.cause == "unmodelled_inertia" and isinstance(cause.value, float)
    return cause.value


@pytest.mark.parametrize(("machine", "duration_s"), [("tufting", SECONDS), *more(("loom", 24.0))])
def test_in_a_run_up_it_is_the_only_cause_with_its_number(machine: str, duration_s: float) -> None:
    case = heavier(machine, duration_s)
    found = assess(planned(case), configured_machine(case))
    assert inertia(found) == pytest.approx(ADDED_KGM2, rel=0.02)
    assert len(found.verdict) == 1 and found.explained > 0.998


def test_it_changes_no_gain_of_the_torque_sensor() -> None:
    found = calibrate(planned(heavier("tufting")), configured_machine(heavier("tufting")))
    assert found.gain.value == pytest.approx(1.0, abs=4.0 * found.gain.sigma) and found.gain.sigma < 0.02
    exact = found.given_file["torque.gain"]
    assert exact.value == pytest.approx(1.0, abs=4.0 * exact.sigma) and exact.sigma < 0.01
    assert abs(found.delay_s.value) < 2e-4


@pytest.mark.slow
@pytest.mark.parametrize("machine", ["loom", *more("tufting")])
def test_under_a_controller_of_the_speed_it_is_no_delay(machine: str) -> None:
    """The torque then looks 25 ms late, and the sign of a tufting machine was estimated reversed."""
    case = heavier(machine)
    readings = speed_controlled(case, 2.0)
    found = assess(readings, configured_machine(case))
    assert inertia(found) == pytest.approx(ADDED_KGM2, rel=0.04)
    assert {each.cause for each in found.verdict} <= {"unmodelled_inertia", "clocks_drift"}
    settled = calibrate(readings, configured_machine(case))
    assert settled.delay_s.value == 0.0 and settled.gain.value == pytest.approx(1.0, abs=0.05)
    assert any("inertia" in each.between for each in settled.ambiguous)
    identified = identify(readings, configured_machine(case))
    assert identified.parameters["added_inertia_kgm2"].value == pytest.approx(ADDED_KGM2, rel=0.04)
    lost = {each.name: each.text for each in identified.not_identifiable}
    assert "follows the speed" in lost["torque_sensor_delay_s"]


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize("gain_Nms", [40.0, *more(2.0)])
def test_thirty_times_the_own_inertia_is_found_at_discontinuous_accelerations(gain_Nms: float) -> None:
    """Errors of the estimated acceleration, as torque, exceeded the whole variation of the machine's torque."""
    case = replace(heavier("tufting", 24.0), added_inertia_kgm2=0.2)
    found = assess(speed_controlled(case, gain_Nms), configured_machine(case))
    (cause,) = found.verdict
    assert inertia(found) == pytest.approx(0.2, abs=3.0 * cause.sigma)
    assert cause.sigma < (0.005 if gain_Nms > 2.0 else 0.01) and "for each ms" in cause.text


@pytest.mark.campaign
@pytest.mark.slow
def test_beside_a_reversed_sign_both_are_named() -> None:
    """A gain, the loads, friction and a zero of 144 degrees explain nearly as much of such a torque."""
    case = heavier("tufting")
    readings = speed_controlled(case, 2.0)
    sign, added = assess(replace(readings, torque=-readings.torque), configured_machine(case)).verdict
    assert (sign.cause, added.cause) == ("torque_sign", "unmodelled_inertia")
    assert added.value == pytest.approx(ADDED_KGM2, rel=0.02)


@pytest.mark.slow
def test_behind_a_flywheel_that_the_file_has_a_wrong_force_is_named_with_its_value() -> None:
    """The encoder does not show the ripple of the speed, whose torque is thirty times what stays unexplained."""
    case = replace(heavier("tufting"), added_inertia_kgm2=0.2, backing=Backing(force_N=1150.0))
    machine = configured_machine(case)
    machine = replace(machine, bodies=(*machine.bodies, Body("main_shaft", 1.0, 0.2)))
    found = assess(speed_controlled(case, 40.0), machine)
    (cause,) = found.verdict
    assert cause.cause == "load_force" and cause.value == pytest.approx(1.15, abs=3.0 * cause.sigma)
    assert cause.sigma < 0.01 and found.found is not None and found.found.posterior.is_motion_uncertain


@pytest.mark.slow
def test_at_one_speed_it_is_named_together_with_the_delay() -> None:
    """A stiff controller's torque lags by the inertia over its gain, 1.25 ms: one speed does not separate the two."""
    case = heavier("loom", 24.0)
    (cause,) = assess(speed_controlled(case, 40.0, speeds=(14.0, 14.0)), configured_machine(case)).verdict
    assert cause.cause in ("unmodelled_inertia", "zero_or_delay")
    assert DELAY in (cause.parameter, *cause.equivalents)
    said = re.search(r"([\d.]+)(?: \+- [\d.]+)? kg m2 (?:turn|that turn)", cause.text)
    assert said is not None and float(said[1]) == pytest.approx(ADDED_KGM2, rel=0.3)


@pytest.mark.parametrize(("machine", "crank"), [("tufting", "l1"), ("loom", "crank")])
def test_the_inertia_of_a_crank_is_one_of_the_shaft(machine: str, crank: str) -> None:
    """Under a controller a delay of 4.2 ms was named 4.6 ms, with 30 % less inertia of the crank."""
    scene = configured_machine(healthy(machine, 1))
    model = TabulatedTorque(scene, *parameters(scene, WorkingPoint(1.0, 14.0, 0.01)))
    assert model.shaft_inertias == {ROTOR, f"bodies.{crank}.inertia_kgm2"}


def test_a_reversing_shaft_has_the_speed_along_its_path() -> None:
    """Forward and backward the angle passes the same turns, with a mean speed of zero."""
    time = np.arange(0.0, 20.0, 0.002)
    omega = np.where(time < 10.0, 14.0, -14.0)
    theta = 14.0 * np.minimum(time, 20.0 - time)
    track = ShaftTrack(time, theta, omega, np.zeros_like(time), 0.01)
    assert abs(Evidence(time, np.zeros_like(time), track, 10.0).working_speed()) == pytest.approx(14.0, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("added_kgm2", "late_s", "right"), [(0.005, 0.0, "unmodelled_inertia"), (0.0, 0.0025, "delay")]
)
def test_the_one_of_a_little_inertia_and_a_delay_names_the_other(added_kgm2: float, late_s: float, right: str) -> None:
    """Under a controller of 2 N m s an inertia of 0.005 kg m2 acts as a delay of 2.5 ms."""
    case = replace(heavier("loom"), added_inertia_kgm2=added_kgm2)
    (cause,) = assess(speed_controlled(case, 2.0, late_s), configured_machine(case)).verdict
    assert cause.cause == right and cause.value == pytest.approx(added_kgm2 or late_s, abs=3.0 * cause.sigma)
    assert ("kg m2" in cause.text and "late" in cause.text) or "lags" in cause.text


@pytest.mark.campaign
@pytest.mark.parametrize(("machine", "gain_Nms"), [("loom", 2.0), *more(("tufting", 2.0), ("tufting", 40.0))])
def test_late_stamps_under_a_controller_give_no_false_cause(machine: str, gain_Nms: float) -> None:
    """Errors of single accelerations reduce the fitted torque: a gain of 0.944 +- 0.005 and stronger loads."""
    case = healthy(machine, 1, duration_s=24.0)
    found = assess(speed_controlled(case, gain_Nms, jitter_s=3e-4), configured_machine(case))
    assert not found.verdict and found.explained > 0.9
