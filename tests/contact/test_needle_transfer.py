"""The needle transfer against the paper, a 30-digit calculation, an independent solver, and hard cases."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.contact.needle_reference import Stroke
from textile_twin_core.contact import ContactRun
from textile_twin_core.contact.law_pieces import law_pieces
from textile_twin_core.errors import ContactError, MachineError, MotionError, SceneError
from textile_twin_core.machine.contact_motion import ContactMotion, measured_error
from textile_twin_core.machines.needle_transfer import COLLETS, CONE, DESIGNS, PAD, PIN, needle_transfer
from textile_twin_core.papers.needle_transfer import (
    OTHER_READING,
    forward_stroke,
)

READINGS = {"pad at 0.0949": {}, "pad at 0.0989": OTHER_READING}
TABLE = {
    # pad reached, largest acceleration of 2, contact of 2 and 3 [ms], 2 leaves the pin by [mm]
    ("pad at 0.0949", "original"): (15.71, 16.04, 19.25, 2.19),
    ("pad at 0.0949", "optimised"): (17.95, 18.32, 19.15, 0.03),
    ("pad at 0.0989", "original"): (15.78, 16.08, 18.21, 3.36),
    ("pad at 0.0989", "optimised"): (17.76, 18.14, 19.23, 0.77),
}


@pytest.mark.parametrize(("reading", "design"), TABLE)
def test_events_of_both_designs_and_both_readings(reading: str, design: str) -> None:
    """Event times of an independent calculation, to 0.01 ms; the gap at the pin to 0.01 mm."""
    stroke = forward_stroke(needle_transfer(design=design, **READINGS[reading]))
    found = (stroke.pad_s, stroke.deceleration_s, stroke.contact_s, stroke.leaves_pin_m)
    for value, expected in zip(found, TABLE[reading, design], strict=True):
        assert value * 1e3 == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("design", DESIGNS)
def test_the_default_is_the_paper_within_its_contradictions(design: str) -> None:
    stroke = forward_stroke(needle_transfer(design=design))
    pad, contact = {"original": (15.75, 19.23), "optimised": (17.96, 19.23)}[design]
    assert stroke.pad_s * 1e3 == pytest.approx(pad, abs=0.04)
    assert stroke.contact_s * 1e3 == pytest.approx(contact, abs=0.09)
    assert 0.31e-3 < stroke.deceleration_s - stroke.pad_s < 0.40e-3
    assert (stroke.leaves_pin_m > 1e-4) == (design == "original")


NAMES = {
    ("release", PIN): "pin released",
    ("impact", PIN): "pin hit",
    ("release", CONE): "cone released",
    ("impact", CONE): "cone hit",
    ("touch", PAD): "pad touched",
    ("leave", PAD): "pad left",
    ("impact", COLLETS): "F-G",
}


@pytest.mark.parametrize("law", ["modified_sine", "cycloidal"])
@pytest.mark.parametrize("design", DESIGNS)
def test_event_times_against_thirty_digits(design: str, law: str) -> None:
    """All events of the stroke up to the fourth impact of F and G agree to 2e-15 s."""
    pad, length, duration = {"modified_sine": ("0.0949", "0.0326", "0.02462")}.get(
        law, ("0.0989", "0.03484", "0.02338")
    )
    with mp.workdps(30):
        reference = Stroke({"original": "0.0719"}.get(design, "0.0669"), pad, law, length, duration).run("0.0197")
    machine = needle_transfer(
        design=design,
        motion_law=law,
        pad_position_m=float(pad),
        stroke_m=float(length),
        forward_duration_s=float(duration),
    )
    run = machine.simulate(end_s=0.0197)
    for event, (time, name) in zip(run.events, reference.events, strict=False):
        assert NAMES[event.kind, event.name] == name
        assert abs(event.time_s - float(time)) < 2e-15
    assert len(run.events) >= len(reference.events) >= 5
    stroke = forward_stroke(machine)
    assert stroke.deceleration_s == pytest.approx(float(reference.largest_deceleration_s), abs=1e-11)
    assert stroke.leaves_pin_m == pytest.approx(float(reference.leaves_pin_m), abs=2e-8)


def test_motion_against_a_solver_that_knows_no_events() -> None:
    """DOP853 at 1e-13 on the printed equations 13 and 14, from touch to rebound of the original design."""
    machine = needle_transfer()
    run = machine.simulate(end_s=0.02)
    touch, cone = run.happened("touch", PAD)[0].time_s, run.happened("release", CONE)[0].time_s
    law, w = machine.law, machine.nominal_speed_rad_s

    def right_side(t: float, y: np.ndarray) -> list[float]:
        x1, v1 = law.evaluate(w * t), law.evaluate(w * t, 1) * w
        x2, v2 = y
        x3, v3 = x1 + 0.0929, v1
        mm = (x2 - 0.0949) * 1e3
        rubber = 1573.9 * mm**3 - 2e-10 * mm**2 + 445.17 * mm + 28.5 * v2
        force = -900 * (x2 - x1 - 0.089) + 690 * (x3 - x2 - 0.0373) - 13.16 * (v2 - v1) + 3.32 * (v3 - v2) - rubber
        return [v2, force / 0.0426]

    times = np.linspace(touch, cone, 30)
    sampled = machine.simulate(end_s=0.02, times=times)
    start = [0.0949, sampled.velocities[0, 0]]
    reference = solve_ivp(right_side, (touch, cone), start, "DOP853", times, rtol=1e-13, atol=1e-16).y
    assert np.abs(sampled.positions[0] - reference[0]).max() < 1e-14
    assert np.abs(sampled.velocities[0] - reference[1]).max() < 1e-11


def same_events(a: ContactRun, b: ContactRun) -> float:
    """Compute the largest shift between the events of two runs, ignoring bounces below a nanometre."""
    first, second = ([e for e in run.events if e.kind != "impact" or e.approach_speed_m_s > 1e-3] for run in (a, b))
    assert [(e.kind, e.name) for e in first] == [(e.kind, e.name) for e in second]
    return max(abs(x.time_s - y.time_s) for x, y in zip(first, second, strict=True))


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10, 1e-12])
def test_halving_the_tolerance_moves_no_event_by_more_than_it(design: str, tolerance: float) -> None:
    machine = needle_transfer(design=design)
    assert same_events(machine.simulate(tolerance=tolerance), machine.simulate(tolerance=0.5 * tolerance)) < tolerance


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("design", DESIGNS)
def test_energy_closes_over_the_cycle(design: str, reading: str) -> None:
    machine = needle_transfer(design=design, **READINGS[reading])
    assert machine.simulate().energies.imbalance < 1e-12


@pytest.mark.parametrize(
    "changes",
    [
        {"pad_linear_N_mm": 445.17e4, "pad_cubic_N_mm3": 1573.9e4},
        {"pad_pulls": False},
        {"pad_linear_N_mm": 445.17e4, "pad_cubic_N_mm3": 1573.9e4, "pad_damping_Ns_m": 0.0},
        {"collet_restitution": 0.0},
        {"collet_restitution": 1.0},
        {"pin_restitution": 1.0, "cone_restitution": 1.0, "collet_restitution": 1.0},
        {"pin_restitution": 0.9, "cone_restitution": 0.9, "collet_restitution": 0.9},
        {"stroke_m": 0.0},
        {"spring_1_N_m": 0.0, "spring_2_N_m": 0.0},
        {"spring_1_Ns_m": 0.0, "spring_2_Ns_m": 0.0, "pad_damping_Ns_m": 0.0},
    ],
    ids=lambda changes: ", ".join(f"{name}={value:g}" for name, value in changes.items()),
)
def test_hard_cases_end_and_keep_their_energy(changes: dict[str, float]) -> None:
    run = needle_transfer(**changes).simulate(end_s=0.022)
    assert run.energies.imbalance < 1e-9
    assert np.isfinite(run.positions).all()
    if changes == {"stroke_m": 0.0}:
        assert not run.events
        assert np.ptp(run.positions, axis=1) == pytest.approx([0.0, 0.0, 0.0], abs=1e-17)


def test_restitution_of_the_collets_changes_no_printed_time() -> None:
    strokes = [forward_stroke(needle_transfer(collet_restitution=e)) for e in (0.0, 0.6, 0.9)]
    assert strokes[0] == strokes[1] == strokes[2]


def samples(machine_speed: float, count: int, step_s: float) -> tuple[np.ndarray, ...]:
    times = np.arange(count) * step_s
    return times, machine_speed * times, np.full(count, machine_speed), np.zeros(count)


def test_samples_at_constant_speed_give_the_run_whatever_the_blocks_and_the_wrapping() -> None:
    machine = needle_transfer()
    times, theta, omega, alpha = samples(machine.nominal_speed_rad_s, 241, 1e-3)
    run = machine.simulate(times=times)
    rows = {"element_2": 0, "element_3": 1, "element_1": 2}
    for wrap in (False, True):
        for cuts in ([241], [1, 5, 30, 200], list(range(1, 241, 7))):
            motion = ContactMotion(machine)
            angle = (theta + math.pi) % (2 * math.pi) - math.pi if wrap else theta
            parts = [
                motion.step(*(column[a:b] for column in (times, angle, omega, alpha)))
                for a, b in zip([0, *cuts], [*cuts, 241], strict=True)
            ]
            for element, row in rows.items():
                found = np.concatenate([part[f"{element}_position_m"] for part in parts])
                assert np.abs(found - run.positions[row]).max() < 1e-14
            # the acceleration of an impact comes from the same series, before an event that falls on a sample
            found = np.concatenate([part["element_2_acceleration_m_s2"] for part in parts])
            assert np.abs(found - run.accelerations[0]).max() < 1e-4
            assert [(e.kind, e.name) for e in motion.events] == [(e.kind, e.name) for e in run.events]
            shift = max(abs(a.time_s - b.time_s) for a, b in zip(motion.events, run.events, strict=True))
            assert shift < 1e-13


def test_an_accelerating_shaft_against_the_same_motion_in_one_piece() -> None:
    """theta is a cubic in time, which the quintic between samples reproduces: sampling must not matter."""
    machine = needle_transfer(design="optimised")
    c = (0.0, 10.0, 60.0, 100.0)
    times = np.linspace(0.0, 0.2, 101)
    theta = c[1] * times + c[2] * times**2 + c[3] * times**3
    omega, alpha = c[1] + 2 * c[2] * times + 3 * c[3] * times**2, 2 * c[2] + 6 * c[3] * times
    motion = ContactMotion(machine)
    found = motion.step(times, theta, omega, alpha)
    integrator = machine.integrator()
    state = integrator.start(machine.start)
    events = []
    for piece in law_pieces(machine.law, 0.0, 0.2, c):
        events += integrator.advance(state, piece).events
    assert [(e.kind, e.name) for e in motion.events] == [(e.kind, e.name) for e in events]
    assert max(abs(a.time_s - b.time_s) for a, b in zip(motion.events, events, strict=True)) < 1e-12
    assert found["element_2_position_m"][-1] == pytest.approx(state.positions[0], abs=1e-13)
    assert found["element_3_velocity_m_s"][-1] == pytest.approx(state.velocities[1], abs=1e-9)


def test_the_drives_work_is_the_energy_it_brings_in() -> None:
    """Integral of torque over the angle against the booked energy, up to the first impact."""
    machine = needle_transfer()
    times, theta, omega, alpha = samples(machine.nominal_speed_rad_s, 15001, 1e-6)
    found = ContactMotion(machine).step(times, theta, omega, alpha)
    torque = found["balancing_torque_Nm"]
    parts = found["torque_inertial_Nm"] + found["torque_gravity_Nm"] + found["torque_load_Nm"]
    assert np.abs(torque - parts).max() < 1e-15
    work = float(np.trapezoid(torque, theta))
    run = machine.simulate(end_s=float(times[-1]))
    jacket = 0.5 * 0.1196 * found["element_1_velocity_m_s"][-1] ** 2
    assert work == pytest.approx(run.energies.work_J[-1] + jacket, rel=1e-7)
    stored = found["kinetic_energy_J"] + found["potential_energy_J"]
    assert stored[-1] - stored[0] + run.energies.damped_J[-1] == pytest.approx(work, rel=1e-7)


def test_a_first_sample_anywhere_in_the_cycle_finds_the_machine_there() -> None:
    """After transients have died out, a machine joined late moves as one followed from the start."""
    machine = needle_transfer()
    times, theta, omega, alpha = samples(machine.nominal_speed_rad_s, 481, 1e-3)
    whole = ContactMotion(machine).step(times, theta, omega, alpha)
    for first in (5, 40, 100, 130, 200):
        part = ContactMotion(machine).step(*(c[first:] for c in (times, theta, omega, alpha)))
        late = np.abs(part["element_2_position_m"] - whole["element_2_position_m"][first:])[-100:]
        assert late.max() < 1e-9


def test_a_gap_of_many_turns_restarts_and_standstill_holds() -> None:
    machine = needle_transfer()
    motion = ContactMotion(machine)
    times = np.array([0.0, 0.001, 10.0, 10.001, 10.005, 20.5])
    theta = np.array([0.0, 0.026, 300.0, 300.026, 300.1, 300.1])
    omega = np.array([26.0, 26.0, 26.0, 26.0, 0.0, 0.0])
    found = motion.step(times, theta, omega, np.zeros(6))
    assert motion.restarts == 1
    assert np.isfinite(found["element_2_position_m"]).all()
    assert found["element_2_velocity_m_s"][-1] == pytest.approx(0.0, abs=1e-9)


def test_the_error_of_wrong_input_names_the_sample() -> None:
    machine = needle_transfer()
    with pytest.raises(SceneError, match="no output 'needle_position_m'"):
        ContactMotion(machine, ["needle_position_m"])
    motion = ContactMotion(machine)
    motion.step(np.array([0.0, 0.1]), np.zeros(2), np.zeros(2), np.zeros(2))
    with pytest.raises(MotionError, match=r"sample 3: its time 0\.1 s"):
        motion.step(np.array([0.2, 0.1]), np.zeros(2), np.zeros(2), np.zeros(2))
    with pytest.raises(MotionError, match=r"sample 2: .* not finite"):
        motion.step(np.array([0.2, 0.3]), np.array([math.nan, 0.0]), np.zeros(2), np.zeros(2))
    with pytest.raises(MotionError, match="give one length"):
        motion.step(np.array([0.2, 0.3]), np.zeros(3), np.zeros(2), np.zeros(2))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"design": "new"}, "original and optimised"),
        ({"motion_law": "sine"}, "modified_sine, cycloidal"),
        ({"forward_duration_s": 0.2}, "within one turn"),
        ({"cycles_per_minute": 0.0}, "cycles_per_minute"),
    ],
)
def test_wrong_declarations_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(MachineError, match=message):
        needle_transfer(**changes)


def test_wrong_contacts_are_refused() -> None:
    with pytest.raises(ContactError, match="element_2: mass_kg"):
        needle_transfer(element_2_kg=0.0)
    with pytest.raises(ContactError, match="beyond stop collet_contact"):
        needle_transfer(value_d_m=0.04)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9, 1e-12])
def test_measured_error_is_honest_at_other_samples(tolerance: float) -> None:
    machine = needle_transfer(design="optimised")
    outputs = [f"element_{k}_{what}" for k in (2, 3) for what in ("position_m", "velocity_m_s", "acceleration_m_s2")]
    told = measured_error(machine, outputs, tolerance)
    times = np.sort(np.random.default_rng(5).uniform(0.0, 0.24, 10_000))
    run, truth = (machine.simulate(times=times, tolerance=each) for each in (tolerance, 1e-16))
    worst = 0.0
    for what in ("positions", "velocities", "accelerations"):
        found, exact = getattr(run, what)[:2], getattr(truth, what)[:2]
        worst = max(worst, *(np.abs(found - exact).max(axis=1) / np.abs(exact).max(axis=1)))
    assert 0.1 * told <= worst <= told or told == 1e-15
