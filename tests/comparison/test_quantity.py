"""Traces of the sley by a camera, and a speed under a torque, compared with machines; truth by other equations."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import scipy

import textile_twin_core as ttc
from tests.generators.sley_camera import displacement, filmed
from textile_twin_core.cli.main import main
from textile_twin_core.comparison.driven_speed import driven_speed
from textile_twin_core.comparison.quantity import Trace, compare_quantity
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.dynamics import Body
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensors import Encoder, Sensors, TorqueSensor
from textile_twin_core.mechanism import Crank
from textile_twin_core.recordings import BagWriter


def test_generator_has_the_papers_range() -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 100_001)
    assert float(displacement(theta).max()) * 1e3 == pytest.approx(84.991, abs=0.001)  # printed: 85


@pytest.mark.parametrize("seed", [61, 62])
def test_camera_trace_gives_scale_delay_and_zero(seed: int) -> None:
    film = filmed(seed, scale=1.012, delay_s=0.004, zero_rad=math.radians(7.0))
    trace = Trace(film.stamps_ns, film.displacement_m, film.stamps_ns, film.angle_rad)
    found = compare_quantity(trace, ttc.machines.elliptic_gear_beatup(), "sley_position_m")
    assert found.scale.value == pytest.approx(1.012, abs=3e-4)
    assert found.delay_s.value == pytest.approx(0.004, abs=3e-4)
    assert math.degrees(found.zero_rad.value) == pytest.approx(7.0, abs=0.15)
    assert found.rms == pytest.approx(2e-4, rel=0.05)
    assert found.measured_range * 1e3 == pytest.approx(1.012 * 84.991, abs=0.03)
    assert found.scale.interval95[0] < 1.012 < found.scale.interval95[1]
    assert not found.one_speed


def test_at_one_speed_all_is_delay_and_said_to_be() -> None:
    film = filmed(63, scale=1.0, delay_s=0.004, zero_rad=0.0, duration_s=8.0, run_up=False)
    trace = Trace(film.stamps_ns, film.displacement_m, film.stamps_ns, film.angle_rad)
    found = compare_quantity(trace, ttc.machines.elliptic_gear_beatup(), "sley_position_m")
    assert found.one_speed
    assert found.delay_s.value == pytest.approx(0.004, abs=2e-4)
    short = film.stamps_ns < film.stamps_ns[0] + 200_000_000
    with pytest.raises(RecordingError):
        compare_quantity(
            Trace(film.stamps_ns[short], film.displacement_m[short], film.stamps_ns[short], film.angle_rad[short]),
            ttc.machines.elliptic_gear_beatup(),
            "sley_position_m",
        )


def test_camera_trace_by_commands_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = filmed(64, scale=1.0, delay_s=0.002, zero_rad=0.1, duration_s=8.0)
    log = tmp_path / "camera.csv"
    time = (film.stamps_ns - film.stamps_ns[0]) * 1e-9
    rows = np.column_stack([time, np.rad2deg(film.angle_rad), film.displacement_m * 1e3])
    np.savetxt(log, rows, delimiter=";", header="time [s];spindle angle [deg];sley [mm]", comments="", fmt="%.6f")
    bag = str(tmp_path / "bag")
    assert main(["import", str(log), "--out", bag, "--quantity", "sley_position_m=sley [mm]"]) == 0
    arguments = ["compare", bag, "--machine", "elliptic_gear_beatup", "--quantity", "sley_position_m"]
    assert main([*arguments, "--png", str(tmp_path / "sley.png"), "--json", str(tmp_path / "sley.json")]) == 0
    said = capsys.readouterr().out
    assert "84.9" in said and "RMS error after fit" in said
    assert (tmp_path / "sley.png").stat().st_size > 20_000
    assert main(["compare", bag, "--machine", "elliptic_gear_beatup", "--quantity", "sley_positon_m"]) == 2
    assert "did you mean sley_position_m" in capsys.readouterr().err
    for wrong, words in (
        (("--max-rms", "0.1"), "--max-rms is a limit of torques"),
        (("--predicted", "recorded"), "applies to torques"),
        (("--json", "sley.txt"), "must end in .json"),
        (("--png", "sley.jpg"), "must end in .png"),
    ):
        assert main([*arguments, *wrong]) == 2
        assert words in capsys.readouterr().err


def test_a_velocity_is_compared_at_the_speed_of_the_shaft(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    speed, time = 20.0, np.arange(4000) / 1000.0
    theta = speed * time
    twin = ttc.compile(ttc.machines.tufting(), ["needle_velocity_m_s", "needle_acceleration_m_s2"])
    truth = twin.evaluate(theta, np.full_like(theta, speed), np.zeros_like(theta))
    stamps = np.rint(time * 1e9).astype(np.int64)
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], theta)
        for name, values in truth.items():
            bag.write_joint_states(f"measured/{name}", stamps, [name], 1.02 * values)
    for name, unit in (("needle_velocity_m_s", "m/s"), ("needle_acceleration_m_s2", "m/s²")):
        assert main(["compare", str(tmp_path / "bag"), "--machine", "tufting", "--quantity", name]) == 0
        told = dict(line.split("  ", 1) for line in capsys.readouterr().out.splitlines())
        for whose, scale in (("measured", 1.02), ("machine", 1.0)):
            value, shown = told[f"range over a turn, {whose}"].split()
            assert float(value) == pytest.approx(scale * np.ptp(truth[name]), rel=2e-3) and shown == unit
        assert told["shaft speed, usual"].strip() == "191.0 rpm"


@pytest.mark.slow
@pytest.mark.parametrize("low_pass_s", [0.0, 0.004])
def test_speed_under_a_torque_gives_inertia_and_delay(low_pass_s: float) -> None:
    rotor = 0.021  # a bare rotor, whose motion under a torque by time is known in closed form
    speed, rate = 100.0, 4000.0
    time = np.arange(0.0, 0.8, 1.0 / rate)
    # omega = w0 + sum a sin(h w0 t), alpha by hand; the ripple is so small that the angle equals w0 t.
    waves = ((0.5, 0.6), (1.0, 0.4), (1.5, 0.3), (2.0, 0.2))
    theta = speed * time - sum(a / (h * speed) * np.cos(h * speed * time) for h, a in waves)
    late = time - 0.0005
    # Each wave behind a first-order low pass: 1 / (1 + i h w0 tau).
    passed = {h: 1.0 / (1.0 + 1j * h * speed * low_pass_s) for h, _ in waves}
    torque = rotor * sum(a * h * speed * (passed[h] * np.exp(1j * h * speed * late)).real for h, a in waves)
    stamps = 1_000_000_000 + np.rint(time * 1e9).astype(np.int64)
    machine = Machine(
        "rotor",
        {"O": (0.0, 0.0)},
        (Crank("crank", "O", "A", 0.05),),
        (Body.flywheel(0.02),),
        sensors=Sensors(Encoder(cycle_turns=2), TorqueSensor(low_pass_s=low_pass_s)),
    )
    noise = np.random.default_rng(3).standard_normal((2, time.size))
    readings = Readings(stamps, np.mod(theta + 1e-4 * noise[0], 2.0 * np.pi), stamps, torque + 4.0 + 0.5 * noise[1])
    found = driven_speed(readings, machine)
    assert found.inertia_kgm2 == pytest.approx(rotor, rel=0.02)
    assert found.added_inertia_kgm2 == pytest.approx(0.001, abs=4e-4)
    assert found.delay_s == pytest.approx(0.0005, abs=1.5e-4)
    assert found.explained > 0.98
    assert "the inertia is 1.0" in found.verdict


@pytest.mark.parametrize("phase", [0.5 * np.pi, -0.5 * np.pi])
def test_where_in_a_strong_ripple_the_cycle_begins_does_not_matter(phase: float) -> None:
    rotor, height, order, mean = 0.02, 0.16, 0.5, 300.0
    # By the energy: omega^2 = mean square (1 + height sin(order theta + phase)), so the torque is half its slope.
    theta = np.linspace(0.0, 4.0 * np.pi * 9.3, 400_001)
    omega = mean * np.sqrt(1.0 + height * np.sin(order * theta + phase))
    time = scipy.integrate.cumulative_simpson(1.0 / omega, x=theta, initial=0.0)
    taken = np.arange(0.0, time[-1], 4e-5)
    angle = np.interp(taken, time, theta)
    torque = 0.5 * rotor * mean**2 * height * order * np.cos(order * angle + phase)
    stamps = 1_000_000_000 + np.rint(taken * 1e9).astype(np.int64)
    wheel = (Body.flywheel(0.018),)
    sensors = Sensors(Encoder(cycle_turns=2))
    machine = Machine("rotor", {"O": (0.0, 0.0)}, (Crank("crank", "O", "A", 0.05),), wheel, sensors=sensors)
    found = driven_speed(Readings(stamps, np.mod(angle, 2.0 * np.pi), stamps, torque), machine)
    assert found.inertia_kgm2 == pytest.approx(rotor, rel=0.005)
    assert abs(found.delay_s) < 5e-5


def traced(name: str, delay_s: float, zero_rad: float, begin_s: float = 0.02) -> Trace:
    """Output of the tufting machine at 300 Hz from a time on, with noise, in 12 s with a run-up of 6 s."""
    fine = np.arange(0.0, 12.0, 1e-4)
    omega = 8.0 + 9.0 * np.minimum(fine / 6.0, 1.0)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * 1e-4)])
    alpha = np.where(fine < 6.0, 1.5, 0.0)
    seen, read = np.arange(begin_s, 11.9, 1.0 / 300.0), np.arange(0.01, 11.95, 1.0 / 500.0)
    state = (np.interp(seen - delay_s, fine, each) for each in (theta, omega, alpha))
    values = np.asarray(ttc.compile(ttc.machines.tufting(), [name], method="exact").evaluate(*state)[name])
    values = values + 1e-3 * np.ptp(values) * np.random.default_rng(3).standard_normal(values.size)
    angle = np.mod(np.interp(read, fine, theta) + zero_rad, 2.0 * np.pi)
    angle = np.rint(angle * 16384 / (2.0 * np.pi)) * 2.0 * np.pi / 16384
    stamps = [1_000_000_000 + np.rint(each * 1e9).astype(np.int64) for each in (seen, read)]
    return Trace(stamps[0], values, stamps[1], angle)


@pytest.mark.parametrize("name", ["reaction_O_x_N", "driven_shaft_torque_Nm", "needle_position_m"])
def test_a_discontinuous_quantity_gives_delay_and_zero_like_a_smooth_one(name: str) -> None:
    found = compare_quantity(traced(name, 0.004, 0.1), ttc.machines.tufting(), name)
    assert found.scale.value == pytest.approx(1.0, abs=1e-3)
    assert found.delay_s.value == pytest.approx(0.004, abs=max(4.0 * found.delay_s.sigma, 1e-4))
    assert found.zero_rad.value == pytest.approx(0.1, abs=max(4.0 * found.zero_rad.sigma, 2e-3))
    assert found.explained > 0.9999
    assert abs(found.delay_s.value - 0.004) < 1.5e-3 and abs(found.zero_rad.value - 0.1) < 0.025


def test_a_delay_of_more_than_half_a_turn_is_found_where_the_speed_varies() -> None:
    found = compare_quantity(traced("needle_position_m", 0.2, 0.0, 0.3), ttc.machines.tufting(), "needle_position_m")
    assert found.delay_s.value == pytest.approx(0.2, abs=1e-3)


def test_a_trace_of_one_speed_within_a_record_of_many_is_of_one_speed() -> None:
    found = compare_quantity(traced("needle_position_m", 0.004, 0.0, 8.0), ttc.machines.tufting(), "needle_position_m")
    assert found.one_speed
    assert found.delay_s.value == pytest.approx(0.004, abs=2e-4)
    with pytest.raises(RecordingError, match="of a turn: record needle_position_m over some turns"):
        compare_quantity(traced("needle_position_m", 0.0, 0.0, 11.6), ttc.machines.tufting(), "needle_position_m")


def test_a_quantity_independent_of_the_angle_determines_no_zero() -> None:
    found = compare_quantity(traced("omega_1_rad_s", 0.01, 0.1), ttc.machines.tufting(), "omega_1_rad_s")
    assert found.zero_rad.value == 0.0 and math.isnan(found.zero_rad.sigma)
    assert found.delay_s.value == pytest.approx(0.01, abs=2e-3)


def stopped(name: str, stop_rad: float) -> Trace:
    """Output of the tufting machine at work for 4 s between standstills of 9 s each, measured 4 ms late. It stands at
    an angle where friction holds the needle with a force that grows and fades.
    """
    time = np.arange(0.0, 24.0, 0.002)
    ramp = np.clip((time - 9.0) / 1.0, 0.0, 1.0) - np.clip((time - 14.0) / 1.0, 0.0, 1.0)
    omega = 16.755 * ramp
    theta = np.cumsum(omega) * 0.002
    theta += stop_rad - theta[-1]
    values = ttc.compile(ttc.machines.tufting(), [name], method="exact").evaluate(
        theta, omega, np.gradient(omega, 0.002)
    )
    found = np.asarray(values[name])
    size = float(np.ptp(found))
    if name.endswith(("_N", "_Nm")):
        found = found + 0.4 * size * np.sin(time) * (omega == 0.0)
    found = found + 1e-3 * size * np.random.default_rng(7).standard_normal(time.size)
    stamps = 1_000_000_000 + np.rint(time * 1e9).astype(np.int64)
    angle = np.rint(np.mod(theta, 2.0 * np.pi) * 16384 / (2.0 * np.pi)) * 2.0 * np.pi / 16384
    return Trace(stamps + 4_000_000, found, stamps, angle)


@pytest.mark.parametrize("name", ["driven_shaft_torque_Nm", "reaction_guide_N", "balancing_torque_Nm"])
@pytest.mark.parametrize("stop_rad", [math.radians(107.0), 0.5, 5.0])
def test_forces_of_friction_at_standstill_do_not_count(name: str, stop_rad: float) -> None:
    found = compare_quantity(stopped(name, stop_rad), ttc.machines.tufting(), name)
    assert found.scale.value == pytest.approx(1.0, abs=2e-3)
    assert found.delay_s.value == pytest.approx(0.004, abs=1e-3)
    assert found.explained > 0.9999
    assert found.at_rest == pytest.approx(18.0 * 500.0, rel=0.02) and found.time_s.size < 3200


def test_a_place_counts_at_standstill_too() -> None:
    found = compare_quantity(stopped("needle_position_m", 0.5), ttc.machines.tufting(), "needle_position_m")
    assert found.at_rest == 0 and found.time_s.size > 11_000
    assert found.scale.value == pytest.approx(1.0, abs=1e-3)
    assert found.delay_s.value == pytest.approx(0.004, abs=2e-4)


@pytest.mark.parametrize("name", ["needle_velocity_m_s", "omega_1_rad_s"])
def test_a_speed_has_no_dry_friction_and_counts_at_standstill(name: str) -> None:
    found = compare_quantity(stopped(name, 0.5), ttc.machines.tufting(), name)
    assert found.at_rest == 0 and found.time_s.size > 11_000
    assert found.scale.value == pytest.approx(1.0, abs=1e-3)


def test_a_force_at_standstill_alone_is_refused_in_a_line() -> None:
    whole = stopped("reaction_guide_N", 0.5)
    rest = slice(8000, 12000)
    trace = Trace(whole.stamps_ns[rest], whole.values[rest], whole.angle_stamps_ns, whole.angle_rad)
    with pytest.raises(RecordingError, match="reaction_guide_N"):
        compare_quantity(trace, ttc.machines.tufting(), "reaction_guide_N")
    begin = slice(4000, 4540)
    trace = Trace(whole.stamps_ns[begin], whole.values[begin], whole.angle_stamps_ns[:8000], whole.angle_rad[:8000])
    with pytest.raises(RecordingError, match="while the shaft turns"):
        compare_quantity(trace, ttc.machines.tufting(), "reaction_guide_N")


@pytest.mark.parametrize("name", ["reaction_guide_N", "needle_position_m"])
@pytest.mark.parametrize("after_s", [-100, 100, 3600])
def test_stamps_of_another_clock_are_not_reported_as_a_standstill(name: str, after_s: int) -> None:
    whole = stopped(name, 0.5)
    trace = Trace(whole.stamps_ns + after_s * 10**9, whole.values, whole.angle_stamps_ns, whole.angle_rad)
    with pytest.raises(RecordingError, match=r"only 0 of 12000 samples of .* beside shaft angles; .* one clock"):
        compare_quantity(trace, ttc.machines.tufting(), name)


def test_samples_beyond_the_angles_do_not_count_as_standstill() -> None:
    whole = stopped("reaction_guide_N", 0.5)
    known = slice(2500, 9000)
    trace = Trace(whole.stamps_ns, whole.values, whole.angle_stamps_ns[known], whole.angle_rad[known])
    assert compare_quantity(trace, ttc.machines.tufting(), "reaction_guide_N").at_rest < 18.0 * 500.0 - 5000
