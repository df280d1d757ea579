"""Residuals of streams: equal to interpolation of the whole record, for any order of arrival of the samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import textile_twin_core as ttc
from textile_twin_core.comparison.residual import Residual, ResidualStream, load_steps
from textile_twin_core.machine import TorqueSensor

MS = 1_000_000


def predictions(count: int) -> tuple[list[int], list[float], list[float]]:
    """Stamps [ns], torques and angles of a smooth prediction, every 2 ms."""
    stamps = [1_700_000_000_000 * MS + 2 * MS * k for k in range(count)]
    return stamps, [math.sin(0.1 * k) for k in range(count)], [0.05 * k for k in range(count)]


@given(
    order=st.randoms(use_true_random=False),
    gain=st.floats(0.5, 2.0),
    offset=st.floats(-1.0, 1.0),
    delay_ms=st.floats(-5.0, 5.0),
)
def test_residual_is_that_of_the_whole_record(order: object, gain: float, offset: float, delay_ms: float) -> None:
    stamps, torques, thetas = predictions(80)
    measured = [(stamps[0] + round((1.37 * k + 0.4) * MS), 0.3 * math.cos(0.2 * k)) for k in range(90)]
    stream = ResidualStream(TorqueSensor(gain, offset, delay_ms * 1e-3))
    found: list[Residual] = []
    coming = [("predicted", k) for k in range(len(stamps))] + [("measured", k) for k in range(len(measured))]
    # Each stream keeps its own order; the two are interleaved at random.
    kinds = [kind for kind, _ in coming]
    order.shuffle(kinds)  # type: ignore[attr-defined]
    places = {"predicted": iter(range(len(stamps))), "measured": iter(range(len(measured)))}
    for kind in kinds:
        k = next(places[kind])
        if kind == "predicted":
            found += stream.predicted([stamps[k]], [torques[k]], [thetas[k]])
        else:
            found += stream.measured(*measured[k])
    at = np.array([stamp - stamps[0] - round(delay_ms * MS) for stamp, _ in measured], dtype=float)
    known = (at >= 0) & (at <= stamps[-1] - stamps[0])
    expected = np.interp(at, np.array(stamps) - stamps[0], torques)
    assert [item.stamp_ns for item in found] == [
        stamp for (stamp, _), there in zip(measured, known, strict=True) if there
    ]
    values = np.array([torque for _, torque in measured])[known] - (gain * expected[known] + offset)
    np.testing.assert_allclose([item.residual_Nm for item in found], values, rtol=0.0, atol=1e-12)
    assert stream.given == len(found)
    assert stream.rms_Nm == pytest.approx(math.sqrt(np.mean(values**2)))


def test_there_is_no_residual_over_gaps_and_steps() -> None:
    stamps, torques, thetas = predictions(40)
    del stamps[10:36], torques[10:36], thetas[10:36]
    stream = ResidualStream(TorqueSensor(), jump_angles_rad=(0.12, 2.0 * math.pi - 0.3))
    stream.predicted(stamps, torques, thetas)
    first = stamps[0]
    assert stream.measured(first - MS, 0.0) == []
    assert len(stream.measured(first + 3 * MS, 0.0)) == 1
    assert stream.measured(first + 5 * MS, 0.0) == []  # theta from 0.10 to 0.15
    assert len(stream.measured(first + 6 * MS, 0.0)) == 1  # a prediction of that very stamp holds
    assert stream.measured(first + 40 * MS, 0.0) == []
    assert stream.skipped == {"before the first prediction": 1, "load jumps there": 1, "gap between predictions": 1}


def test_a_place_where_the_machine_cannot_close_costs_its_own_residuals_alone() -> None:
    stamps, torques, thetas = predictions(80)
    torques[40] = math.nan
    stream = ResidualStream(TorqueSensor())
    stream.predicted(stamps, torques, thetas)
    found = [stream.measured(stamp + MS, 0.0) for stamp in stamps[:-1]]
    assert [k for k, each in enumerate(found) if not each] == [39, 40]
    assert math.isfinite(stream.rms_Nm) and stream.given == 77
    assert stream.skipped == {"prediction is not finite": 2}


def test_bad_samples_are_counted() -> None:
    stamps, torques, thetas = predictions(20)
    stream = ResidualStream(TorqueSensor())
    stream.predicted(stamps, torques, thetas)
    assert stream.measured(stamps[1], math.nan) == []
    assert len(stream.measured(stamps[5], 1.0)) == 1
    assert stream.measured(stamps[5], 1.0) == stream.measured(stamps[4], 1.0) == []
    assert stream.skipped == {"not finite": 1, "stamp not after the one before": 2}
    assert math.isnan(ResidualStream(TorqueSensor()).rms_Nm)
    stream.reset()
    assert (stream.given, dict(stream.skipped)) == (0, {})


def test_residuals_resume_after_a_faulty_clock() -> None:
    """One stamp a day ahead, and in the second half a clock an hour behind, then corrected."""
    stream = ResidualStream(TorqueSensor())
    second = 10**9
    day, hour = 86_400 * second, 3_600 * second
    told = []
    for number in range(400):
        stamp = day + number * 10_000_000
        stream.predicted((stamp,), (1.0,), (0.0,))
        behind = hour if 200 <= number < 300 else 0
        told += stream.measured(stamp + (day if number == 50 else 0) - behind, 1.5)
    stamps = [(item.stamp_ns - day) // 10_000_000 for item in told]
    # Nine samples pass until the restart of the clock is certain; an hour ago there is no prediction.
    assert stamps == [*range(50), *range(60, 200), *range(300, 400)]
    assert {item.residual_Nm for item in told} == {0.5}


def test_memory_is_bounded() -> None:
    stream = ResidualStream(TorqueSensor(), memory_s=0.1)
    for k in range(5000):
        stream.measured(2 * MS * k, 0.0)
    assert stream.skipped["no prediction came"] == 5000 - 51
    silent = ResidualStream(TorqueSensor(), memory_s=0.1)
    for k in range(5000):
        silent.predicted([2 * MS * k], [0.0], [0.0])
    assert silent.measured(2 * MS * 4990, 1.0) == [Residual(2 * MS * 4990, 1.0)]
    assert len(silent._stamps) <= 101


def test_the_load_of_the_tufting_machine_steps_at_entry_and_exit() -> None:
    twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
    # Entry and exit of the needle at 557.84 mm (Xu et al. 2016).
    np.testing.assert_allclose(np.rad2deg(load_steps(twin)), [21.9512, 193.9262], atol=5e-4)
    free = ttc.compile(ttc.machines.tufting(backing_force_N=0.0), outputs=["balancing_torque_Nm"])
    assert load_steps(free) == ()
