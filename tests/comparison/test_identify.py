"""Parameters found again in recordings whose truth is worked out apart from the engine."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.generators.mill_recordings import Case, healthy, record
from tests.generators.shaft_law import Backing, Friction, tufting_law
from tests.generators.told_machine import told_machine
from textile_twin_core.comparison import Identification, Readings, identify
from textile_twin_core.errors import RecordingError


def identified(case: Case) -> Identification:
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return identify(readings, told_machine(case))


def entry_and_exit(plane_m: float) -> tuple[float, float]:
    theta = np.linspace(0.0, 2.0 * np.pi, 400_001)
    inside = np.flatnonzero(tufting_law().at(theta)[3] >= plane_m)
    return float(theta[inside[0]]), float(theta[inside[-1]])


@pytest.mark.slow
def test_a_run_up_tells_every_parameter_of_the_tufting_machine() -> None:
    case = healthy("tufting", 971, duration_s=30.0)
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
    assert [each.name for each in found.not_identifiable] == ["torque_sensor_offset_Nm"]
    told = found.to_json()
    assert told["not_identifiable"] == ["torque_sensor_offset_Nm"]
    assert set(told["parameters"]["backing_force_N"]) == {"value", "sigma", "interval95"}
    planes = found.machine.loads[0]
    assert isinstance(planes.entry_plane_m, float) and abs(planes.entry_plane_m - 0.5572) < 2e-5  # type: ignore[union-attr]


def test_at_one_speed_what_cannot_be_told_is_named_and_stays() -> None:
    case = healthy("loom", 972, run_up=False, duration_s=16.0)
    found = identified(case)
    lost = {each.name for each in found.not_identifiable}
    assert {"torque_sensor_offset_Nm", "shaft_viscous_Nms"} <= lost
    assert not lost & set(found.parameters)
    assert found.fixed["shaft_viscous_Nms"] == 0.04
    assert "shaft_coulomb_Nm" in found.parameters
    low, high = found.parameters["shaft_coulomb_Nm"].interval95
    assert low < 1.0 < high


def test_a_torque_that_nobody_modelled_comes_out_with_its_band() -> None:
    case = healthy("loom", 973, duration_s=24.0)
    made = record(case)
    theta = made.plan.at((made.torque_stamps_ns - made.torque_stamps_ns.min()) * 1e-9 + 0.0507)[0]
    readings = Readings(
        made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque + 0.4 * np.cos(5.0 * theta - 1.0)
    )
    left = identify(readings, told_machine(case)).unmodelled
    assert left.significant
    truth = 0.4 * np.cos(5.0 * left.angle_rad - 1.0)
    assert float(np.mean(np.abs(left.torque_Nm - truth) < left.band_Nm + 0.02)) > 0.95
    assert float(np.max(left.band_Nm)) < 0.05


def test_wrong_sensors_are_to_be_settled_first() -> None:
    case = healthy("loom", 974, duration_s=16.0)
    with pytest.raises(RecordingError, match="calibrate"):
        identified(replace(case, torque=replace(case.torque, gain=-1.0)))
