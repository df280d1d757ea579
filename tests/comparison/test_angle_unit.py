"""Unit of a logged angle: detected from its wraps, and never reported for angles in radians."""

from __future__ import annotations

import math

import numpy as np
import pytest

from textile_twin_core.comparison.readings import angle_unit, other_unit, radians_of

TURN = 2.0 * math.pi


def turning(turns: float, a_turn: float, seed: int = 1, run_up: bool = False) -> np.ndarray:
    """Angle [rad] over a number of turns, with `a_turn` uneven samples a turn at full speed."""
    rng = np.random.default_rng(seed)
    step = np.full(round(turns * a_turn), TURN / a_turn)
    if run_up:
        step *= np.clip(np.linspace(-0.2, 3.0, step.size), 0.0, 1.0)
    theta = np.cumsum(step) + rng.uniform(0.0, TURN)
    return theta + 0.03 * np.sin(theta) + 1e-4 * rng.standard_normal(theta.size)


@pytest.mark.parametrize("run_up", [False, True])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("a_turn", [8, 30, 200, 1000])
@pytest.mark.parametrize(
    ("turn", "option"), [(360.0, "deg"), (1.0, "rev"), (400.0, "gon"), (4096, "4096"), (7200, "7200")]
)
def test_a_wrapped_angle_shows_its_unit(turn: float, option: str, a_turn: float, direction: int, run_up: bool) -> None:
    angle = np.mod(direction * turning(8.0, a_turn, run_up=run_up), TURN) * (turn / TURN)
    seen = other_unit(np.floor(angle) if turn > 400.0 else angle)
    assert seen is not None and seen.option == option
    assert seen.to_radians == pytest.approx(TURN / turn) == radians_of(option)
    if turn == 360.0:
        about_zero = other_unit(np.where(angle > 180.0, angle - 360.0, angle))
        assert about_zero is not None and about_zero.option == "deg"


@pytest.mark.parametrize("run_up", [False, True])
@pytest.mark.parametrize("a_turn", [8, 30, 200, 1000, 3000])
@pytest.mark.parametrize(
    "counts", [125, 128, 250, 256, 500, 512, 1000, 1024, 2000, 2048, 4000, 4096, 8000, 8192, 2**17, 2**20, 2**24]
)
def test_round_counts_are_not_taken_for_powers_of_two(counts: int, a_turn: float, run_up: bool) -> None:
    angle = np.mod(turning(12.0, a_turn, seed=counts, run_up=run_up), TURN) * (counts / TURN)
    for whole in (np.floor(angle), np.rint(angle)):
        seen = other_unit(whole)
        assert seen is not None and seen.option == str(counts) and f"wraps at {counts} " in seen.instead


@pytest.mark.parametrize("counts", [1250, 1440, 8640])
def test_counts_of_more_digits_follow_from_the_readings(counts: int) -> None:
    seen = other_unit(np.floor(np.mod(turning(12.0, 2.0 * counts), TURN) * (counts / TURN)))
    assert seen is not None and seen.option == str(counts)


def radians() -> dict[str, np.ndarray]:
    """Angles in radians that must not be taken for another unit."""
    theta = turning(400.0, 200)
    rest = np.full(5000, 3.0) + 1e-3 * np.random.default_rng(3).standard_normal(5000)
    return {
        "wrapped": np.mod(theta, TURN),
        "wrapped about zero": np.mod(theta + math.pi, TURN) - math.pi,
        "few samples a turn": np.mod(turning(300.0, 7), TURN),
        "run-up": np.mod(turning(50.0, 300, run_up=True), TURN),
        "unwrapped": theta,
        "unwrapped, backwards": -theta,
        "unwrapped, after a week": theta + 6e8,
        "slow": theta[:900],
        "short": theta[:5],
        "one angle": theta[:1],
        "none": theta[:0],
        "not a number": np.full(100, math.nan),
        "standing": np.full(5000, 3.0),
        "standing, with noise": rest,
        "standing where it wraps": np.mod(rest - 3.0, TURN),
        "swinging": 0.5 * np.sin(0.01 * theta),
        "set to zero once, near 360": np.concatenate([theta[theta < 359.0], theta[theta < 359.0]]),
        "set to zero now and then": np.concatenate([theta[theta < end] for end in (250.0, 355.0, 120.0, 358.0)]),
        "of 57 turns": np.mod(theta, 57 * TURN),
        "of 64 turns": np.mod(theta, 64 * TURN),
        "of 4096 turns": np.mod(theta * 1000.0, 4096 * TURN),
        "with wrong readings": np.where(np.arange(theta.size) % 97 == 0, 360.0, np.mod(theta, TURN)),
        "of a gear of 3 to 10": np.mod(theta * 0.3, TURN),
    }


@pytest.mark.parametrize("name", radians())
def test_radians_are_not_taken_for_another_unit(name: str) -> None:
    assert other_unit(radians()[name]) is None


def test_a_single_wrap_is_seen_but_shows_no_unit() -> None:
    angle = np.rad2deg(np.mod(turning(1.2, 200), TURN))
    assert angle_unit(angle).name == "degrees" and other_unit(angle) is None


@pytest.mark.parametrize("unit", ["", "0", "-4096", "nan", "inf", "degrees"])
def test_an_unknown_unit_is_refused(unit: str) -> None:
    with pytest.raises(ValueError):
        radians_of(unit)


def test_a_counter_that_is_reset_at_several_readings_shows_no_turn() -> None:
    """A plunger counts from -106 to 250, 298, 303 .. 412 and is set to zero there."""
    tops = [298, 303, 412, 250, 321, 312, 300, 310]
    counts = np.concatenate([np.arange(-106, 60, 5), *(np.arange(k % 7, top, 5) for k, top in enumerate(tops))])
    assert not angle_unit(counts.astype(float)).wrapped
