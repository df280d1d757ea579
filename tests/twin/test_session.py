"""Sessions: stamps, blocks, encoders and the sigma of the torque."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.machine import Encoder, Sensors

TURN = 2.0 * math.pi

OUTPUTS = ["balancing_torque_Nm", "needle_position_m", "joint_main_shaft_position", "joint_coupler_position"]


def motion(n: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    stamps = 1_700_000_000_000_000_000 + np.arange(n, dtype=np.int64) * 2_000_000
    return stamps, 16.755 * np.arange(n) * 0.002


def test_blocks_of_any_size_give_the_same_numbers() -> None:
    twin = ttc.compile(ttc.machines.tufting(), OUTPUTS, method="exact")
    stamps, theta = motion()
    whole = twin.session().step(stamps, theta)
    session, cuts = twin.session(), [0, 1, 2, 3, 500, 517, 1500]
    parts = [session.step(stamps[a:b], theta[a:b]) for a, b in pairwise(cuts)]
    assert np.array_equal(np.concatenate([p.stamps for p in parts]), whole.stamps)
    for name in OUTPUTS:
        assert np.allclose(np.concatenate([p[name] for p in parts]), whole[name], rtol=0, atol=1e-11)


@pytest.mark.parametrize("step_rad", [None, 1e-3])
@pytest.mark.parametrize("shaft", ["causal", "lag"])
@pytest.mark.parametrize("sigma", [False, True])
def test_samples_one_by_one_are_those_of_a_block(shaft: str, sigma: bool, step_rad: float | None) -> None:
    encoder = Encoder(zero_rad=0.2, direction=-1, resolution_rad=step_rad)
    machine = replace(ttc.machines.tufting(), sensors=Sensors(encoder=encoder))
    twin = ttc.compile(machine, OUTPUTS, method="exact")
    stamps, theta = motion(120)
    session, live = twin.session(shaft=shaft), []
    for stamp, angle in zip(stamps.tolist(), theta.tolist(), strict=True):
        live += session.step_one(stamp, angle, sigma=sigma)
    live += session.finish().rows(sigma)
    whole = twin.session(shaft=shaft)
    rows = [*whole.step(stamps, theta).rows(sigma), *whole.finish().rows(sigma)]
    assert len(live) == len(rows) == 118
    for one, other in zip(live, rows, strict=True):
        assert one.stamp == other.stamp
        assert one[1:5] == pytest.approx(other[1:5], abs=1e-9, nan_ok=True)
        assert math.isnan(one.torque_sigma_Nm) != sigma
        assert one.outputs == pytest.approx(other.outputs, abs=1e-9)


def test_each_sample_from_the_third_on_gets_its_own_stamp() -> None:
    twin = ttc.compile(ttc.machines.tufting(), OUTPUTS, method="exact")
    stamps, theta = motion()
    theta[700] = math.nan
    samples = twin.session().step(stamps, theta)
    expected = np.delete(np.arange(1500), [0, 1, 700])
    assert np.array_equal(samples.index, expected)
    assert np.array_equal(samples.stamps, stamps[expected])


def test_encoder_is_undone() -> None:
    plain, turned = ttc.machines.tufting(), ttc.machines.tufting(encoder_zero_rad=0.4)
    stamps, theta = motion()
    a = ttc.compile(plain, OUTPUTS, method="exact").session().step(stamps, theta)
    b = ttc.compile(turned, OUTPUTS, method="exact").session().step(stamps, theta + 0.4)
    assert np.allclose(a["balancing_torque_Nm"], b["balancing_torque_Nm"], atol=1e-9)


@pytest.mark.parametrize(("turned", "wraps"), [(14.25, True), (-14.25, True), (14.25, False)])
def test_an_encoder_zero_of_many_turns_keeps_a_wrapped_angle_wrapped(turned: float, wraps: bool) -> None:
    """Use the zero of a multi-turn encoder; a zero of 90 rad once made each wrap of the angle a discontinuity."""
    plain = ttc.machines.tufting()
    zeroed = replace(plain, sensors=Sensors(Encoder(zero_rad=turned * TURN)))
    stamps, theta = motion()
    measured = theta + turned * TURN
    shown = np.mod(measured, TURN) if wraps else measured
    samples = ttc.compile(zeroed, OUTPUTS, "exact").session().step(stamps, shown)
    truth = ttc.compile(plain, OUTPUTS, "exact").evaluate(theta[samples.index], 16.755, 0.0)
    assert np.abs(samples["needle_position_m"] - truth["needle_position_m"])[500:].max() < 1e-8
    assert samples.settled[500:].all()


def test_winding_angles_go_on_while_the_phase_stays_exact() -> None:
    twin = ttc.compile(ttc.machines.tufting(), OUTPUTS, method="exact")
    stamps, theta = motion()
    samples = twin.session().step(stamps, theta)
    assert np.allclose(samples["joint_main_shaft_position"], samples.theta_rad, atol=1e-12)
    assert abs(np.diff(samples["joint_coupler_position"])).max() < 0.1  # continuous where the angle wraps


def test_sigma_of_the_torque_follows_from_the_state() -> None:
    machine = ttc.machines.tufting()
    twin = ttc.compile(machine, ["torque_inertial_Nm"], method="exact")
    stamps, theta = motion()
    samples = twin.session().step(stamps, theta)
    smooth = ttc.compile(machine, ["balancing_torque_Nm"], method="exact")
    i, step = 1000, 1e-6
    state = [samples.theta_rad[i], samples.omega_rad_s[i], samples.alpha_rad_s2[i]]
    slopes = []
    for k in range(3):
        up, down = list(state), list(state)
        up[k] += step
        down[k] -= step
        ends = [smooth.evaluate(*map(float, s))["balancing_torque_Nm"] for s in (up, down)]
        slopes.append((ends[0] - ends[1]) / (2 * step))
    expected = math.sqrt(np.array(slopes) @ samples.states.covariance[i] @ np.array(slopes))
    assert abs(samples.torque_sigma_Nm[i] - expected) < 1e-5 * expected


@pytest.mark.parametrize("ratio", [0.5, 1.5, 2.0])
@pytest.mark.parametrize("wraps", [True, False])
@pytest.mark.parametrize("shaft", ["causal", "smooth"])
def test_a_geared_encoder_may_wrap_at_its_own_turn(ratio: float, wraps: bool, shaft: str) -> None:
    plain = ttc.machines.tufting()
    geared = replace(plain, sensors=Sensors(Encoder(zero_rad=0.3, direction=-1, ratio=ratio)))
    stamps, theta = motion()
    measured = 0.3 - theta / ratio
    session = ttc.compile(geared, OUTPUTS, "exact").session(shaft)
    samples = session.step(stamps, np.mod(measured, TURN) if wraps else measured)
    samples = samples if len(samples) else session.finish()
    truth = ttc.compile(plain, OUTPUTS, "exact").evaluate(theta[samples.index], 16.755, 0.0)
    assert np.abs(samples["needle_position_m"] - truth["needle_position_m"])[500:].max() < 1e-8


def test_impacts_are_taken_once_whatever_the_blocks() -> None:
    machine = ttc.machines.needle_transfer()
    twin = ttc.compile(machine, outputs=["element_2_position_m"])
    speed = machine.nominal_speed_rad_s
    stamps = 1_700_000_000_000_000_000 + 500_000 * np.arange(1000)
    angle = speed * (stamps - stamps[0]) * 1e-9
    found = []
    for size in (1000, 37):
        session = twin.session()
        taken = []
        for first in range(0, 1000, size):
            session.step(stamps[first : first + size], angle[first : first + size])
            taken += session.take_events()
        assert session.take_events() == []
        found.append([(stamp, event.kind, event.name, event.impulse_Ns) for stamp, event in taken])
    assert found[0] == found[1]
    hits = [(stamp, name) for stamp, kind, name, impulse in found[0] if kind == "impact" and impulse > 5e-3]
    # After the start, where the estimate has not converged: same as with the exact motion.
    twin.evaluate(angle, np.full(1000, speed), np.zeros(1000), time=1e-9 * (stamps - stamps[0]))
    given = [(e.time_s, e.name) for e in twin.events if e.kind == "impact" and e.impulse_Ns > 5e-3]
    assert [name for _, name in hits] == [name for _, name in given] and len(hits) > 4
    for (stamp, _), (time_s, _) in zip(hits, given, strict=True):
        assert abs((stamp - stamps[0]) * 1e-9 - time_s) < 1e-5


def test_one_by_one_refuses_what_a_block_refuses_and_goes_on_after_a_reset_with_speeds_and_blocks_between() -> None:
    machine = replace(ttc.machines.tufting(), sensors=Sensors(encoder=Encoder(resolution_rad=1e-3)))
    twin = ttc.compile(machine, OUTPUTS, method="exact")
    stamps, theta = motion(400)
    speeds = np.where(np.arange(400) % 3 == 0, 16.755, math.nan)
    theta[100], stamps[200], stamps[210] = math.nan, stamps[199], stamps[150]
    whole = [*twin.session().step(stamps, theta, speeds).rows()]
    session, live = twin.session(), []
    for _ in range(2):
        session.reset()
        live = []
        for i in range(400):
            if 250 <= i < 260:
                if i == 250:
                    live += session.step(stamps[250:260], theta[250:260], speeds[250:260]).rows()
                continue
            known = None if math.isnan(speeds[i]) else float(speeds[i])
            live += session.step_one(int(stamps[i]), float(theta[i]), known)
    assert [sample.stamp for sample in live] == [sample.stamp for sample in whole]
    assert len(live) == 400 - 2 - 3
    for one, other in zip(live, whole, strict=True):
        assert one[1:4] == pytest.approx(other[1:4], abs=1e-9)
        assert one.outputs == pytest.approx(other.outputs, abs=1e-9)
    assert session.report.rejected == {"not_finite": 1, "duplicate_stamp": 1, "older_stamp": 1}


def in_blocks(session: ttc.Session, stamps: np.ndarray, angles: np.ndarray, block: int) -> tuple[list, list[float]]:
    """Stamps and torques of samples taken in blocks; 1: one by one."""
    given: list = []
    torques: list[float] = []
    for start in range(0, stamps.size, block):
        part = slice(start, start + block)
        rows = (
            session.step_one(stamps[start].item(), angles[start].item())
            if block == 1
            else session.step(stamps[part], angles[part]).rows()
        )
        for row in rows:
            given.append(row.stamp)
            torques.append(row.outputs["balancing_torque_Nm"])
    last = session.finish()
    return [*given, *last.stamps.tolist()], [*torques, *last["balancing_torque_Nm"].tolist()]


@pytest.mark.parametrize("shaft", ["causal", "lag"])
@pytest.mark.parametrize("unit", [1, 1e-9])
def test_stamps_that_were_set_back_begin_another_record_in_blocks_of_any_size(shaft: str, unit: float) -> None:
    machine = ttc.machines.tufting()
    twin = ttc.compile(machine, ["balancing_torque_Nm"], method="exact")
    stamps, theta = motion(1000)
    sent, angles = np.concatenate([stamps, stamps]) * unit, np.concatenate([theta, theta])
    # Nine samples pass until time is known to have been set back, and two begin each estimate.
    places = np.r_[2:1000, 1011:2000]
    truth = twin.evaluate(angles[places], 16.755, 0.0)["balancing_torque_Nm"]
    whole: list[float] = []
    for block in (1, 7, 64, 2000):
        session = twin.session(shaft)
        given, torques = in_blocks(session, sent, angles, block)
        assert given == sent[places].tolist() and session.restarts == 1
        assert session.report.received == 2000 and session.report.rejected["older_stamp"] == 9
        good = np.r_[500:998, 1500 : len(places)]
        assert np.max(np.abs(np.array(torques)[good] - truth[good])) < 0.05 * np.max(np.abs(truth))
        whole = whole or torques
        assert np.allclose(torques, whole, rtol=0.0, atol=1e-9)


def test_a_machine_with_a_history_begins_again_from_its_start_where_time_was_set_back() -> None:
    twin = ttc.compile(ttc.machines.needle_transfer(), ["element_2_position_m"])
    stamps, theta = motion(800)
    session = twin.session()
    both = session.step(np.tile(stamps, 2), np.tile(theta, 2))["element_2_position_m"]
    fresh = twin.session().step(stamps[9:], theta[9:])["element_2_position_m"]
    assert both.size == 798 + 789 and session.take_events()
    assert np.max(np.abs(both[-400:] - fresh[-400:])) < 1e-6
