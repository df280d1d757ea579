"""Tables: tolerance, exact discontinuities, large angles, and the reached error against the true one."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from tests.generators.tufting_truth import truth
from textile_twin_core.expression import loop
from textile_twin_core.machine import ShaftPlace

SPEED = 160.0 * 2.0 * math.pi / 60.0
TORQUE = "balancing_torque_Nm"


@pytest.fixture(autouse=True)
def compiled_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile loops at once, however short a block is; otherwise short blocks are evaluated exactly."""
    monkeypatch.setattr(loop, "LONG", 1)
    monkeypatch.setattr(loop, "WORTH", 1)


@pytest.fixture(scope="module")
def machine() -> ttc.Machine:
    return ttc.machines.tufting()


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("share", [0.2, 1.0, 5.0])
def test_tolerance_holds_at_every_speed(machine: ttc.Machine, tolerance: float, share: float) -> None:
    rng = np.random.default_rng(3)
    theta, alpha = rng.uniform(-50.0, 50.0, 20000), rng.uniform(-1, 1, 20000) * 0.1 * (share * SPEED) ** 2
    exact = ttc.compile(machine, [TORQUE, "needle_position_m"], "exact").evaluate(theta, share * SPEED, alpha)
    table = ttc.compile(machine, [TORQUE, "needle_position_m"], "table", tolerance).evaluate(
        theta, share * SPEED, alpha
    )
    for name, values in exact.items():
        assert np.abs(table[name] - values).max() <= 1.2 * tolerance * np.abs(values).max(), name


def test_entry_and_exit_stay_exact(machine: ttc.Machine) -> None:
    """Check with a coarse table that the torque is on the correct side within 1e-12 rad of the discontinuity."""
    table = ttc.compile(machine, [TORQUE], "table", 1e-3)
    exact = ttc.compile(machine, [TORQUE], "exact")
    for event in machine.events():
        if "backing" not in event.name:
            continue
        near = event.angle_rad + np.array([-1e-12, 1e-12]) + 2.0 * math.pi * 5
        a, b = (t.evaluate(near, SPEED, 0.0)[TORQUE] for t in (table, exact))
        assert np.abs(a - b).max() < 0.02  # the step is 16 N m
        single = [table.evaluate(float(x), SPEED, 0.0)[TORQUE] for x in near]
        assert np.abs(np.array(single) - b).max() < 0.02


def test_a_billion_radians_keep_their_phase(machine: ttc.Machine) -> None:
    theta = 1e9 + np.linspace(0.0, 7.0, 50)
    exact = np.array([float(truth(float(t), SPEED, 20.0, reactions=False)[TORQUE]) for t in theta])
    for method in ("exact", "table"):
        twin = ttc.compile(machine, [TORQUE], method, 1e-13)
        assert np.abs(twin.evaluate(theta, SPEED, 20.0)[TORQUE] - exact).max() < 2e-12
        single = [twin.evaluate(float(t), SPEED, 20.0)[TORQUE] for t in theta]
        assert np.abs(np.array(single) - exact).max() < 2e-12


@cache
def exact_values(output: str) -> tuple[np.ndarray, np.ndarray]:
    """Random angles and an output there to 50 digits; the truth of joint forces takes longer, so it has fewer."""
    reactions = output == "driven_shaft_torque_Nm"
    theta = np.random.default_rng(11).uniform(0.0, 2.0 * math.pi, 100 if reactions else 300)
    return theta, np.array([float(truth(t, SPEED, 12.0, reactions=reactions)[output]) for t in theta.tolist()])


@pytest.mark.parametrize(
    ("method", "tolerance"), [("exact", 1e-12), ("table", 1e-6), ("table", 1e-10), ("table", 1e-13)]
)
@pytest.mark.parametrize("output", [TORQUE, "needle_position_m", "driven_shaft_torque_Nm"])
def test_reached_error_is_honest(machine: ttc.Machine, method: str, tolerance: float, output: str) -> None:
    """Check against 50 digits at random angles: never above the reached error, and at least a tenth of it or of
    1e-15.
    """
    twin = ttc.compile(machine, [output], method, tolerance)
    theta, exact = exact_values(output)
    found = twin.evaluate(theta, SPEED, 12.0)[output]
    error = np.abs(found - exact).max() / np.abs(exact).max()
    assert error <= max(twin.reached_error, 1e-15)
    assert error >= 0.1 * max(twin.reached_error, 1e-15) or error < 1e-15


@pytest.mark.parametrize(("method", "force_N"), [("table", 901.0), ("auto", 902.0)])
def test_reached_error_asked_first_is_that_of_the_table(
    monkeypatch: pytest.MonkeyPatch, method: str, force_N: float
) -> None:
    """Ask before any loop of this machine is compiled, when blocks would be evaluated by the closed forms."""
    monkeypatch.undo()  # with the usual thresholds
    machine = ttc.machines.tufting(backing_force_N=force_N)
    twin = ttc.compile(machine, [TORQUE], method, 1e-3)
    reached = twin.reached_error
    theta = np.random.default_rng(12).uniform(0.0, 2.0 * math.pi, 200_000)
    exact = ttc.compile(machine, [TORQUE], "exact").evaluate(theta, SPEED, 0.0)[TORQUE]
    error = np.abs(twin.evaluate(theta, SPEED, 0.0)[TORQUE] - exact).max() / np.abs(exact).max()
    assert 1e-5 < error <= reached <= 3e-3


def test_nan_and_infinity_pass_through_a_table(machine: ttc.Machine) -> None:
    twin = ttc.compile(machine, [TORQUE], "table", 1e-9)
    r = twin.evaluate(np.array([0.5, math.nan, math.inf, 1.0]), SPEED, 0.0)[TORQUE]
    assert np.isnan(r).tolist() == [False, True, True, False]


@pytest.mark.campaign
@pytest.mark.slow
def test_many_linkages_with_events_at_the_origin(machine: ttc.Machine) -> None:
    """Check phases that put entries and exits on both sides of angle 0."""
    entry = machine.events()[0].angle_rad
    places = tuple(ShaftPlace(p) for p in (entry, entry - 0.01, entry + 0.01))
    mill = replace(machine, linkages=places)
    rng = np.random.default_rng(5)
    theta = np.concatenate([rng.uniform(-0.05, 0.05, 5000), rng.uniform(-9, 9, 5000)])
    exact = ttc.compile(mill, [TORQUE], "exact").evaluate(theta, SPEED, 5.0)[TORQUE]
    table = ttc.compile(mill, [TORQUE], "table", 1e-10).evaluate(theta, SPEED, 5.0)[TORQUE]
    assert np.abs(table - exact).max() <= 1.2e-10 * np.abs(exact).max()


@pytest.mark.slow
@pytest.mark.parametrize("speed", [-SPEED, *more(SPEED, 0.0)])
def test_every_direction_and_every_number_of_steps_in_an_interval(machine: ttc.Machine, speed: float) -> None:
    """Check a coarse table with several discontinuities in one interval: each sample uses the piece between two
    of them.
    """
    entry = machine.events()[0].angle_rad
    places = tuple(ShaftPlace(p) for p in (entry + 0.005, entry - 0.004, entry - 0.009))
    mill = replace(machine, linkages=places)
    rng = np.random.default_rng(6)
    theta = np.concatenate([rng.uniform(-0.05, 0.05, 4000), rng.uniform(0.0, 2.0 * math.pi, 4000)])
    exact = ttc.compile(mill, [TORQUE], "exact").evaluate(theta, speed, 5.0)[TORQUE]
    table = ttc.compile(mill, [TORQUE], "table", 1e-4)
    found = table.evaluate(theta, speed, 5.0)[TORQUE]
    assert np.abs(found - exact).max() <= 1.2e-4 * np.abs(exact).max()
    single = [table.evaluate(float(t), speed, 5.0)[TORQUE] for t in theta[::7]]  # from the closed forms
    assert np.abs(np.array(single) - exact[::7]).max() <= 1e-13 * np.abs(exact).max()


def test_mixed_directions_and_an_unknown_speed(machine: ttc.Machine) -> None:
    """Check that friction follows the sign of each speed; a NaN speed gives a NaN torque but a finite position."""
    rng = np.random.default_rng(8)
    theta, omega = rng.uniform(0.0, 7.0, 999), rng.choice([-SPEED, -1e-9, 0.0, 1e-9, SPEED], 999)
    outputs = [TORQUE, "needle_position_m"]
    exact, table = (ttc.compile(machine, outputs, m, 1e-12).evaluate(theta, omega, 3.0) for m in ("exact", "table"))
    for name in outputs:
        assert np.abs(table[name] - exact[name]).max() <= 1.2e-12 * np.abs(exact[name]).max()
    twin = ttc.compile(machine, outputs, "table", 1e-9)
    unknown = twin.evaluate(np.array([0.5, 1.0]), np.array([math.nan, SPEED]), 0.0)
    assert np.isnan(unknown[TORQUE]).tolist() == [True, False]
    assert np.isfinite(unknown["needle_position_m"]).all()
    assert math.isnan(twin.evaluate(0.5, math.nan, 0.0)[TORQUE])


def test_plan_counts_why_the_position_is_cheap(machine: ttc.Machine) -> None:
    torque, position = (ttc.compile(machine, [o], "table", 1e-13) for o in (TORQUE, "needle_position_m"))
    assert "3 functions of the shaft angle" in torque.describe()
    assert "1 functions of the shaft angle" in position.describe()
    assert "load backing: dropped" in position.describe()
    assert "l6 with its body" in position.describe()


def test_unreachable_tolerance_says_what_to_do(machine: ttc.Machine) -> None:
    with pytest.raises(ttc.SceneError, match="use method 'exact'"):
        ttc.compile(machine, [TORQUE], "table", 1e-17)


def test_memory_stays_within_16_mib_beyond_input_and_output(machine: ttc.Machine) -> None:
    import tracemalloc

    n = 10_000_000
    theta, omega, alpha, out = np.linspace(0.0, 1e5, n), np.full(n, SPEED), np.zeros(n), {TORQUE: np.empty(n)}
    for method in ("exact", "table"):
        twin = ttc.compile(machine, [TORQUE], method, 1e-13)
        tracemalloc.start()
        twin.evaluate(theta, omega, alpha, out=out)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 16 * 2**20
