"""Impacts, resting contact and chattering against mechanics computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from textile_twin_core.contact import (
    FRAME,
    ContactError,
    ContactIntegrator,
    ContactModel,
    DrivePiece,
    Pad,
    SlidingBody,
    SpringDamper,
    Stop,
    quintic,
    run_contact,
)
from textile_twin_core.mechanism.motion_law import Section

G = 9.81


def still(end_s: float) -> list[DrivePiece]:
    return [DrivePiece(0.0, end_s, Section((0.0,)), (0.0,))]


def shaking(end_s: float, amplitude: float, frequency: float, phase: float = 0.0) -> list[DrivePiece]:
    return [DrivePiece(0.0, end_s, Section((0.0,), amplitude, frequency, phase), (0.0, 1.0))]


def ball(restitution: float) -> ContactModel:
    """Build a ball of 0.2 kg above a table: x is its height below the frame, so the table is an upper limit."""
    return ContactModel(
        "table", (SlidingBody("ball", 0.2, 0.2 * G),), stops=(Stop("floor", FRAME, "ball", 0.0, restitution),)
    )


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9, 0.99])
def test_bounces_end_in_finite_time_where_the_series_ends(restitution: float) -> None:
    height = 0.5
    first = math.sqrt(2.0 * height / G)
    end = first * (1.0 + 2.0 * restitution / (1.0 - restitution))
    run = run_contact(ContactIntegrator(ball(restitution)), [-height], still(end + 1.0))
    impacts = run.happened("impact", "floor")
    for k, event in enumerate(impacts):
        exact = first * (1.0 + 2.0 * restitution * (1.0 - restitution**k) / (1.0 - restitution))
        assert event.time_s == pytest.approx(exact, rel=1e-13)
        assert event.approach_speed_m_s == pytest.approx(restitution**k * G * first, rel=1e-9, abs=1e-12)
    (rest,) = run.happened("rest", "floor")
    assert rest.time_s == pytest.approx(end, rel=1e-12)
    assert run.positions[0, -1] == 0.0
    assert run.velocities[0, -1] == 0.0
    assert sum(event.energy_lost_J for event in run.events) == pytest.approx(0.2 * G * height, rel=1e-12)


def test_restitution_one_bounces_for_ever_and_loses_nothing() -> None:
    first = math.sqrt(2.0 * 0.5 / G)
    run = run_contact(ContactIntegrator(ball(1.0)), [-0.5], still(41.9 * first))
    times = [event.time_s for event in run.happened("impact", "floor")]
    assert times == pytest.approx([first * (2 * k + 1) for k in range(21)], rel=1e-12)
    assert sum(event.energy_lost_J for event in run.events) < 1e-13 * 0.2 * G * 0.5 * 21


def test_restitution_zero_stays() -> None:
    run = run_contact(ContactIntegrator(ball(0.0)), [-0.5], still(1.0))
    (event,) = run.events
    assert (event.kind, event.impulse_Ns) == ("impact", pytest.approx(0.2 * math.sqrt(G), rel=1e-14))
    assert run.positions[0, -1] == 0.0


def test_a_body_on_a_shaken_table_is_released_where_the_table_falls_faster() -> None:
    """a_table = -A w^2 sin(w t) downwards beats gravity at sin(w t) = g / (A w^2); upwards is negative x."""
    amplitude, frequency = 0.002, 100.0
    model = ContactModel("table", (SlidingBody("body", 0.1, -0.1 * G),), stops=(Stop("lies", "body", "table", 0.0),))
    run = run_contact(ContactIntegrator(model), [0.0], shaking(0.25, amplitude, frequency))
    release = run.happened("release", "lies")[0]
    exact = math.asin(G / (amplitude * frequency**2)) / frequency
    assert release.time_s == pytest.approx(exact, rel=1e-12)
    # free flight until x_body = x_table again, by Newton from a time inside the next upward swing
    height, speed = amplitude * math.sin(frequency * exact), amplitude * frequency * math.cos(frequency * exact)
    t = run.happened("impact", "lies")[0].time_s
    gap = height + speed * (t - exact) - 0.5 * G * (t - exact) ** 2 - amplitude * math.sin(frequency * t)
    assert abs(gap) < 1e-16
    times = np.linspace(exact, t, 2001)[1:-1]
    above = height + speed * (times - exact) - 0.5 * G * (times - exact) ** 2 - amplitude * np.sin(frequency * times)
    assert above.min() > 0.0
    assert run.energies.imbalance < 1e-12


def test_a_fall_through_and_back_within_one_step_is_not_missed() -> None:
    """A parabola crosses the stop for 2 microseconds in a step of seconds."""
    dip = 0.5 * G * 1e-6**2
    model = ContactModel("drive", (SlidingBody("body", 1.0, -G),), stops=(Stop("lid", FRAME, "body", 0.0, 1.0),))
    speed = math.sqrt(2.0 * G * (0.3 + dip))
    run = run_contact(ContactIntegrator(model), [-0.3], still(1.0), velocities_m_s=[speed])
    (event,) = run.happened("impact", "lid")
    assert event.time_s == pytest.approx(speed / G - 1e-6, abs=1e-10)


def test_newtons_cradle_hands_the_speed_on() -> None:
    bodies = tuple(SlidingBody(f"b{k}", 0.3) for k in range(4))
    stops = tuple(Stop(f"s{k}", f"b{k + 1}", f"b{k}", -0.01, 1.0) for k in range(3))
    start = [0.0, 0.02, 0.04, 0.06]
    run = run_contact(
        ContactIntegrator(ContactModel("drive", bodies, stops=stops)), start, still(0.2), velocities_m_s=[1.0, 0, 0, 0]
    )
    assert [event.name for event in run.events] == ["s0", "s1", "s2"]
    assert [event.time_s for event in run.events] == pytest.approx([0.01, 0.02, 0.03], rel=1e-13)
    assert run.velocities[:4, -1] == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-15)


def test_simultaneous_impacts_keep_symmetry_and_momentum() -> None:
    bodies = (SlidingBody("left", 0.2), SlidingBody("middle", 0.5), SlidingBody("right", 0.2))
    stops = (Stop("l", "middle", "left", -0.01, 0.5), Stop("r", "right", "middle", -0.01, 0.5))
    run = run_contact(
        ContactIntegrator(ContactModel("drive", bodies, stops=stops)),
        [-0.11, 0.0, 0.11],
        still(0.5),
        velocities_m_s=[1.0, 0.0, -1.0],
    )
    assert [event.time_s for event in run.events] == pytest.approx([0.1, 0.1], rel=1e-13)
    assert run.velocities[:3, -1] == pytest.approx([-0.5, 0.0, 0.5], abs=1e-14)
    assert sum(event.energy_lost_J for event in run.events) == pytest.approx(0.2 * (1 - 0.25), rel=1e-13)


def test_an_impact_goes_through_a_body_that_rests_on_the_driven_element() -> None:
    """A heavy drive moves at 2 m/s with a body before it; another one strikes that body and bounces with 0.5."""
    bodies = (SlidingBody("pushed", 0.1), SlidingBody("striking", 0.3))
    stops = (Stop("push", "pushed", "drive", 0.0), Stop("strike", "striking", "pushed", 0.0, 0.5))
    pieces = [DrivePiece(0.0, 0.2, Section((0.0, 2.0)), (0.0, 1.0))]
    run = run_contact(
        ContactIntegrator(ContactModel("drive", bodies, stops=stops)), [0.0, 0.3], pieces, velocities_m_s=[2.0, -1.0]
    )
    strike = next(event for event in run.events if event.name == "strike")
    assert strike.time_s == pytest.approx(0.1, rel=1e-13)
    assert strike.impulse_Ns == pytest.approx(0.3 * 4.5, rel=1e-13)
    assert run.velocities[:2, -1] == pytest.approx([2.0, 3.5], rel=1e-13)
    assert run.energies.imbalance < 1e-14


def test_a_step_of_the_drives_velocity_is_an_impact() -> None:
    model = ContactModel("drive", (SlidingBody("body", 0.2),), stops=(Stop("push", "body", "drive", 0.0, 0.4),))
    run = run_contact(
        ContactIntegrator(model),
        [0.0],
        [
            DrivePiece(0.0, 0.1, Section((0.0,)), (0.0,)),
            DrivePiece(0.1, 0.2, Section((0.0, 1.5)), (0.0, 1.0)),
        ],
    )
    assert run.velocities[0, -1] == pytest.approx(1.5 * 1.4, rel=1e-14)


def test_two_stops_in_one_place_act_as_one() -> None:
    model = ContactModel(
        "drive",
        (SlidingBody("body", 0.2, 1.0),),
        stops=(Stop("a", FRAME, "body", 0.1, 0.2), Stop("b", FRAME, "body", 0.1, 0.7)),
    )
    run = run_contact(ContactIntegrator(model), [0.0], still(2.0))
    assert run.positions[0, -1] == pytest.approx(0.1, abs=1e-17)
    assert run.energies.imbalance < 1e-14


def test_the_error_of_a_jam_names_the_stops_and_the_time() -> None:
    model = ContactModel(
        "drive",
        (SlidingBody("body", 0.2),),
        stops=(Stop("push", "body", "drive", 0.0), Stop("wall", FRAME, "body", 0.05)),
    )
    pieces = [DrivePiece(0.0, 1.0, Section((0.0, 1.0)), quintic(1.0, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)))]
    with pytest.raises(ContactError, match=r"at 0\.49\d* s.*push, wall|at 0\.5 s.*push, wall"):
        run_contact(ContactIntegrator(model), [0.0], pieces)


def test_wrong_models_and_starts_are_refused() -> None:
    with pytest.raises(ContactError, match="mass_kg is -1"):
        SlidingBody("b", -1.0)
    with pytest.raises(ContactError, match=r"restitution is 1\.2"):
        Stop("s", "a", "b", 0.0, 1.2)
    with pytest.raises(ContactError, match="no element is called 'c'"):
        ContactModel("drive", (SlidingBody("b", 1.0),), stops=(Stop("s", "b", "c", 0.0),))
    with pytest.raises(ContactError, match="no body can give way"):
        ContactModel("drive", (SlidingBody("b", 1.0),), stops=(Stop("s", FRAME, "drive", 0.0),))
    with pytest.raises(ContactError, match="damping_Ns_m is nan"):
        SpringDamper("s", "drive", "b", 1.0, math.nan)
    with pytest.raises(ContactError, match="stiffness is empty"):
        Pad("p", FRAME, "b", 0.0, ())
    with pytest.raises(ContactError, match=r"1\.000e-01 m beyond stop floor"):
        ContactIntegrator(ball(0.5)).start([0.1])
    with pytest.raises(ContactError, match="steps by"):
        run_contact(ContactIntegrator(ball(0.5)), [-0.1], [*still(0.1), DrivePiece(0.1, 0.2, Section((0.01,)), (0.0,))])


def test_squeezing_a_perfect_bouncer_stops_in_finite_time() -> None:
    """Between a wall and a drive that comes up to it the speed of a body with restitution 1 has no bound."""
    model = ContactModel(
        "drive",
        (SlidingBody("body", 0.1),),
        stops=(Stop("push", "body", "drive", 0.0, 1.0), Stop("wall", FRAME, "body", 0.1, 1.0)),
    )
    pieces = [DrivePiece(0.0, 1.0, Section((0.0, 1.0)), (0.0, 1.0))]
    with pytest.raises(ContactError, match="no end"):
        run_contact(ContactIntegrator(model, events_largest=500), [0.05], pieces, velocities_m_s=[1.0])


@pytest.mark.parametrize("seed", range(12))
def test_energy_is_booked_to_the_last_joule(seed: int) -> None:
    """Random chains of bodies on springs, stops and a pad, shaken hard."""
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 4))
    names = ["drive", *(f"b{k}" for k in range(count))]
    at = np.concatenate(([0.0], np.cumsum(random.uniform(0.01, 0.05, count))))
    springs = tuple(
        SpringDamper(
            f"s{k}",
            names[k],
            names[k + 1],
            10 ** random.uniform(1, 4),
            random.choice([0.0, 10 ** random.uniform(-2, 1)]),
            at[k + 1] - at[k] + random.normal() * 0.01,
        )
        for k in range(count)
    )
    stops = tuple(
        Stop(
            f"t{k}",
            names[k],
            names[k + 1],
            at[k + 1] - at[k] + random.choice([0.0, 0.002]),
            float(random.choice([0.0, 0.5, 0.9, 1.0])),
        )
        for k in range(count)
    )
    pad = Pad("pad", FRAME, names[-1], at[-1] + 0.001, (10 ** random.uniform(3, 6), 0.0, 1e10), 5.0, bool(seed % 2))
    bodies = tuple(SlidingBody(name, 10 ** random.uniform(-2, 0), random.normal()) for name in names[1:])
    model = ContactModel("drive", bodies, springs, stops, (pad,))
    run = run_contact(
        ContactIntegrator(model, 1e-12), at[1:], shaking(0.3, 10 ** random.uniform(-3, -2), random.uniform(20, 150))
    )
    assert run.energies.imbalance < 1e-11
    for stop in stops:
        ends = np.vstack((run.positions, np.zeros(run.times.size)))
        gap = stop.limit_m - ends[model.index[stop.upper]] + ends[model.index[stop.lower]]
        assert gap.min() > -1e-14


def test_two_stops_that_face_each_other_hand_the_force_over() -> None:
    """Two stops tie two bodies: the force of one passes through zero and the other takes over."""
    mass_1, mass_2, k, start = 0.16, 0.72, 4000.0, 0.002
    model = ContactModel(
        "drive",
        (SlidingBody("held", mass_1), SlidingBody("free", mass_2)),
        (SpringDamper("spring", FRAME, "held", k),),
        (Stop("over", "free", "held", -0.05), Stop("under", "held", "free", 0.05)),
    )
    run = run_contact(ContactIntegrator(model), [start, start + 0.05], still(0.5))
    frequency = math.sqrt(k / (mass_1 + mass_2))
    exact = start * np.cos(frequency * run.times)
    assert np.abs(run.positions[0] - exact).max() < 1e-15
    assert np.abs(run.positions[1] - exact - 0.05).max() < 1e-15
    assert len(run.events) == math.floor(0.5 * frequency / math.pi + 0.5)
    assert run.energies.imbalance < 1e-13
