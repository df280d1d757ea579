"""Sensors calibrated from recordings of known truth, and their intervals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import textile_twin_core as ttc
from tests.campaign import more
from tests.generators import mill_recordings
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import START_NS, healthy, mistaken, record
from tests.generators.multibody import Floats
from tests.generators.planned_motion import Plan
from tests.generators.shaft_law import LOOM_FILE
from textile_twin_core.comparison import Calibration, Readings, assess, calibrate
from textile_twin_core.comparison.cause import Cause
from textile_twin_core.comparison.identification import check_sensors
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import open_bag


@pytest.mark.slow
def test_every_sensor_setting_of_a_loom_is_found_at_once() -> None:
    case = healthy("loom", 951, duration_s=12.0)
    encoder = replace(case.encoder, zero_rad=-2.0, direction=-1, ratio=0.5)
    torque = replace(case.torque, gain=-100.0, delay_s=0.008, offset_Nm=-150.0)
    case = replace(case, encoder=encoder, torque=torque)
    made, machine = record(case), configured_machine(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, machine)
    assert (found.direction, found.ratio, found.sign, found.unit) == (-1, 0.5, -1, "N cm")
    # A wrapped encoder that turns twice a turn leaves the half turn of its first reading ambiguous.
    apart = math.remainder(found.zero_rad.value + 2.0, 2.0 * math.pi) * 0.5
    assert abs(apart) < min(5.0 * found.zero_rad.sigma, math.radians(0.4))
    assert found.gain.value == pytest.approx(1.0, abs=0.01)
    assert found.delay_s.value == pytest.approx(0.008, abs=min(5.0 * found.delay_s.sigma, 6e-4))
    assert found.offset_Nm.value == pytest.approx(-150.0, abs=8.0)
    assert any("wraps each time" in each.text for each in found.ambiguous)
    again = assess(readings, found.machine)
    assert again.verdict == ()


@pytest.mark.campaign
def test_an_ambiguity_at_one_speed_is_named_with_the_recording_that_resolves_it() -> None:
    case = healthy("tufting", 952, run_up=False, duration_s=12.0)
    case = replace(case, torque=replace(case.torque, delay_s=0.005))
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, configured_machine(case))
    pairs = {each.between: each for each in found.ambiguous}
    assert "run-up" in pairs["zero_rad", "torque.delay_s"].recording
    assert "rest" in pairs["torque.offset_Nm", "shaft_coulomb_Nm"].recording
    assert math.isfinite(found.zero_rad.sigma) != math.isfinite(found.delay_s.sigma)
    assert found.to_json()["ambiguous"][0]["recording"]


@pytest.mark.slow
def test_undeclared_friction_and_loads_are_not_taken_for_the_torque_sensor() -> None:
    """Standstill separates the sensor's offset from friction, the turn separates its gain from the needles' force."""
    case = healthy("tufting", 954, duration_s=14.0)
    friction = replace(case.friction, coulomb_Nm=case.friction.coulomb_Nm + 0.5)
    case = replace(case, friction=friction, backing=replace(case.backing, force_N=1030.0))
    case = replace(case, torque=replace(case.torque, gain=0.9, offset_Nm=0.9))
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, configured_machine(case))
    assert found.ambiguous == ()
    assert found.offset_Nm.value == pytest.approx(0.9, abs=min(5.0 * found.offset_Nm.sigma, 0.05))
    assert found.gain.value == pytest.approx(0.9, abs=min(5.0 * found.gain.sigma, 0.015))
    said = {cause.cause: cause for cause in found.assessment.verdict}
    assert said["torque_offset"].value == pytest.approx(0.9, abs=0.05)
    assert said["unmodelled_friction"].value == pytest.approx(0.5, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("offset_Nm", [0.15, *more(-0.2)])
def test_an_offset_below_the_reporting_threshold_is_still_written(offset_Nm: float) -> None:
    """The stated RMS is that of the machine that is written."""
    case = healthy("tufting", 955, duration_s=14.0)
    case = replace(case, torque=replace(case.torque, offset_Nm=offset_Nm))
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, configured_machine(case))
    assert found.assessment.verdict == ()
    assert found.offset_Nm.value == pytest.approx(offset_Nm, abs=min(5.0 * found.offset_Nm.sigma, 0.04))
    assert found.machine.sensors.torque.offset_Nm == found.offset_Nm.value
    again = calibrate(readings, found.machine)
    assert again.rms_before_Nm == pytest.approx(found.rms_after_Nm, rel=0.01)
    assert found.rms_after_Nm == pytest.approx(0.08, rel=0.1)


@pytest.mark.campaign
def test_a_brake_at_standstill_is_no_offset(monkeypatch: pytest.MonkeyPatch) -> None:
    """Torque of a brake that is released while the shaft turns, beyond what dry friction may hold."""
    monkeypatch.setattr(mill_recordings, "run_up_and_down", plan_of((0.0, 0.0), (4.0, 0.0), (7.0, 1.0), (24.0, 1.0)))
    case = healthy("tufting", 957)
    made = record(case)
    held = made.torque_stamps_ns < START_NS + 3_900_000_000
    torque = made.torque + np.where(held, 0.6, 0.0)
    found = calibrate(
        Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, torque), configured_machine(case)
    )
    assert found.offset_Nm.value == 0.0
    _has_sigmas_or_says_so(found)
    assert any("brake" in each.text for each in found.ambiguous)


@pytest.mark.parametrize("seed", [955, *more(958, 959, 960)])
def test_a_standstill_without_an_offset_bounds_the_offset(seed: int) -> None:
    case = healthy("tufting", seed)
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, configured_machine(case))
    _has_sigmas_or_says_so(found)
    low, high = found.offset_Nm.interval95
    assert low <= 0.0 <= high and high - low < 0.1
    assert abs(found.offset_Nm.value) < 4.0 * found.offset_Nm.sigma < 0.1


@pytest.mark.slow
def test_the_offset_of_the_shipped_recording_follows_from_its_standstill() -> None:
    """One second of standstill, noise of 0.05 N m, and by its README no offset."""
    bag = open_bag(Path(__file__).parents[2] / "bags" / "tufting_160rpm_synthetic")
    angles, torques = bag.read_angles(), bag.read_torques()
    readings = Readings(angles.stamps, angles.angles_rad, torques.stamps, torques.torque_Nm, angles.velocities)
    found = calibrate(readings, ttc.machines.tufting())
    _has_sigmas_or_says_so(found)
    told = found.to_json()["torque"]["offset_Nm"]
    assert told["interval95"][0] <= 0.0 <= told["interval95"][1]
    assert 0.05 / math.sqrt(500.0) < told["sigma"] < 0.02
    assert found.gain.value == pytest.approx(1.01, abs=2.0 * found.gain.sigma) and found.gain.sigma < 0.012
    assert found.given_file["torque.gain"].value == pytest.approx(1.01, abs=2e-3)


def _has_sigmas_or_says_so(found: Calibration) -> None:
    told = {name for each in found.ambiguous for name in each.between}
    for name, each in {
        "zero_rad": found.zero_rad,
        "torque.gain": found.gain,
        "torque.offset_Nm": found.offset_Nm,
        "torque.delay_s": found.delay_s,
    }.items():
        assert math.isfinite(each.sigma) or name in told, name


def spring_torque(theta: Floats) -> Floats:
    """Torque of the loom's shaft for the spring of SPRING_LOOM: the slope of the stored energy."""
    turn = 2.0 * math.pi * np.arange(4097) / 4096
    pin = 0.06 * np.exp(1j * turn)
    across = 0.3 - pin
    along = (abs(across) ** 2 + 0.2**2 - 0.23**2) / (2.0 * abs(across))
    joint = pin + across / abs(across) * (along + 1j * np.sqrt(0.2**2 - along**2))
    energy = 0.5 * 600.0 * (abs(joint - (0.1 + 0.35j)) - 0.1) ** 2
    return np.asarray(CubicSpline(turn, energy, bc_type="periodic")(np.mod(theta, 2.0 * math.pi), 1))


SPRING_LOOM = LOOM_FILE.replace("C: [0.3, 0]", "C: [0.3, 0], H: [0.1, 0.35]").replace(
    "loads: [", "loads: [{type: spring, from: B, to: H, stiffness_N_m: 600, free_length_m: 0.1}, "
)


@pytest.mark.slow
@pytest.mark.parametrize("offset_Nm", [0.8, *more(0.0)])
def test_a_spring_at_standstill_is_no_offset(offset_Nm: float, tmp_path: Path) -> None:
    case = healthy("loom", 958)
    case = replace(
        case, torque=replace(case.torque, offset_Nm=offset_Nm), friction=replace(case.friction, coulomb_Nm=1.6)
    )
    made = record(case)
    theta = made.plan.at((made.torque_stamps_ns - START_NS) * 1e-9)[0]
    assert min(abs(spring_torque(theta[[0, -1]]))) > 1.0
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque + spring_torque(theta))
    path = tmp_path / "loom.yaml"
    path.write_text(SPRING_LOOM)
    found = calibrate(readings, ttc.load_machine(path))
    said = {cause.cause: cause.value for cause in found.assessment.verdict}
    assert said.pop("unmodelled_friction") == pytest.approx(0.6, abs=0.1)
    assert said == ({"torque_offset": pytest.approx(0.8, abs=0.05)} if offset_Nm else {})
    assert found.machine.sensors.torque.offset_Nm == pytest.approx(offset_Nm, abs=0.05)


@pytest.mark.campaign
def test_the_stated_rms_contains_the_estimates_that_are_not_written() -> None:
    case = healthy("tufting", 956)
    case = replace(case, friction=replace(case.friction, coulomb_Nm=case.friction.coulomb_Nm + 1.0))
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, configured_machine(replace(case, friction=healthy("tufting", 956).friction)))
    again = calibrate(readings, found.machine)
    assert again.rms_before_Nm == pytest.approx(found.rms_after_Nm, rel=0.01)
    assert found.rms_beside_Nm < 0.1 < 0.9 < found.rms_after_Nm


@pytest.mark.slow
def test_a_recording_of_another_machine_gives_no_calibration() -> None:
    case = replace(healthy("tufting", 953, duration_s=5.0), configured_machine="loom")
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    with pytest.raises(RecordingError, match="not this machine"):
        calibrate(readings, configured_machine(case))


@pytest.mark.parametrize("offset_Nm", [0.13, *more(0.2, 0.31)])
def test_an_offset_is_no_finer_than_the_steps_of_the_sensor(offset_Nm: float) -> None:
    """Torque with one decimal at standstill may show one value throughout, off by up to half a step."""
    case = healthy("tufting", 976, duration_s=24.0)
    made = record(replace(case, torque=replace(case.torque, offset_Nm=offset_Nm, noise_Nm=0.01)))
    torque = np.round(made.torque, 1)
    found = calibrate(
        Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, torque), configured_machine(case)
    )
    assert abs(found.offset_Nm.value - offset_Nm) < 2.5 * found.offset_Nm.sigma
    assert found.offset_Nm.sigma < 0.05


def test_identify_sends_to_calibrate_only_where_calibrate_writes_sensors() -> None:
    """Otherwise two commands would each ask for the other."""
    case = healthy("tufting", 977, duration_s=12.0)
    made, machine = record(case), configured_machine(case)
    judged = assess(Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque), machine)
    sign = Cause("torque_sign", "the torque has the other sign", -1.0)
    foreign = Cause("other_machine", "not this machine: 40 % of the torque stays unexplained", 0.4)
    with pytest.raises(RecordingError, match="other sign: settle it first with textile-twin calibrate"):
        check_sensors(replace(judged, verdict=(sign,)), machine)
    with pytest.raises(RecordingError, match="other sign: calibrate cannot settle it here: not this machine: 40 %"):
        check_sensors(replace(judged, verdict=(sign, foreign)), machine)


@pytest.mark.campaign
def test_a_lighter_machine_of_the_same_kind_does_not_mirror_the_sensors() -> None:
    """The encoder is reversed, its zero 0.1 rad, two bodies are there: a reversed torque with a seventh of the gain and
    loads of -4 times left 0.7 of the error.
    """
    heavy = ttc.machines.tufting()
    light = replace(heavy, bodies=tuple(body for body in heavy.bodies if body.on in ("l3", "l6")))
    time = np.arange(0.0, 30.0, 0.004)
    share = np.clip(time / 3.0, 0.0, 1.0)
    omega = 16.755 * share * share * (3.0 - 2.0 * share)
    theta, alpha = 0.3 + np.cumsum(omega) * 0.004, np.gradient(omega, time)
    torque = ttc.compile(light, ["balancing_torque_Nm"]).evaluate(theta, omega, alpha)["balancing_torque_Nm"]
    torque = torque + 0.2 + 0.02 * np.random.default_rng(1).normal(size=time.size)
    stamps = START_NS + np.rint(time * 1e9).astype(np.int64)
    angle = np.mod(0.1 - np.ceil(theta / (2.0 * math.pi) * 2**14) / 2**14 * 2.0 * math.pi, 2.0 * math.pi)
    try:
        found = calibrate(Readings(stamps, angle, stamps, torque), heavy)
    except RecordingError as refused:
        assert "no calibration from this recording" in str(refused)
    else:
        assert (found.direction, found.sign) == (-1, 1)
        assert found.gain.value == pytest.approx(1.0, abs=3.0 * found.gain.sigma) and found.gain.sigma < 0.1


def plan_of(*points: tuple[float, float]) -> Callable[[float, float, np.random.Generator], Plan]:
    """Motion given by (time [s], share of the speed)."""

    def make(_: float, speed: float, rng: np.random.Generator) -> Plan:
        start = float(rng.uniform(0.0, 2.0 * math.pi))
        return Plan([(time, share * speed) for time, share in points], start, [(1, 0.02, 0.3), (2, 0.008, 4.0)])

    return make


@pytest.mark.slow
@pytest.mark.parametrize("mistakes", [("direction", "delay"), *more((("delay",),))])
@pytest.mark.parametrize("seed", [100, *more(101, 102, 103)])
def test_a_delay_in_a_steep_run_up_does_not_mirror_the_machine(
    mistakes: tuple[str, ...], seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Too few turns for two speeds, yet a zero does not have the effect of a delay."""
    plan = plan_of((0.0, 0.0), (20.0, 0.0), (20.5, 1.0), (22.0, 1.002), (22.5, 0.0), (22.51, 0.0))
    monkeypatch.setattr(mill_recordings, "run_up_and_down", plan)
    case, _ = mistaken("tufting", mistakes, seed, duration_s=22.51)
    case = replace(case, encoder=replace(case.encoder, bits=10))
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, configured_machine(case))
    assert (found.direction, found.sign) == (case.encoder.direction, 1)
    assert found.gain.value == pytest.approx(1.0, abs=0.01)


def test_a_long_standstill_hides_no_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight seconds of motion within four minutes; differences of the clocks at standstill are no drift."""
    plan = plan_of((0.0, 0.0), (180.0, 0.0), (181.0, 1.0), (187.0, 1.003), (188.0, 0.0), (240.0, 0.0))
    monkeypatch.setattr(mill_recordings, "run_up_and_down", plan)
    case, _ = mistaken("loom", ("direction", "delay"), 101, duration_s=240.0)
    case = replace(case, encoder=replace(case.encoder, rate_hz=200.0), torque=replace(case.torque, rate_hz=200.0))
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = calibrate(readings, configured_machine(case))
    assert found.direction == -1
    assert found.delay_s.value == pytest.approx(case.torque.delay_s, abs=5e-4)
    assert {cause.cause for cause in found.assessment.verdict} == {"encoder_direction", "zero_or_delay"}


def test_torque_of_a_second_within_a_long_record_of_angles() -> None:
    case = healthy("loom", 5)
    made = record(case)
    inside = (made.torque_stamps_ns >= START_NS + 12 * 10**9) & (made.torque_stamps_ns < START_NS + 13 * 10**9)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns[inside], made.torque[inside])
    found = calibrate(readings, configured_machine(case))
    assert found.gain.value == pytest.approx(1.0, abs=0.01)
    assert found.assessment.verdict == ()
    assert any(each.between == ("zero_rad", "torque.delay_s") for each in found.ambiguous)
