"""The sample gate: what is refused and why, and what a wrapped or counting input becomes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from textile_twin_core.errors import MotionError
from textile_twin_core.shaft.gate import SampleGate, Unwrapper
from textile_twin_core.shaft.report import SampleReport

TURN = 2 * np.pi


def test_each_refusal_is_counted_by_its_cause() -> None:
    report = SampleReport()
    stamps = np.array([0, 10, 10, 20, 15, 30, 40, 40, 35, 50])
    angles = np.array([0.0, 1.0, 1.0, np.nan, 0.5, np.inf, 2.0, 2.0, 2.0, 3.0])
    block = SampleGate(report).admit(stamps, angles)
    assert block.index.tolist() == [0, 1, 4, 6, 9]
    assert block.stamps.tolist() == [0, 10, 15, 40, 50]
    assert block.stamps.dtype == np.int64
    assert report.rejected == {"not_finite": 2, "duplicate_stamp": 2, "older_stamp": 1}
    assert (report.received, report.accepted, report.rejected_total) == (10, 5, 5)
    assert "2 not finite" in report.text()


def test_stamps_that_are_not_finite_are_refused() -> None:
    report = SampleReport()
    block = SampleGate(report).admit([0.0, np.nan, 0.1, np.inf, 0.2], np.zeros(5))
    assert block.stamps.tolist() == [0.0, 0.1, 0.2]
    assert report.rejected["not_finite"] == 2


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 30), st.sampled_from([0.0, 1.0, np.nan])), min_size=1, max_size=60),
    st.lists(st.integers(1, 9), min_size=60, max_size=60),
)
def test_blocks_do_not_matter(samples: list[tuple[int, float]], cuts: list[int]) -> None:
    stamps = np.array([sample[0] for sample in samples])
    angles = np.array([sample[1] for sample in samples])
    whole, pieces = SampleReport(), SampleReport()
    one = SampleGate(whole).admit(stamps, angles)
    gate, parts, at = SampleGate(pieces), [], 0
    for cut in cuts:
        parts.append(gate.admit(stamps[at : at + cut], angles[at : at + cut]))
        at += cut
    assert one.index.tolist() == [i for part in parts for i in part.index.tolist()]
    assert one.step_s.tolist() == [d for part in parts for d in part.step_s.tolist()]
    assert whole == pieces
    newest = -1
    for stamp, angle, place in zip(stamps, angles, range(len(stamps)), strict=True):  # the rule, sample by sample
        accepted = np.isfinite(angle) and stamp > newest
        assert (place in one.index) == accepted
        newest = stamp if accepted else newest


def test_the_callers_mistakes_are_named() -> None:
    gate = SampleGate(SampleReport())
    with pytest.raises(MotionError, match=r"3 stamps .* but 2 angles"):
        gate.admit([1, 2, 3], [0.0, 1.0])
    with pytest.raises(MotionError, match="velocities"):
        gate.admit([1, 2], [0.0, 1.0], [1.0])
    with pytest.raises(MotionError, match="of type <U1"):
        gate.admit(["a"], [0.0])
    gate.admit([1], [0.0])
    with pytest.raises(MotionError, match="integer nanoseconds"):
        gate.admit([1.5], [0.0])


def follow(raw: np.ndarray, **settings: object) -> np.ndarray:
    unwrap = Unwrapper(**{"wrapping": "auto", "period_rad": TURN, **settings})
    local = [unwrap.begin(float(raw[0]))]
    for value in raw[1:]:
        local.append(unwrap.local(float(value), local[-1]))
    return np.array(local) + unwrap.origin * TURN


@pytest.mark.parametrize("start", [0.0, -np.pi, -1.0])
@pytest.mark.parametrize("sense", [1, -1])
def test_wrapped_angles_of_any_range_are_unwrapped(start: float, sense: int) -> None:
    theta = sense * np.arange(0, 40, 0.3)
    raw = np.mod(theta - start, TURN) + start
    assert np.allclose(np.diff(follow(raw)), sense * 0.3, atol=1e-12)


def test_counting_angles_keep_their_count() -> None:
    theta = np.arange(5.0, 60.0, 0.4)
    theta[80:] += 4 * TURN  # counted on while nobody listened
    assert np.allclose(follow(theta), theta, atol=1e-12)
    far = 1e9 + np.arange(0, 30, 0.25)
    assert np.array_equal(np.diff(follow(far)) > 0.2499, np.ones(far.size - 1, dtype=bool))


def test_an_encoder_behind_a_gear_wraps_by_its_own_period() -> None:
    theta = np.arange(0, 40, 0.1)
    raw = np.mod(2.0 * theta, TURN) / 2.0
    assert np.allclose(np.diff(follow(raw, period_rad=TURN / 2)), 0.1, atol=1e-12)
