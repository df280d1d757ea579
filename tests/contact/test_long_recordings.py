"""Precision of the needle transfer over hours of samples, angles of many turns, and noise between samples."""

from __future__ import annotations

import math
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

from textile_twin_core.contact import DrivePiece, drive_series, run_contact
from textile_twin_core.contact.law_pieces import law_pieces
from textile_twin_core.machine.contact_motion import ContactMotion, phase
from textile_twin_core.machines.needle_transfer import needle_transfer
from textile_twin_core.mechanism.motion_law import Section
from textile_twin_core.recordings import open_bag
from textile_twin_core.twin import compile_machine

BAG = Path(__file__).parents[2] / "bags/tufting_160rpm_synthetic"
# between two samples of a live shaft estimate: large terms that nearly cancel
UNEVEN = (0.43757403118713656, 16.768933354349354, 9.254346377178868, -1472656.9, 1052963918.9, -203010684881.9)
SLOW_SINE = Section((0.02167778784832121, -0.022246556964395203), 0.01027081822751818, 6.497989684441378, math.pi / 2)


@pytest.mark.parametrize("argument", [UNEVEN, UNEVEN[:2], (0.4, 900.0, -3e5)], ids=["uneven", "steady", "fast"])
@pytest.mark.parametrize(("order", "error"), [(24, 1e-15), (14, 1e-10)])
def test_the_drives_series_reaches_as_far_as_it_says(argument: tuple[float, ...], order: int, error: float) -> None:
    """The series summed at the end of its reach, against the law at the argument with 40 digits."""
    piece = DrivePiece(2.0, 2.002052, SLOW_SINE, argument)
    span = drive_series.reach(piece.motion, 2.0, 0.002052, order, error)
    assert 1e-4 < span <= 0.002052
    with mp.workdps(40):
        s = sum(mp.mpf(c) * mp.mpf(span) ** k for k, c in enumerate(argument))
        x = SLOW_SINE.polynomial[0] + SLOW_SINE.polynomial[1] * s
        exact = float(x + SLOW_SINE.amplitude * mp.sin(SLOW_SINE.frequency * s + SLOW_SINE.phase))
    assert piece.taylor(2.0, span, order).sum() == pytest.approx(exact, abs=max(0.03 * error, 3e-17))


def test_phases_of_many_turns_against_fifty_digits() -> None:
    angles = np.array([0.0, 1.0, -1.0, 6.5, 1e5 + 0.1, -1e5, 2.6e7, 1e9, -1e9])
    with mp.workdps(50):
        for angle, found in zip(angles.tolist(), phase(angles).tolist(), strict=True):
            exact = mp.mpf(angle) - 2 * mp.pi * mp.floor(mp.mpf(angle) / (2 * mp.pi))
            assert abs(float(exact - found)) < 1e-15 * 8


@pytest.mark.parametrize("start_s", [1e4, 1e7])
@pytest.mark.parametrize("turns", [0, 16_000, 160_000_000])
def test_late_samples_of_many_turns_move_it_as_early_ones(start_s: float, turns: int) -> None:
    """The same shaft motion with a late clock and a large turn count; the angle has their rounding."""
    machine = needle_transfer()
    rng = np.random.default_rng(3)
    clock = start_s + np.cumsum(rng.uniform(0.0019, 0.0021, 250))
    times = clock - clock[0]
    speed = machine.nominal_speed_rad_s * (1.0 + 0.02 * np.cos(3.0 * times)) + rng.normal(0.0, 0.02, times.size)
    theta = machine.nominal_speed_rad_s * (times + 0.02 / 3.0 * np.sin(3.0 * times)) + rng.normal(0.0, 1e-5, times.size)
    alpha = rng.normal(0.0, 1.0, times.size)
    counted = theta + turns * 2.0 * math.pi
    motion, late = ContactMotion(machine), ContactMotion(machine)
    early = motion.step(times, phase(counted), speed, alpha)
    found = late.step(clock, counted, speed, alpha)
    for name, values in early.items():
        if name.endswith("position_m"):
            assert np.abs(found[name] - values).max() < 1e-9
    assert [(e.kind, e.name) for e in late.events] == [(e.kind, e.name) for e in motion.events]


def test_a_steady_run_of_hours_stays_on_the_published_cycle() -> None:
    """A machine joined after 1e7 s of steady rotation moves as in its own simulation from the start."""
    machine = needle_transfer()
    w = machine.nominal_speed_rad_s
    times = np.arange(241) * 1e-3
    run = machine.simulate(times=times)
    found = ContactMotion(machine).step(1e7 + times, w * times, np.full(241, w), np.zeros(241))
    # a clock of 1e7 s is rounded to 2e-9 s, in which the elements move by 1e-9 m
    assert np.abs(found["element_2_position_m"] - run.positions[0]).max() < 5e-9


@pytest.mark.parametrize("start_s", [8.4, 1e4])
def test_a_simulation_that_begins_late_meets_the_same_events(start_s: float) -> None:
    machine = needle_transfer()
    cycle = 0.24
    runs = [
        run_contact(
            machine.integrator(),
            machine.start,
            law_pieces(machine.law, t, t + cycle, (0.0, machine.nominal_speed_rad_s)),
        )
        for t in (0.0, start_s)
    ]
    first, second = ([e for e in run.events if e.kind != "impact" or e.approach_speed_m_s > 1e-3] for run in runs)
    assert [(e.kind, e.name) for e in first] == [(e.kind, e.name) for e in second]
    shift = max(abs(b.time_s - a.time_s - start_s) for a, b in zip(first, second, strict=True))
    assert shift < 1e-13 + 20.0 * math.ulp(start_s)  # bounces enlarge the rounding of the clock


def test_a_recorded_shaft_with_knocks_drives_it() -> None:
    """Four and a half seconds of the synthetic tufting recording, a load knock among them."""
    angles = open_bag(BAG).read_angles("main_shaft/angle", joint="main_shaft")
    session = compile_machine(needle_transfer()).session(shaft="causal")
    samples = session.step(angles.stamps[:2260], angles.angles_rad[:2260])
    assert len(samples) == 2258
    assert np.isfinite(samples["element_2_position_m"]).all()
