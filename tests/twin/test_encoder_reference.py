"""Edges counted into angles, and angles from an index pulse, against wheels whose angle is known at every edge."""

from __future__ import annotations

import math

import numpy as np
import pytest

from textile_twin_core.errors import SceneError
from textile_twin_core.machine import Encoder
from textile_twin_core.twin.encoder_reference import TURN, EdgeCounter, IndexedAngle, Reading, reference_of

TEETH = 60
NAN = math.nan


def wheel(missing: int, turns: float, start_rad: float, ripple: float = 0.2) -> tuple[list[int], list[float]]:
    """Return stamps [ns] and angles [rad] of the edges of a wheel on a shaft at phase + ripple sin(phase)."""
    numbers = np.arange(math.ceil(start_rad * TEETH / TURN), (start_rad + turns * TURN) * TEETH / TURN, dtype=np.int64)
    numbers = numbers[numbers % TEETH < TEETH - missing]
    angles = numbers * TURN / TEETH
    phase = angles.copy()
    for _ in range(60):
        phase -= (phase + ripple * np.sin(phase) - angles) / (1.0 + ripple * np.cos(phase))
    stamps = np.rint(phase / 16.0 * 1e9).astype(np.int64) + 1_700_000_000_000_000_000
    return stamps.tolist(), angles.tolist()


def edges(stamps: list[int]) -> list[Reading]:
    """Return edges as messages carry them."""
    return [(stamp, NAN, NAN) for stamp in stamps]


def off(found: list[Reading], stamps: list[int], angles: list[float]) -> np.ndarray:
    """Return the error of angles modulo whole turns, in pitches of the wheel."""
    truth = dict(zip(stamps, angles, strict=True))
    return np.array([math.remainder(angle - truth[stamp], TURN) for stamp, angle, _ in found]) * TEETH / TURN


@pytest.mark.parametrize("missing", [1, 2, 3])
@pytest.mark.parametrize("start_rad", [0.05, 2.0, 6.2])
def test_teeth_are_counted_from_the_gap(missing: int, start_rad: float) -> None:
    stamps, angles = wheel(missing, 5.0, start_rad)
    counter = EdgeCounter(TEETH, missing, index=False)
    found = counter.take(edges(stamps))
    assert np.abs(off(found, stamps, angles)).max() < 1e-9
    assert np.all(np.diff([angle for _, angle, _ in found]) > 0.0)
    # All edges after the first gap; the very first edge has no interval before it.
    assert len(stamps) - len(found) == counter.counts["unreferenced"] <= TEETH - missing + 2
    assert counter.counts["miscounts"] == 0


@pytest.mark.parametrize("missing", [1, 2])
@pytest.mark.parametrize("fault", ["lost", "doubled"])
def test_an_edge_lost_or_too_much_is_found_within_two_turns(missing: int, fault: str) -> None:
    stamps, angles = wheel(missing, 9.0, 1.0)
    place = 4 * TEETH + 17
    given = stamps.copy()
    if fault == "lost":
        del given[place]
    else:
        given.insert(place, (given[place - 1] + 3 * given[place]) // 4)
    counter = EdgeCounter(TEETH, missing, index=False)
    found = [reading for reading in counter.take(edges(given)) if reading[0] in set(stamps)]
    wrong = off(found, stamps, angles)
    at = [stamp for stamp, _, _ in found]
    before, after = at.index(stamps[place - 1]), at.index(stamps[place + 2 * TEETH])
    assert np.abs(wrong[:before]).max() < 1e-9 and np.abs(wrong[after:]).max() < 1e-9
    assert np.abs(wrong).max() <= 1.0 + missing + 1e-9
    assert counter.counts["miscounts"] == 1


@pytest.mark.parametrize("late", [0, 1, 7, 100])
def test_a_late_pulse_gives_the_same_angles(late: int) -> None:
    stamps, angles = wheel(0, 4.0, 2.0)
    counter = EdgeCounter(TEETH, 0, index=True)
    first = next(k for k, angle in enumerate(angles) if angle > TURN - 1e-6)
    pulse = stamps[first] - 1000
    found = (
        counter.take(edges(stamps[: first + late])) + counter.index(pulse) + counter.take(edges(stamps[first + late :]))
    )
    assert [stamp for stamp, _, _ in found] == stamps[first:]
    assert np.abs(off(found, stamps, angles)).max() < 1e-9


def test_a_pulse_elsewhere_than_counted_sets_the_count_right_at_once() -> None:
    stamps, angles = wheel(0, 6.0, 0.0)
    pulses = {k: stamps[k] - 1000 for k in range(TEETH, len(stamps), TEETH)}
    counter = EdgeCounter(TEETH, 0, index=True)
    found = []
    for k, stamp in enumerate(stamps):
        if k in pulses:
            found += counter.index(pulses[k])
        if k != 3 * TEETH + 30:
            found += counter.take(edges([stamp]))
    wrong = off(found, stamps, angles)
    assert np.abs(wrong[: 2 * TEETH]).max() < 1e-9 and np.abs(wrong[3 * TEETH :]).max() < 1e-9
    assert np.allclose(wrong[2 * TEETH + 30 : 3 * TEETH - 1], -1.0)
    assert counter.counts["miscounts"] == 1


def turning(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps [ns] and true angles [rad] of a shaft at 16 rad/s, at 1 kHz."""
    time = np.arange(count) * 1e-3
    return np.rint(time * 1e9).astype(np.int64), 16.0 * time + 0.1 * np.sin(16.0 * time)


@pytest.mark.parametrize("switched_on_at", [-2.0, 0.3, 5.0])
@pytest.mark.parametrize("late", [0, 3, 200])
@pytest.mark.parametrize("wrapped", [True, False])
def test_angles_from_the_index(switched_on_at: float, late: int, wrapped: bool) -> None:
    stamps, truth = turning(2000)
    shown = truth - switched_on_at
    shown = np.mod(shown, TURN) if wrapped else shown
    readings = [(int(stamp), float(angle), 1.0) for stamp, angle in zip(stamps, shown, strict=True)]
    crossing = float(np.interp(TURN, truth, stamps))
    first = int(np.searchsorted(stamps, crossing, side="right"))
    indexed = IndexedAngle()
    found = (
        indexed.take(readings[: first + late]) + indexed.index(round(crossing)) + indexed.take(readings[first + late :])
    )
    assert [stamp for stamp, _, _ in found] == stamps[first:].tolist()
    wrong = [math.remainder(angle - true, TURN) for (_, angle, _), true in zip(found, truth[first:], strict=True)]
    assert np.abs(wrong).max() < 1e-5  # error of linear interpolation between two readings
    assert {speed for _, _, speed in found} == {1.0} and indexed.counts["unreferenced"] == first


def test_an_encoder_that_slips_is_set_right_by_the_next_pulse() -> None:
    stamps, truth = turning(2000)
    slipped = truth + 0.5 + 0.2 * (np.arange(2000) > 900)
    crossings = [float(np.interp(turn * TURN, truth, stamps)) for turn in (1, 2, 3, 4, 5)]
    indexed, found = IndexedAngle(), []
    for stamp, angle in zip(stamps.tolist(), slipped.tolist(), strict=True):
        while crossings and stamp > crossings[0]:
            found += indexed.index(round(crossings.pop(0)))
        found += indexed.take([(stamp, angle, NAN)])
    at = dict(zip(stamps.tolist(), truth.tolist(), strict=True))
    wrong = np.array([math.remainder(angle - at[stamp], TURN) for stamp, angle, _ in found])
    assert np.abs(wrong[-300:]).max() < 1e-4 and np.abs(wrong).max() == pytest.approx(0.2, abs=1e-4)
    assert indexed.counts["miscounts"] == 1


def test_stamps_that_go_back() -> None:
    stamps, angles = wheel(2, 4.0, 1.0)
    counter = EdgeCounter(TEETH, 2, index=False)
    once = counter.take(edges(stamps))
    assert counter.take(edges([stamps[-5], stamps[-1]])) == [] and counter.counts["older"] == 2
    again = counter.take(edges(stamps))
    assert np.abs(off(once + again, stamps, angles)).max() < 1e-9
    assert len(again) >= len(once) - 10


@pytest.mark.parametrize(
    ("encoder", "index", "text"),
    [
        (Encoder(), False, "number of teeth"),
        (Encoder(teeth=60), False, "missing_teeth"),
        (Encoder(), True, "number of"),
    ],
)
def test_edges_without_a_reference_are_refused(encoder: Encoder, index: bool, text: str) -> None:
    with pytest.raises(SceneError, match=text):
        reference_of(encoder, edges=True, index=index)
