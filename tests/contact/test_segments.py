"""Stretches between events: linear ones against the matrix exponential with 50 digits, the pad against Duffing's."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from textile_twin_core.contact import (
    FRAME,
    ContactIntegrator,
    ContactModel,
    ContactRun,
    DrivePiece,
    Pad,
    SlidingBody,
    SpringDamper,
    run_contact,
)
from textile_twin_core.mechanism.motion_law import Section

STILL = Section((0.0,))


def still(end_s: float) -> list[DrivePiece]:
    return [DrivePiece(0.0, end_s, STILL, (0.0,))]


def last(run: ContactRun) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities of the bodies at the end."""
    return run.positions[:-1, -1], run.velocities[:-1, -1]


@pytest.mark.parametrize("seed", range(6))
def test_linear_motion_is_the_matrix_exponential(seed: int) -> None:
    """Two bodies on springs and dampers; the drive is polynomial plus harmonic, and obeys w' = S w itself."""
    random = np.random.default_rng(seed)
    mass = random.uniform(0.005, 0.05, 2)
    k, b = random.uniform(100.0, 1000.0, 3), random.uniform(0.0, 15.0, 3)
    free = random.uniform(-0.05, 0.05, 3)
    model = ContactModel(
        "drive",
        (SlidingBody("a", mass[0], 0.3), SlidingBody("b", mass[1])),
        (
            SpringDamper("s0", "drive", "a", k[0], b[0], free[0]),
            SpringDamper("s1", "a", "b", k[1], b[1], free[1]),
            SpringDamper("s2", FRAME, "b", k[2], b[2], free[2]),
        ),
    )
    frequency, amplitude, phase, slope, bend = 300.0, 0.004, 0.7, 0.3, -2.0
    end = 0.3
    section = Section((0.0, slope, bend), amplitude, frequency, phase)
    start = [0.01, -0.02]
    offset = amplitude * math.sin(phase)
    run = run_contact(
        ContactIntegrator(model), start, [DrivePiece(0.0, end, section, (0.0, 1.0))], velocities_m_s=[0.4, -0.2]
    )
    with mp.workdps(50):
        # state: a, b, va, vb, then 1, t, t^2/2, sin, cos
        system = mp.zeros(9, 9)
        system[0, 2] = system[1, 3] = 1
        m = [mp.mpf(float(x)) for x in mass]
        ks, bs, fs = ([mp.mpf(float(x)) for x in values] for values in (k, b, free))
        system[2, 0], system[2, 1], system[2, 2], system[2, 3] = (
            -(ks[0] + ks[1]) / m[0],
            ks[1] / m[0],
            -(bs[0] + bs[1]) / m[0],
            bs[1] / m[0],
        )
        system[3, 0], system[3, 1], system[3, 2], system[3, 3] = (
            ks[1] / m[1],
            -(ks[1] + ks[2]) / m[1],
            bs[1] / m[1],
            -(bs[1] + bs[2]) / m[1],
        )
        system[2, 4] = (ks[0] * fs[0] - ks[1] * fs[1] + mp.mpf(0.3)) / m[0]
        system[3, 4] = (ks[1] * fs[1] + ks[2] * fs[2]) / m[1]
        w, c = mp.mpf(frequency), mp.mpf(amplitude)
        # x_drive = slope t + bend t^2 + c sin, v_drive = slope + 2 bend t + c w cos
        system[2, 5] += ks[0] * mp.mpf(slope) / m[0]
        system[2, 6] += ks[0] * 2 * mp.mpf(bend) / m[0]
        system[2, 7] += ks[0] * c / m[0]
        system[2, 4] += bs[0] * mp.mpf(slope) / m[0]
        system[2, 5] += bs[0] * 2 * mp.mpf(bend) / m[0]
        system[2, 8] += bs[0] * c * w / m[0]
        system[5, 4] = system[6, 5] = 1
        system[7, 8], system[8, 7] = w, -w
        first = [start[0], start[1], 0.4, -0.2, 1, 0, 0, mp.sin(mp.mpf(phase)), mp.cos(mp.mpf(phase))]
        exact = mp.expm(system * mp.mpf(end), method="taylor") * mp.matrix(first)
        truth = [float(exact[i]) for i in range(4)]
    positions, velocities = last(run)
    assert abs(offset) > 0.0
    assert positions == pytest.approx(truth[:2], abs=2e-15)
    assert velocities == pytest.approx(truth[2:], abs=1e-12)


@pytest.mark.parametrize(("linear", "cubic"), [(4e5, 1.5e12), (4e9, 1.5e16), (1e3, 0.0), (0.0, 1e12)])
def test_undamped_pad_is_duffings_oscillator(linear: float, cubic: float) -> None:
    """A body thrown on a pad comes back after half a period, which an elliptic integral gives to any digit."""
    mass, speed = 0.0426, 2.5
    pad = Pad("pad", FRAME, "body", 0.1, (linear, 0.0, cubic))
    model = ContactModel("drive", (SlidingBody("body", mass),), pads=(pad,))
    run = run_contact(ContactIntegrator(model, 1e-14), [0.0], still(0.2), velocities_m_s=[speed])
    touch, leave = run.happened("touch", "pad")[0].time_s, run.happened("leave", "pad")[0].time_s
    with mp.workdps(30):
        m, k, c = mp.mpf(mass), mp.mpf(linear), mp.mpf(cubic)
        energy = m * mp.mpf(speed) ** 2 / 2
        deepest = mp.sqrt((-k + mp.sqrt(k * k + 4 * c * energy)) / c) if c else mp.sqrt(2 * energy / k)
        frequency = mp.sqrt((k + c * deepest**2) / m)
        modulus = c * deepest**2 / (2 * (k + c * deepest**2))
        exact = float(2 * mp.ellipk(modulus) / frequency)
    assert touch == pytest.approx(0.04, abs=1e-16)
    assert leave - touch == pytest.approx(exact, rel=1e-12)
    assert run.velocities[0, -1] == pytest.approx(-speed, rel=1e-11)  # the deepest point is 24 um in 0.1 m


def test_damped_linear_pad_lets_go_where_its_force_would_pull() -> None:
    """k c + b v = 0 has a closed form for a linear pad; the element keeps the velocity it has there."""
    mass, k, b, speed = 0.05, 4.0e4, 20.0, 1.7
    model = ContactModel("drive", (SlidingBody("body", mass),), pads=(Pad("pad", FRAME, "body", 0.1, (k,), b),))
    run = run_contact(ContactIntegrator(model), [0.1 - 1e-3], still(0.1), velocities_m_s=[speed])
    decay, fast = b / (2 * mass), math.sqrt(k / mass - (b / (2 * mass)) ** 2)
    # c = speed/fast e^(-decay t) sin(fast t), and the force k c + b c' first vanishes at
    slack = (math.pi - math.atan2(b * fast, k - b * decay)) / fast
    touch = run.happened("touch", "pad")[0].time_s
    assert run.happened("slack", "pad")[0].time_s - touch == pytest.approx(slack, rel=1e-12)
    left = speed * math.exp(-decay * slack) * (math.cos(fast * slack) - decay / fast * math.sin(fast * slack))
    assert run.velocities[0, -1] == pytest.approx(left, rel=1e-12)
    assert run.energies.imbalance < 1e-13
    pulling = ContactModel(
        "drive", (SlidingBody("body", mass),), pads=(Pad("pad", FRAME, "body", 0.1, (k,), b, pulls=True),)
    )
    run = run_contact(ContactIntegrator(pulling), [0.1 - 1e-3], still(0.1), velocities_m_s=[speed])
    leave = run.happened("leave", "pad")[0].time_s
    assert leave - touch == pytest.approx(math.pi / fast, rel=1e-12)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10, 1e-12])
def test_error_on_the_pad_follows_the_tolerance(tolerance: float) -> None:
    mass, linear, cubic, speed = 0.0426, 4.4517e5, 1.5739e12, 2.5
    model = ContactModel(
        "drive", (SlidingBody("body", mass),), pads=(Pad("pad", FRAME, "body", 0.0, (linear, 0.0, cubic)),)
    )
    run = run_contact(ContactIntegrator(model, tolerance), [0.0], still(0.01), velocities_m_s=[speed])
    energy = 0.5 * mass * speed**2
    deepest = math.sqrt((-linear + math.sqrt(linear**2 + 4 * cubic * energy)) / cubic)
    modulus = cubic * deepest**2 / (2 * (linear + cubic * deepest**2))
    exact = 2 * float(mp.ellipk(modulus)) / math.sqrt((linear + cubic * deepest**2) / mass)
    assert abs(run.happened("leave", "pad")[0].time_s - exact) < 10 * tolerance * exact
