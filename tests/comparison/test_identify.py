"""Parameters identified in recordings whose truth is computed without the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case, Encoder, TorqueSensor, healthy, record, torque_of
from tests.generators.planned_motion import Plan
from tests.generators.shaft_law import Backing, Friction, tufting_law
from tests.generators.speed_controlled_motion import speed_controlled_motion
from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison import Identification, Readings, identify, with_table
from textile_twin_core.dynamics import loads as declared
from textile_twin_core.errors import RecordingError

SLOWLY = {"encoder": Encoder(rate_hz=250.0), "torque": TorqueSensor(rate_hz=250.0)}
"""Readings at half of the usual rate: a search for what the file lacks takes half the time."""


def identified(case: Case) -> Identification:
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return identify(readings, configured_machine(case))


def entry_and_exit(plane_m: float) -> tuple[float, float]:
    theta = np.linspace(0.0, 2.0 * np.pi, 400_001)
    inside = np.flatnonzero(tufting_law().at(theta)[3] >= plane_m)
    return float(theta[inside[0]]), float(theta[inside[-1]])


@pytest.mark.slow
def test_a_run_up_determines_every_parameter_of_the_tufting_machine() -> None:
    case = healthy("tufting", 971, duration_s=12.0)
    case = replace(
        case,
        backing=Backing(force_N=880.0, free_force_N=15.0, entry_plane_m=0.5572, exit_plane_m=0.5572),
        friction=Friction(0.05, 0.3),
        torque=replace(case.torque, gain=1.03, delay_s=0.003),
    )
    found = identified(case)
    value = {name: each.value for name, each in found.parameters.items()}
    entry, leave = entry_and_exit(0.5572)
    assert value["backing_force_N"] * value["torque_sensor_gain"] == pytest.approx(880.0 * 1.03, rel=0.01)
    assert value["shaft_viscous_Nms"] == pytest.approx(0.05, rel=0.05)
    assert value["torque_sensor_delay_s"] == pytest.approx(0.003, abs=3e-4)
    assert math.degrees(abs(value["entry_angle_rad"] - entry)) < 0.2
    assert math.degrees(abs(value["exit_angle_rad"] - leave)) < 0.2
    assert value["free_force_N"] == pytest.approx(15.0, abs=1.0)
    assert found.rms_after_Nm < 0.25 < found.rms_before_Nm
    assert not found.unmodelled.significant
    # the shaft begins at rest, where an offset is no friction
    low, high = found.parameters["torque_sensor_offset_Nm"].interval95
    assert low < 0.0 < high < 0.05
    numbers = found.to_json()
    assert numbers["not_identifiable"] == []
    assert set(numbers["parameters"]["backing_force_N"]) == {"value", "sigma", "interval95"}
    backing = found.machine.loads[0]
    assert isinstance(backing, declared.Backing)
    assert backing.entry_plane_m == pytest.approx(0.5572, abs=2e-5)


def test_at_one_speed_unidentifiable_parameters_are_named_and_fixed() -> None:
    case = healthy("loom", 972, run_up=False, duration_s=16.0)
    found = identified(case)
    lost = {each.name for each in found.not_identifiable}
    assert {"torque_sensor_offset_Nm", "shaft_viscous_Nms"} <= lost
    assert not lost & set(found.parameters)
    assert found.fixed["shaft_viscous_Nms"] == 0.04
    assert "shaft_coulomb_Nm" in found.parameters
    low, high = found.parameters["shaft_coulomb_Nm"].interval95
    assert low < 1.0 < high


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "bits", "gain_Nms"),
    [(982, 11, 2.0), *more((980, 13, 2.0), (980, 16, 2.0), (985, 11, 2.0), (984, 13, 5.0))],
)
def test_under_a_speed_controlled_drive_no_inertia_is_estimated_beside_a_delay(
    seed: int, bits: int, gain_Nms: float
) -> None:
    """Gain 1.03, delay 4 ms, no inertia beside the file's; noise of 0.03 N m, stamps wrong by 30 us."""
    case = healthy("loom", seed, duration_s=24.0)
    fine, angle, _, torque = speed_controlled_motion(case, gain_Nms, (9.0, 14.0))
    rng = np.random.default_rng([seed, bits])
    time, step = np.arange(0.1, 23.9, 0.001), 2.0 * np.pi / 2**bits
    true = time + 3e-5 * rng.standard_normal(time.size)
    stamps = np.rint(time * 1e9).astype(np.int64)
    read = np.rint(np.interp(true, fine, angle) / step) * step
    shown = 1.03 * np.interp(true - 0.004, fine, torque) + 0.03 * rng.standard_normal(time.size)
    found = identify(Readings(stamps, read, stamps, shown), configured_machine(case))
    lost = {each.name: each.text for each in found.not_identifiable}
    assert "torque_sensor_delay_s" in lost["added_inertia_kgm2"]
    truth = {"torque_sensor_delay_s": 0.004, "torque_sensor_gain": 1.03, "encoder_zero_rad": 0.0}
    for name, true_value in truth.items():
        each = found.parameters[name]
        assert abs(each.value - true_value) < max(3.0 * each.sigma, 1e-3 * true_value), name
    assert found.parameters["torque_sensor_delay_s"].value == pytest.approx(0.004, abs=2e-4 if bits > 12 else 3e-4)


def test_a_backing_beyond_the_needle_is_not_fitted() -> None:
    """The largest travel is 0.5743 m; in this record the needle never meets the backing; noise of 0.08 N m."""
    case = healthy("tufting", 978, duration_s=16.0)
    made = record(replace(case, backing=Backing(force_N=15.0, free_force_N=15.0)))
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    shallow = declared.Backing("needle", 1000.0, 0.60, 0.56, 15.0)
    found = identify(readings, replace(configured_machine(case), loads=(shallow,)))
    assert (found.rms_before_Nm, found.rms_after_Nm) == pytest.approx((0.08, 0.08), rel=0.1)
    lost = {each.name: each.text for each in found.not_identifiable}
    assert {"entry_angle_rad", "exit_angle_rad"} <= set(lost) and "does not pass" in lost["entry_angle_rad"]
    assert shallow in found.machine.loads


@pytest.mark.campaign
def test_an_event_without_samples_beside_it_stays_as_configured() -> None:
    """Torque cut off at 60 % of its largest value: the samples in the backing beside the exit are lost."""
    case = healthy("tufting", 200, duration_s=24.0)
    made = record(case)
    largest = 0.6 * float(np.max(np.abs(made.torque)))
    cut = np.clip(made.torque, -largest, largest)
    machine = configured_machine(case)
    found = identify(Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, cut), machine)
    entry, leave = entry_and_exit(Backing().entry_plane_m)
    lost = {each.name for each in found.not_identifiable} & {"entry_angle_rad", "exit_angle_rad"}
    assert lost
    for name, truth in (("entry_angle_rad", entry), ("exit_angle_rad", leave)):
        if name in lost:
            assert found.fixed[name] == pytest.approx(truth, abs=1e-4)
        else:
            assert abs(found.parameters[name].value - truth) < 3.0 * found.parameters[name].sigma


@pytest.mark.campaign
def test_several_backings_are_reported_as_not_fitted() -> None:
    """A record of one backing, a file with two of half the force: only the event angles are not fitted."""
    case = healthy("tufting", 979, duration_s=16.0)
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    machine = configured_machine(case)
    whole = machine.loads[0]
    assert isinstance(whole, declared.Backing) and len(machine.loads) == 1
    halves = (replace(whole, force_N=400.0), replace(whole, force_N=600.0))
    found = identify(readings, replace(machine, loads=halves))
    assert found.rms_after_Nm == pytest.approx(0.08, rel=0.1)
    lost = {each.name: each.text for each in found.not_identifiable}
    assert {"backing_force_N", "free_force_N", "entry_angle_rad", "exit_angle_rad"} <= set(lost)
    assert "2 backings; they stay as configured" in lost["backing_force_N"]
    assert any("2 backings" in note for note in found.notes)
    assert halves == found.machine.loads[:2]


@pytest.mark.slow
def test_an_unmodelled_torque_comes_out_with_its_band() -> None:
    case = healthy("loom", 973, **SLOWLY)
    made = record(case)
    theta = made.plan.at((made.torque_stamps_ns - made.torque_stamps_ns.min()) * 1e-9 + 0.0507)[0]
    readings = Readings(
        made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque + 0.4 * np.cos(5.0 * theta - 1.0)
    )
    left = identify(readings, configured_machine(case)).unmodelled
    assert left.significant
    truth = 0.4 * np.cos(5.0 * left.angle_rad - 1.0)
    assert float(np.mean(np.abs(left.torque_Nm - truth) < left.band_Nm + 0.02)) > 0.95
    assert float(np.max(left.band_Nm)) < 0.05


def two_turns(seed: int) -> tuple[Case, Readings, Callable[[FloatArray], FloatArray]]:
    """Record of a loom whose load, missing in its file, repeats every second turn."""
    case = healthy("loom", seed, **SLOWLY)
    made = record(case)
    start = np.floor(made.plan.start_rad / (2.0 * np.pi)) * 2.0 * np.pi

    def load(theta: FloatArray) -> FloatArray:
        return np.asarray(0.5 * np.cos(1.5 * (theta - start) - 1.0) + 0.3 * np.sin(5.0 * theta))

    theta = made.plan.at((made.torque_stamps_ns - made.torque_stamps_ns.min()) * 1e-9 + 0.0507)[0]
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque + load(theta))
    return case, readings, load


@pytest.mark.slow
def test_a_load_over_two_turns_comes_out_over_two_turns() -> None:
    case, readings, load = two_turns(975)
    machine = configured_machine(case)
    sensors = replace(machine.sensors, encoder=replace(machine.sensors.encoder, cycle_turns=2))
    left = identify(readings, replace(machine, sensors=sensors)).unmodelled
    assert left.significant
    assert left.cycle_turns == 2
    assert left.angle_rad[-1] > 12.5
    error = left.torque_Nm - load(left.angle_rad)
    assert float(np.sqrt(np.mean(error**2))) < 0.06  # its part at standstill passes for an offset of the sensor
    assert float(np.median(left.band_Nm)) < 0.1
    assert float(np.mean(np.abs(error) < left.band_Nm)) > 0.6
    with pytest.raises(RecordingError, match="lasts 2 turns"):
        with_table(machine, left)


@pytest.mark.campaign
def test_a_torque_that_changes_sign_from_turn_to_turn_vanishes_in_the_mean_over_one() -> None:
    case, readings, _ = two_turns(975)
    alone = identify(readings, configured_machine(case)).unmodelled
    assert float(np.ptp(alone.torque_Nm)) == pytest.approx(0.6, abs=0.1)


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (((0.0, 0.0), (20.0, 0.0)), "stands still"),
        (((0.0, 0.0), (2.0, 0.0), (6.0, 1.2), (8.0, 0.0), (20.0, 0.0)), "of a turn"),
    ],
    ids=["standstill", "part of a turn"],
)
def test_too_little_motion_is_said_and_nothing_is_fitted(points: Sequence[tuple[float, float]], said: str) -> None:
    plan = Plan(points, 0.4)
    rng = np.random.default_rng(5)
    time = np.arange(0.05, 19.95, 0.002)
    case = healthy("tufting", 976)
    stamps = np.rint(time * 1e9).astype(np.int64)
    theta, omega, alpha = plan.at(time)
    torque = torque_of(case, theta, omega, alpha) + 0.08 * rng.standard_normal(time.size)
    angle = np.rint(theta / 3.8e-4) * 3.8e-4
    with pytest.raises(RecordingError, match=said):
        identify(Readings(stamps, angle, stamps, torque), configured_machine(case))


@pytest.mark.campaign
def test_gaps_are_reported_and_samples_beside_them_count() -> None:
    case = healthy("tufting", 977, duration_s=24.0)
    made = record(case)
    since = (made.angle_stamps_ns - made.angle_stamps_ns[0]) * 1e-9
    lost = ((since > 8.0) & (since < 10.5)) | ((since > 14.0) & (since < 15.0))
    readings = Readings(made.angle_stamps_ns[~lost], np.unwrap(made.angle)[~lost], made.torque_stamps_ns, made.torque)
    found = identify(readings, configured_machine(case))
    assert any("does not count" in note for note in found.notes)
    product = found.parameters["backing_force_N"].value * found.parameters["torque_sensor_gain"].value
    assert product == pytest.approx(1000.0, rel=0.01)


def test_wrong_sensors_are_to_be_settled_first() -> None:
    case = healthy("loom", 974, duration_s=16.0)
    with pytest.raises(RecordingError, match="calibrate"):
        identified(replace(case, torque=replace(case.torque, gain=-1.0)))
