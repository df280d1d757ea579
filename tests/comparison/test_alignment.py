"""Track of the prediction: exact for cubics that it represents, never across a gap or a discontinuity."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.comparison.alignment import build_track, usual_step


def test_interpolates_a_parabola_exactly_on_uneven_steps() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(1e-3, 3e-3, 200))
    track, jumps = build_track(time, 3.0 + 2.0 * time - 5.0 * time**2, 10.0 * time, [])
    at = rng.uniform(time[0], time[-1], 1000)
    index, inside = track.piece(at)
    torque, slope = track.torque_at(at, index)
    assert inside.all()
    assert jumps == ()
    np.testing.assert_allclose(torque, 3.0 + 2.0 * at - 5.0 * at**2, atol=1e-13)
    np.testing.assert_allclose(slope, 2.0 - 10.0 * at, atol=1e-10)
    np.testing.assert_allclose(track.theta_at(at, index), 10.0 * at, atol=1e-13)


def test_error_falls_with_the_third_power_of_the_step_or_better() -> None:
    errors = []
    for n in (101, 201, 401):
        time = np.linspace(0.0, 1.0, n)
        track, _ = build_track(time, np.sin(20.0 * time), time, [])
        at = np.linspace(0.05, 0.95, 3001)
        torque, _ = track.torque_at(at, track.piece(at)[0])
        errors.append(float(np.max(np.abs(torque - np.sin(20.0 * at)))))
    assert errors[0] / errors[1] > 7.5
    assert errors[1] / errors[2] > 7.5


def test_parabola_stays_exact_up_to_a_step_from_both_sides() -> None:
    time = np.linspace(0.0, 1.0, 501)
    theta = 2 * np.pi * 4.0 * time
    event = 1.0
    step = np.where(np.mod(theta, 2 * np.pi) >= event, 10.0, 0.0)
    parabola = 1.0 - time + 3.0 * time**2
    track, jumps = build_track(time, parabola + step, theta, [event])
    assert jumps == (True,)
    np.testing.assert_allclose(track.step_time_s, (event / (2 * np.pi) + np.arange(4)) / 4.0, atol=1e-12)
    # Up to the undeclared step at angle zero.
    at = np.linspace(0.01, 0.24, 2000)
    index, _ = track.piece(at)
    torque, _ = track.torque_at(at, index)
    expected = 1.0 - at + 3.0 * at**2 + np.where(2 * np.pi * 4.0 * at >= event, 10.0, 0.0)
    np.testing.assert_allclose(torque, expected, atol=1e-12)


def test_a_kink_is_followed_to_its_tip() -> None:
    """Friction reverses with the needle: a tip of |sin| between two samples, which no smooth curve follows."""
    time = np.linspace(0.0, 1.0, 501)
    theta = 2 * np.pi * time
    tip = 2.0003
    track, jumps = build_track(time, 17.0 * np.abs(np.sin(theta - tip)), theta, [tip])
    assert jumps == (False,)
    assert track.step_time_s.size == 0
    at = np.linspace(0.30, 0.34, 4001)
    torque, _ = track.torque_at(at, track.piece(at)[0])
    assert np.max(np.abs(torque - 17.0 * np.abs(np.sin(2 * np.pi * at - tip)))) < 2e-5


def test_two_events_between_two_samples_are_not_interpolated() -> None:
    time = np.linspace(0.0, 1.0, 51)
    theta = 2 * np.pi * time
    track, _ = build_track(time, np.sin(theta), theta, [3.02, 3.05])
    assert np.flatnonzero(track.blocked).tolist() == [24]


def test_guard_widens_the_time_beside_a_step() -> None:
    time = np.linspace(0.0, 1.0, 501)
    theta = 2 * np.pi * time
    track, _ = build_track(time, np.where(theta >= 3.0, 5.0, 0.0) + 0.1 * time, theta, [3.0])
    instant = 3.0 / (2 * np.pi)
    at = instant + np.array([-0.011, -0.009, 0.009, 0.011])
    assert track.near_step(at, 0.01).tolist() == [False, True, True, False]


def test_finds_crossings_also_when_the_shaft_turns_backwards() -> None:
    time = np.linspace(0.0, 1.0, 501)
    theta = -2 * np.pi * 3.0 * time
    torque = np.where(np.mod(theta, 2 * np.pi) > 2.0, 0.0, 7.0) + 0.01 * time
    track, jumps = build_track(time, torque, theta, [2.0])
    assert jumps == (True,)
    assert track.step_time_s.size == 3
    np.testing.assert_allclose(np.mod(-18.849555921538759 * track.step_time_s, 2 * np.pi), 2.0, atol=1e-9)


def test_a_gap_is_found() -> None:
    time = np.concatenate([np.arange(100) * 2e-3, 1.0 + np.arange(100) * 2e-3])
    track, _ = build_track(time, np.sin(time), time, [])
    assert np.flatnonzero(track.blocked).tolist() == [99]


def test_the_usual_step_of_samples_in_bursts_is_the_mean() -> None:
    bursts = np.tile([*[2e-6] * 7, 0.016 - 14e-6], 50)
    assert usual_step(bursts) == pytest.approx(0.002)
    assert usual_step(np.array([0.002] * 99 + [3600.0])) == pytest.approx(0.002)
    assert usual_step(np.full(10, 1.0)) == 1.0
