"""The needle in the backing: its position decides, live and offline, and a needle that never enters is free."""

from __future__ import annotations

import math

import numpy as np
import pytest

import textile_twin_core as ttc

LOAD = "torque_load_Nm"
THETA = np.linspace(0.0, 4.0 * math.pi, 2001)
LOWEST_M = 0.5743
SPEED = 16.755


@pytest.mark.parametrize("method", ["exact", "table"])
@pytest.mark.parametrize("speed", [SPEED, -SPEED])
def test_a_needle_that_never_reaches_the_entry_plane_is_free(method: str, speed: float) -> None:
    shallow = ttc.machines.tufting(entry_plane_m=LOWEST_M + 1e-4, exit_plane_m=0.57)
    found = ttc.compile(shallow, [LOAD], method).evaluate(THETA, speed)[LOAD]  # type: ignore[arg-type]
    free = ttc.compile(ttc.machines.tufting(backing_force_N=0.0), [LOAD], "exact").evaluate(THETA, speed)[LOAD]
    np.testing.assert_allclose(found, free, atol=1e-9)
    assert not [event.name for event in shallow.events() if "backing" in event.name]


def test_a_needle_that_just_reaches_the_plane_has_friction_when_leaving() -> None:
    deep = ttc.machines.tufting(entry_plane_m=LOWEST_M - 1e-4, exit_plane_m=0.57)
    names = sorted(event.name for event in deep.events() if "backing" in event.name)
    assert names == ["needle_enters_backing", "needle_leaves_backing"]
    twin = ttc.compile(deep, [LOAD, "needle_position_m", "needle_velocity_m_s"], "exact")
    found = twin.evaluate(THETA, SPEED)
    out = (found["needle_velocity_m_s"] < -1e-3) & (found["needle_position_m"] > 0.5701)
    way_in = (found["needle_velocity_m_s"] > 1e-3) & (found["needle_position_m"] < LOWEST_M - 2e-4)
    assert out.any() and np.all(found[LOAD][out] > 0.0)
    np.testing.assert_allclose(found[LOAD][way_in], 0.0, atol=1e-9)


@pytest.mark.parametrize("planes", [(0.55784, 0.55784), (0.5580, 0.5575)])
def test_a_record_that_begins_in_the_backing_agrees_with_the_whole_record(planes: tuple[float, float]) -> None:
    """The shaft turns forward, back and forward again; the second record begins with the needle at its lowest."""
    machine = ttc.machines.tufting(entry_plane_m=planes[0], exit_plane_m=planes[1])
    time = np.arange(0.0, 3.0, 0.002)
    theta = math.radians(107.0) + 9.0 * np.sin(1.7 * time)
    stamps = np.asarray(np.rint(time * 1e9), np.int64) + 10**9
    whole, late, single = (ttc.compile(machine, [LOAD], "exact").session("causal") for _ in range(3))
    first = int(np.argmin(np.abs(np.remainder(theta[700:] - math.radians(107.0), 2.0 * math.pi)))) + 700
    every, some = whole.step(stamps, theta), late.step(stamps[first:], theta[first:])
    ones = [sample for k in range(first, time.size) for sample in single.step_one(int(stamps[k]), float(theta[k]))]
    np.testing.assert_allclose([sample.outputs[LOAD] for sample in ones], some[LOAD], atol=1e-9)
    settled = 40
    np.testing.assert_allclose(some[LOAD][settled:], every[LOAD][-len(some) :][settled:], atol=0.05)
    assert np.abs(some[LOAD][: 2 * settled]).max() > 5.0
