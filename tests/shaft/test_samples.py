"""The sample gate: what is refused and why, however the samples come in blocks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from textile_twin_core.errors import MotionError
from textile_twin_core.shaft import create_estimator

TURN = 2 * np.pi


def test_each_refusal_is_counted_by_its_cause() -> None:
    estimator = create_estimator("causal")
    stamps = np.array([0, 10, 10, 20, 15, 30, 40, 40, 35, 50])
    angles = np.array([0.0, 0.1, 0.1, np.nan, 0.15, np.inf, 0.4, 0.4, 0.4, 0.5])
    states = estimator.step(stamps, angles)
    report = estimator.report
    assert states.index.tolist() == [4, 6, 9]  # of 0, 1, 4, 6, 9 the first two begin the motion
    assert states.stamps.tolist() == [15, 40, 50]
    assert states.stamps.dtype == np.int64
    assert report.rejected == {"not_finite": 2, "duplicate_stamp": 2, "older_stamp": 1}
    assert (report.received, report.accepted, report.rejected_total) == (10, 5, 5)
    assert "2 not finite" in report.text()


def test_stamps_that_are_not_finite_are_refused() -> None:
    estimator = create_estimator("causal")
    estimator.step([0.0, np.nan, 0.1, np.inf, 0.2], np.arange(5) * 0.01)
    assert estimator.report.accepted == 3
    assert estimator.report.rejected["not_finite"] == 2


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 30), st.sampled_from([0.0, 0.1, np.nan])), min_size=1, max_size=60),
    st.lists(st.integers(1, 9), min_size=60, max_size=60),
)
def test_blocks_do_not_matter(samples: list[tuple[int, float]], cuts: list[int]) -> None:
    stamps = np.array([sample[0] for sample in samples])
    angles = np.array([sample[1] for sample in samples])
    whole, pieces = create_estimator("causal"), create_estimator("causal")
    one = whole.step(stamps, angles)
    parts, at = [], 0
    for cut in cuts:
        parts.append(pieces.step(stamps[at : at + cut], angles[at : at + cut]))
        at += cut
    assert one.index.tolist() == [i for part in parts for i in part.index.tolist()]
    assert one.omega_rad_s.tolist() == [w for part in parts for w in part.omega_rad_s.tolist()]
    assert whole.report == pieces.report
    newest, accepted = -1, 0
    for stamp, angle in zip(stamps, angles, strict=True):  # the rule, sample by sample
        if np.isfinite(angle) and stamp > newest:
            newest = stamp
            accepted += 1
    assert whole.report.accepted == accepted


def test_the_callers_mistakes_are_named() -> None:
    estimator = create_estimator("causal")
    with pytest.raises(MotionError, match=r"3 stamps .* but 2 angles"):
        estimator.step([1, 2, 3], [0.0, 1.0])
    with pytest.raises(MotionError, match="velocities"):
        estimator.step([1, 2], [0.0, 1.0], [1.0])
    with pytest.raises(MotionError, match="of type <U1"):
        estimator.step(["a"], [0.0])  # type: ignore[list-item]
    estimator.step([1], [0.0])
    with pytest.raises(MotionError, match="integer nanoseconds"):
        estimator.step([1.5], [0.0])


@pytest.mark.parametrize("start", [0.0, -np.pi, -1.0])
@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("period", [TURN, TURN / 2])
def test_wrapped_angles_of_any_range_and_period_are_unwrapped(start: float, sense: int, period: float) -> None:
    theta = sense * np.arange(0, 40, 0.1)
    raw = np.mod(theta - start, period) + start
    states = create_estimator("causal", period_rad=period).step(np.arange(theta.size) * 0.01, raw)
    assert np.allclose(np.diff(states.theta_rad)[20:], sense * 0.1, atol=1e-4)


def test_counting_angles_keep_their_count() -> None:
    far = 1e9 + np.arange(0, 90, 0.25)
    states = create_estimator("causal").step(np.arange(far.size) * 0.01, far)
    assert np.allclose(states.theta_rad[100:], far[102:], atol=1e-4)
