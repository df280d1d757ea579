"""Live state of an elastic main shaft against an independent simulation, with hard inputs."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators.elastic_shaft import Record, WideMachine, needle_m, simulate
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machine import EvenShaft, Machine, ShaftDrive, ShaftPlace
from textile_twin_core.twin.session import Samples

TORQUE, FAR = "balancing_torque_Nm", "needle_at_s16_position_m"
TURN = 2.0 * math.pi


def declared(wide: WideMachine, known: bool, **changes: object) -> Machine:
    """Declare the simulated machine as a user would."""
    drive = ShaftDrive(None, wide.drive_inertia_kgm2, wide.slip_Nms_rad) if known else ShaftDrive()
    shaft = EvenShaft(
        wide.diameter_m,
        wide.length_m,
        wide.stations,
        damping_Nms_rad=wide.piece_damping_Nms_rad / wide.stations,
        drive=drive,
    )
    places = shaft.places([ShaftPlace(phase) for phase in wide.phases_rad or (0.0,) * wide.stations])
    main_shaft = dataclasses.replace(shaft.main_shaft(), **changes)
    return dataclasses.replace(ttc.machines.tufting(), shaft=main_shaft, linkages=places)


@cache
@cache
def record(wide: WideMachine, rpm: float, seconds: float = 4.0) -> Record:
    """Simulate a recording at constant speed."""
    return simulate(wide, rpm, seconds, settle_s=1.0)


def observed(
    machine: Machine, made: Record, outputs: tuple[str, ...] = (TORQUE, FAR), shaft: str = "causal"
) -> Samples:
    """Return all predictions of a record, from one block."""
    session = ttc.compile(machine, outputs=outputs).session(shaft)
    samples = session.step(made.stamps_ns, made.encoder_rad)
    return samples if len(samples) else session.finish()


def error_over_peak(samples: Samples, made: Record, after_s: float) -> float:
    """Compute the root mean square error of the torque over the largest torque."""
    off = (samples[TORQUE] - made.torque_Nm[samples.index])[made.time_s[samples.index] > after_s]
    return float(np.sqrt(np.mean(off**2)) / np.abs(made.torque_Nm).max())


@pytest.mark.slow
def test_a_known_drive_gives_torque_and_far_needle() -> None:
    wide = WideMachine(0.06)
    made = record(wide, 300.0)
    samples = observed(declared(wide, True), made)
    assert error_over_peak(samples, made, 1.5) < 0.004
    late = made.time_s[samples.index] > 1.5
    far = samples[FAR] - needle_m(made.angles_rad[samples.index, -1])
    assert np.sqrt(np.mean(far[late] ** 2)) < 1e-6
    inside = np.abs(samples[TORQUE] - made.torque_Nm[samples.index]) < samples.torque_sigma_Nm
    assert np.mean(inside[late]) > 0.4
    assert np.median(samples.torque_sigma_Nm[late]) < 0.01 * np.abs(made.torque_Nm).max()
    assert not samples.settled[:200].any()
    assert samples.settled[late].all()


def test_an_unknown_drive_is_estimated() -> None:
    wide = WideMachine(0.04, phases_rad=tuple(math.pi * (k % 2) for k in range(16)))
    made = record(wide, 300.0)
    machine = declared(wide, False)
    samples = observed(machine, made)
    assert error_over_peak(samples, made, 2.0) < 0.01
    late = made.time_s[samples.index] > 2.0
    inside = np.abs(samples[TORQUE] - made.torque_Nm[samples.index]) < samples.torque_sigma_Nm
    assert np.mean(inside[late]) > 0.4
    settled = samples.settled
    off = np.abs(samples[TORQUE] - made.torque_Nm[samples.index])
    assert settled.any()
    assert off[settled].max() < 0.05 * np.abs(made.torque_Nm).max()
    twice = observed(machine, made, shaft="smooth")
    assert len(twice) == len(samples)
    assert error_over_peak(twice, made, 1.0) < 0.01


def test_blocks_of_any_size_give_the_same_numbers() -> None:
    wide = WideMachine(0.06)
    made = record(wide, 300.0)
    whole = observed(declared(wide, False), made)
    session = ttc.compile(declared(wide, False), outputs=(TORQUE, FAR)).session()
    count, begin, torques, sigmas = 1500, 0, [], []
    for size in (1, 2, 17, 400, 80, 500, 500):
        part = session.step(made.stamps_ns[begin : begin + size], made.encoder_rad[begin : begin + size])
        torques += part[TORQUE].tolist()
        sigmas += part.torque_sigma_Nm.tolist()
        begin += size
    for stamp, angle in zip(made.stamps_ns[begin:2000].tolist(), made.encoder_rad[begin:2000].tolist(), strict=True):
        for sample in session.step_one(stamp, angle, sigma=True):
            torques.append(sample.outputs[TORQUE])
            sigmas.append(sample.torque_sigma_Nm)
    assert begin == count
    peak = np.abs(whole[TORQUE]).max()
    np.testing.assert_allclose(torques, whole[TORQUE][: len(torques)], rtol=0.0, atol=1e-9 * peak)
    np.testing.assert_allclose(sigmas, whole.torque_sigma_Nm[: len(torques)], rtol=1e-9, atol=1e-12)
    assert len(torques) == 1998


def test_hard_inputs_neither_break_nor_mislead_it() -> None:
    wide = WideMachine(0.06)
    made = record(wide, 300.0)
    rng = np.random.default_rng(7)
    angle = np.mod(made.encoder_rad, TURN)
    angle[rng.random(angle.size) < 0.01] += 0.5
    angle[100:3000:250] = math.nan
    kept = rng.random(angle.size) > 0.05
    kept[2000:2150] = False
    machine = declared(wide, True)
    session = ttc.compile(machine, outputs=(TORQUE,)).session()
    samples = session.step(made.stamps_ns[kept], angle[kept])
    stamps = made.stamps_ns[kept][samples.index]
    assert np.isfinite(samples[TORQUE]).all()
    assert np.isfinite(samples.torque_sigma_Nm).all()
    truth = np.interp(stamps * 1e-9, made.time_s, made.torque_Nm)
    off = np.abs(samples[TORQUE] - truth) / np.abs(made.torque_Nm).max()
    assert session.report.rejected["not_finite"] > 5
    assert not samples.settled[(stamps > 2.15e9) & (stamps < 2.4e9)].any()
    assert np.quantile(off[samples.settled], 0.99) < 0.05
    assert np.sqrt(np.mean(off[samples.settled] ** 2)) < 0.01


def test_a_start_from_standstill_and_a_stop() -> None:
    wide = WideMachine(0.06)
    time = np.arange(7001) * 1e-3
    rpm = np.interp(time, [0.0, 0.5, 1.5, 4.5, 5.5, 7.0], [0.0, 0.0, 200.0, 200.0, 0.0, 0.0])
    made = simulate(wide, rpm, 7.0)
    samples = observed(declared(wide, True), made, (TORQUE,))
    assert np.isfinite(samples[TORQUE]).all()
    when, off = made.time_s[samples.index], np.abs(samples[TORQUE] - made.torque_Nm[samples.index])
    peak = np.abs(made.torque_Nm).max()
    at_work = (when > 3.0) & (when < 4.5)
    assert samples.settled[at_work].all()
    assert np.sqrt(np.mean(off[at_work] ** 2)) < 0.01 * peak
    assert np.isfinite(samples.torque_sigma_Nm).all()


@pytest.mark.parametrize(
    ("rate_hz", "slip", "inertia", "coulomb"), [(2000.0, 3.0, 0.02, 2.0), (1000.0, 20.0, 0.5, 5.0)]
)
def test_no_converged_state_is_wrong_from_standstill_to_standstill(
    rate_hz: float, slip: float, inertia: float, coulomb: float
) -> None:
    """A light and a heavy drive behind a soft shaft with dry friction, and an encoder of 12 bits."""
    wide = WideMachine(0.02 if inertia < 0.1 else 0.03, 1.0, 2, None, 0.015, inertia, slip, 0.0, coulomb)
    time = np.arange(int(5.0 * rate_hz) + 1) / rate_hz
    up, down = np.clip(time - 0.4, 0.0, 1.0), np.clip(time - 3.0, 0.0, 1.0)
    rpm = 300.0 * (up**2 * (3.0 - 2.0 * up) - down**2 * (3.0 - 2.0 * down))
    made = simulate(wide, rpm, 5.0, encoder_bits=12, rate_hz=rate_hz)
    machine = declared(wide, True)
    friction = ShaftFriction(coulomb_Nm=coulomb)
    machine = dataclasses.replace(
        ttc.machines.tufting(backing_force_N=0.0), shaft=machine.shaft, linkages=machine.linkages, loads=(friction,)
    )
    samples = observed(machine, made, (TORQUE,))
    when, off = made.time_s[samples.index], np.abs(samples[TORQUE] - made.torque_Nm[samples.index])
    bound = np.maximum(5.0 * samples.torque_sigma_Nm, 0.05 * np.abs(made.torque_Nm).max())
    assert not (samples.settled & (off > bound)).any()
    assert samples.settled[(when > 2.0) & (when < 3.0)].mean() > 0.8


def test_outputs_of_the_shaft() -> None:
    wide = WideMachine(0.04)
    made = record(wide, 300.0)
    parts = ("torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm")
    names = (
        TORQUE, *parts, "torque_piece_s0_s1_Nm", "torque_piece_s15_s16_Nm", "twist_rad", "needle_lag_rad",
        "needle_spread_m", "station_s16_angle_rad", "needle_position_m", "needle_at_s1_position_m",
    )  # fmt: skip
    samples = observed(declared(wide, True), made, names)
    late = made.time_s[samples.index] > 1.5
    true = made.angles_rad[samples.index]
    np.testing.assert_allclose(sum(samples[name] for name in parts), samples[TORQUE], atol=1e-9)
    np.testing.assert_array_equal(samples["torque_piece_s0_s1_Nm"], samples[TORQUE])
    np.testing.assert_array_equal(samples["needle_position_m"], samples["needle_at_s1_position_m"])
    twist = true[:, 0] - true[:, -1]
    assert np.sqrt(np.mean((samples["twist_rad"] - twist)[late] ** 2)) < 0.01 * np.abs(twist).max()
    np.testing.assert_allclose(samples["needle_lag_rad"], samples["twist_rad"], atol=1e-12)
    off = needle_m(true[:, 1:]) - needle_m(true[:, :1])
    spread = off.max(axis=1) - off.min(axis=1)
    assert np.sqrt(np.mean((samples["needle_spread_m"] - spread)[late] ** 2)) < 5e-6
    assert np.abs(samples["station_s16_angle_rad"] - true[:, -1])[late].max() < 1e-3


def test_an_encoder_at_the_far_end() -> None:
    wide = WideMachine(0.08)
    made = record(wide, 300.0)
    step = TURN / 2**14
    far = dataclasses.replace(made, encoder_rad=np.rint(made.angles_rad[:, -1] / step) * step)
    samples = observed(declared(wide, True, encoder_at="s16"), far, (TORQUE,))
    assert error_over_peak(samples, made, 1.5) < 0.01


@pytest.mark.slow
def test_a_shaft_settles_as_fast_as_its_vibration_decays() -> None:
    def after_s(damping: float, slip: float) -> float:
        wide = WideMachine(0.06, modal_damping=0.015 * damping, slip_Nms_rad=slip)
        made = record(wide, 300.0)
        samples = observed(declared(wide, True), made, (TORQUE,))
        return float(made.time_s[samples.index[np.argmax(samples.settled)]]) if samples.settled.any() else math.inf

    wide = WideMachine(0.06)
    machine = declared(wide, True)
    shaft = machine.shaft
    assert shaft is not None
    decay = 0.015 * wide.first_mode_rad_s
    assert after_s(1.0, 0.0) == pytest.approx(math.log(100.0) / decay, abs=0.1)
    assert after_s(0.2, 0.0) == pytest.approx(5.0 * math.log(100.0) / decay, abs=0.2)
    assert after_s(0.0, 80.0) < 3.0
    assert after_s(0.0, 0.0) == math.inf
    still = dataclasses.replace(
        shaft,
        pieces=tuple(dataclasses.replace(p, damping_Nms_rad=0.0) for p in shaft.pieces),
        drive=ShaftDrive(None, 1.0, 0.0),
    )
    assert "never settles" in ttc.compile(dataclasses.replace(machine, shaft=still), outputs=[TORQUE]).describe()


def test_what_cannot_be_asked() -> None:
    machine = declared(WideMachine(0.06), True)
    with pytest.raises(SceneError, match="torque_piece_s0_s1_Nm"):
        ttc.compile(machine, outputs=["torque_piece_s0_s2_Nm"])
    assert {"twist_rad", "needle_lag_rad", FAR} < set(machine.outputs)
    with pytest.raises(MotionError, match="time"):
        ttc.compile(machine, outputs=["twist_rad"]).evaluate(0.3, 20.0)
    with pytest.raises(SceneError, match="table"):
        ttc.compile(machine, method="table")


def test_a_drive_behind_a_gear_is_the_same_drive() -> None:
    wide = WideMachine(0.06)
    made = record(wide, 300.0)
    plain = declared(wide, True)
    assert plain.shaft is not None
    first, *others = plain.shaft.pieces
    geared = dataclasses.replace(
        plain.shaft,
        pieces=(dataclasses.replace(first, gear_ratio=-2.0), *others),
        drive=ShaftDrive(None, 0.25 * wide.drive_inertia_kgm2, 0.25 * wide.slip_Nms_rad),
        torque_sensor=("s1", "s0"),
    )
    samples = observed(plain, made, (TORQUE,))
    behind = observed(dataclasses.replace(plain, shaft=geared), made, (TORQUE, "station_s0_speed_rad_s"))
    np.testing.assert_allclose(behind[TORQUE], -samples[TORQUE], atol=1e-6)
    np.testing.assert_allclose(behind.torque_sigma_Nm, samples.torque_sigma_Nm, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(behind["station_s0_speed_rad_s"], -2.0 * behind.omega_rad_s, rtol=1e-9)


def test_a_lost_track_restarts() -> None:
    made = record(WideMachine(0.06), 300.0)
    session = ttc.compile(declared(WideMachine(0.06), False), outputs=(TORQUE,)).session()
    session.step(made.stamps_ns[:1000], made.encoder_rad[:1000])
    observer = session._predictor._observer  # type: ignore[attr-defined]
    observer._observer["theta"] = math.nan
    samples = session.step(made.stamps_ns[1000:], made.encoder_rad[1000:])
    assert np.isfinite(samples[TORQUE]).all()
    assert not samples.settled[:200].any()
    assert error_over_peak(samples, made, 3.0) < 0.01
