"""The IFToMM multibody benchmark A02, N four-bar windows: 1 m rods of 1 kg under gravity pass singular positions.

Gonzalez, Dopico, Luaces, Cuadrado 2006: all rods upright at first, the upper joints at 1 m/s; twice a turn all links
lie in one line, where the mechanism could go on with N + 1 degrees of freedom. With N = 2 Exudyn's own test
(fourBarMechanismIftomm.py, generalised-alpha, 10 s) prints a largest energy error of 0.114 J with steps of 1e-2 s,
1.14e-3 J with 1e-3 s and 1.8e-5 J with 1.25e-4 s, and then has the first upper joint at (0.32845738, 0.94451879) m.
"""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import Crank, RRRDyad

TIMES = np.linspace(0.0, 10.0, 1001)


def windows(count: int) -> Machine:
    points = {f"A{k}": (float(k), 0.0) for k in range(count + 1)}
    upright = Crank("rod0", at="A0", end="B0", length_m=1.0)
    dyads = (
        RRRDyad(f"beam{k}", f"rod{k}", f"B{k - 1}", f"A{k}", f"B{k}", (1.0, 1.0), branch="left_passing")
        for k in range(1, count + 1)
    )
    links = ["rod0", *(f"{kind}{k}" for k in range(1, count + 1) for kind in ("beam", "rod"))]
    return Machine("windows", points, (upright, *dyads), tuple(Body(link, 1.0, 1.0 / 12.0) for link in links))


def exact_angle(count: int, time: float) -> float:
    """The mechanism stays a row of parallelograms, so it is a pendulum: rods turn, beams go round without turning."""
    with mp.workdps(40):
        inertia = (count + 1) / mp.mpf(3) + count
        squared = mp.mpf("9.81") * ((count + 1) / mp.mpf(2) + count) / inertia
        m = (1 + 4 * squared) / (4 * squared)  # speed below over twice the small swing's, squared
        phase = mp.ellipk(1 / m) + mp.sqrt(m * squared) * time
        whole = 2 * mp.ellipk(1 / m)
        turns = mp.floor(phase / whole + mp.mpf(1) / 2)
        half = mp.asin(mp.ellipfun("sn", phase - turns * whole, 1 / m)) + turns * mp.pi
        return float(mp.pi / 2 - (2 * half - mp.pi))


@pytest.mark.parametrize("count", [1, 2, 40])
def test_it_stays_a_row_of_parallelograms(count: int) -> None:
    outputs = [f"point_B{count}_x_m", f"point_B{count}_y_m", "equivalent_inertia_kgm2"]
    theta = np.concatenate([np.linspace(-7.0, 7.0, 57), math.pi * np.arange(-3, 4), math.pi + np.array([-1e-9, 1e-9])])
    x, y, inertia = ttc.compile(windows(count), outputs, method="exact").evaluate(theta).values()
    assert np.abs(x - count - np.cos(theta)).max() < 2e-15 * count + 1e-15
    assert np.abs(y - np.sin(theta)).max() < 1e-15
    assert np.allclose(inertia, (count + 1) / 3.0 + count, rtol=1e-14)


# tolerance of a step, and the steps and the energy error [J] it may not exceed
WORK = [(1e-6, 80, 2e-3), (1e-8, 150, 1.8e-5), (1e-10, 250, 1e-7), (1e-12, 450, 2e-9)]


@pytest.mark.parametrize(("tolerance", "most_steps", "error_J"), WORK)
def test_energy_against_cost(tolerance: float, most_steps: int, error_J: float) -> None:
    run = ttc.drive(windows(2), 0.0, math.pi / 2, -1.0, TIMES, tolerance=tolerance)
    assert run.steps < most_steps
    assert np.abs(run.energy_error_J).max() < error_J
    assert run.events == ()


@pytest.mark.parametrize("count", [2, 40])
def test_the_state_after_ten_seconds(count: int) -> None:
    run = ttc.drive(windows(count), 0.0, math.pi / 2, -1.0, TIMES, tolerance=1e-13)
    assert run.theta_rad[-1] == pytest.approx(exact_angle(count, 10.0), abs=3e-9)
    if count == 2:
        joint = math.cos(run.theta_rad[-1]), math.sin(run.theta_rad[-1])
        assert joint == pytest.approx((0.3284573768, 0.9445187937), abs=1e-6)  # Exudyn's finest step
