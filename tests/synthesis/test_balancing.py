"""Balancing against closed forms, and against the motion integrated by `drive`."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core import machines
from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.body import Body
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.machine import ShaftPlace
from textile_twin_core.mechanism import Crank, RRRDyad
from textile_twin_core.synthesis.balancing import (
    balancing_spring,
    counterweights,
    flywheel,
    opposed_linkages,
    shaking,
)
from textile_twin_core.synthesis.turn import over_turn, shaft_angles


def harmonic(values: np.ndarray, order: int) -> float:
    return float(2.0 * np.abs(np.fft.rfft(values)[order]) / values.size)


def test_first_harmonic_of_the_gravity_torque_is_cancelled_to_rounding() -> None:
    found = counterweights(machines.tufting())
    assert harmonic(found.before, 1) == pytest.approx(0.5566, abs=5e-5)
    (weight,) = found.weights
    assert weight.mass_kg * weight.radius_m * 9.81 == pytest.approx(harmonic(found.before, 1), rel=1e-12)
    twin = ttc.compile(found.machine, ["torque_gravity_Nm"], method="exact")
    after = twin.evaluate(found.theta_rad)["torque_gravity_Nm"]
    assert harmonic(after, 1) < 1e-15
    for order in (2, 3, 4):
        assert harmonic(after, order) == pytest.approx(harmonic(found.before, order), abs=1e-15)


def test_radius_is_a_choice_that_the_torque_does_not_see() -> None:
    near, far = (counterweights(machines.tufting(), radius_m=r) for r in (0.05, 0.2))
    assert near.weights[0].mass_kg == pytest.approx(4.0 * far.weights[0].mass_kg, rel=1e-12)
    assert near.after == pytest.approx(far.after, abs=1e-15)


def test_shaking_force_of_a_four_bar_vanishes_with_the_weights_of_berkof_and_lowen() -> None:
    machine = machines.handloom_beatup()
    found = counterweights(machine, ["l1", "l3"], "shaking_force")
    assert np.abs(found.before).max() > 60.0
    assert np.abs(found.after).max() < 1e-12
    crank, rocker = found.weights
    assert crank.mass_kg * crank.radius_m == pytest.approx(0.5 * (0.129 + 0.434) * 0.0597, rel=1e-12)
    on_rocker = 0.5 * 0.434 * 0.23082 + (0.5 * 0.649 + 2.5) * 0.3001
    assert rocker.mass_kg * rocker.radius_m == pytest.approx(on_rocker, rel=1e-12)
    assert abs(crank.angle_rad) == pytest.approx(math.pi, abs=1e-9) == abs(rocker.angle_rad)
    again = shaking(found.machine, 31.0)
    assert again.force_N.max() < 1e-11 and np.abs(again.moment_Nm).max() > 1.0


def test_shaking_force_is_what_the_ground_bears() -> None:
    """The shaking force without weight and loads is minus the ground reactions by Newton and Euler."""
    machine = machines.tufting(gravity_m_s2=0.0, backing_force_N=0.0)
    names = ["reaction_O_x_N", "reaction_O_y_N", "reaction_C_x_N", "reaction_C_y_N", "reaction_guide_N"]
    speed = machine.nominal_speed_rad_s
    felt = shaking(machine, speed, shaft_angles(90))
    found = ttc.compile(machine, names, method="exact").evaluate(felt.theta_rad, np.full(90, speed), np.zeros(90))
    assert felt.x_N == pytest.approx(-(found[names[0]] + found[names[2]] + found[names[4]]), abs=1e-10)
    assert felt.y_N == pytest.approx(-(found[names[1]] + found[names[3]]), abs=1e-10)


def test_antiphase_takes_the_odd_harmonics_and_doubles_the_even_ones() -> None:
    found = opposed_linkages(machines.handloom_beatup(), math.pi)
    for order in range(1, 9):
        expected = 0.0 if order % 2 else harmonic(found.together_Nm, order)
        assert harmonic(found.apart_Nm, order) == pytest.approx(expected, abs=1e-12)


def let_run(machine: machines.Machine) -> tuple[FloatArray, FloatArray]:
    """Integrate angle [rad] and speed [rad/s] over a turn without drive torque."""
    run = ttc.drive(machine, 0.0, 0.0, 20.0, np.linspace(0.0, 0.5, 3000))
    turn = run.theta_rad < 2.0 * math.pi
    return run.theta_rad[turn], run.omega_rad_s[turn]


def test_antiphase_and_flywheel_agree_with_theory_where_drive_lets_them_run() -> None:
    """J omega^2 / 2 stays constant without weight; with a heavy wheel ripple is energy swing over J omega^2."""
    loom = machines.handloom_beatup(gravity_m_s2=0.0)
    one = ttc.compile(loom, ["equivalent_inertia_kgm2"], method="exact")

    def inertia_of_both(theta: FloatArray) -> FloatArray:
        first, second = (one.evaluate(theta + phase, 0.0 * theta, 0.0 * theta) for phase in (0.0, math.pi))
        return first["equivalent_inertia_kgm2"] + second["equivalent_inertia_kgm2"]

    both = opposed_linkages(loom, math.pi).machine
    theta, speed = let_run(both)
    inertia = inertia_of_both(theta)
    assert speed == pytest.approx(20.0 * np.sqrt(inertia[0] / inertia), rel=1e-8)
    for heavy_kgm2 in (5.0, 50.0):
        theta, speed = let_run(replace(both, bodies=(*both.bodies, Body.flywheel(heavy_kgm2))))
        inertia = heavy_kgm2 + inertia_of_both(theta)
        swing_J = 0.5 * np.ptp(inertia) * speed.mean() ** 2
        ripple = np.ptp(speed) / speed.mean()
        assert ripple == pytest.approx(swing_J / (inertia.mean() * speed.mean() ** 2), rel=ripple)


def test_best_phase_beats_every_other() -> None:
    machine = machines.tufting(backing_force_N=0.0)
    best = opposed_linkages(machine)
    for phase in np.linspace(0.0, math.pi, 13).tolist():
        assert np.sum(best.apart_Nm**2) <= np.sum(opposed_linkages(machine, phase).apart_Nm ** 2) + 1e-12
    assert len(best.machine.linkages) == 2


def test_spring_is_the_best_of_its_pair() -> None:
    machine = machines.handloom_beatup()
    found = balancing_spring(machine)
    assert found.rms_share < 0.2
    twin = ttc.compile(found.machine, ["balancing_torque_Nm"], method="exact")
    speed = machine.nominal_speed_rad_s
    torque = twin.evaluate(found.theta_rad, np.full(720, speed), np.zeros(720))["balancing_torque_Nm"]
    assert torque == pytest.approx(found.after_Nm, abs=1e-10)
    for stiffer, longer in ((1.01, 1.0), (0.99, 1.0), (1.0, 1.01), (1.0, 0.99)):
        spring = replace(
            found.spring,
            stiffness_N_m=found.spring.stiffness_N_m * stiffer,
            free_length_m=found.spring.free_length_m * longer,
        )
        other = ttc.compile(replace(machine, loads=(spring,)), ["balancing_torque_Nm"], method="exact")
        worse = other.evaluate(found.theta_rad, np.full(720, speed), np.zeros(720))["balancing_torque_Nm"]
        assert np.sum(worse**2) > np.sum(torque**2)


def test_spring_counts_on_every_linkage_of_the_shaft() -> None:
    """Each linkage carries every load: a spring found for one, carried by three, would make the torque larger."""
    machine = replace(machines.tufting(), linkages=tuple(ShaftPlace(phase) for phase in (0.0, 1.0, 2.0)))
    found = balancing_spring(machine)
    assert found.rms_share < 1.0
    for stiffer in (1.05, 0.95):
        spring = replace(found.spring, stiffness_N_m=found.spring.stiffness_N_m * stiffer)
        other = replace(machine, loads=(*machine.loads, spring)).model.output("balancing_torque_Nm")
        (worse,) = over_turn([other], found.theta_rad, machine.nominal_speed_rad_s)
        assert np.sum(worse**2) > np.sum(found.after_Nm**2)


@pytest.mark.parametrize("machine", [machines.tufting(), machines.handloom_beatup()], ids=lambda m: m.name)
def test_flywheel_holds_the_ripple_that_drive_finds(machine: machines.Machine) -> None:
    found = flywheel(machine, 0.02)
    assert found.ripple_after == pytest.approx(0.02, rel=1e-9) and found.ripple_before > 0.02
    speed = machine.nominal_speed_rad_s
    turn = 2.0 * math.pi / speed
    run = ttc.drive(
        found.machine, found.mean_torque_Nm, 0.0, found.speed_at_zero_rad_s, np.linspace(0.0, 3.2 * turn, 4000)
    )
    last = run.theta_rad > run.theta_rad[-1] - 2.0 * math.pi
    theta, omega = run.theta_rad[last], run.omega_rad_s[last]
    mean = np.trapezoid(omega, theta) / (theta[-1] - theta[0])
    assert mean == pytest.approx(speed, rel=1e-4)
    assert np.ptp(omega) / mean == pytest.approx(0.02, rel=1e-3)


def test_flywheel_of_the_rule_of_thumb_is_the_limit_of_a_heavy_one() -> None:
    for ripple, within in ((0.02, 0.03), (0.002, 0.003)):
        found = flywheel(machines.handloom_beatup(gravity_m_s2=0.0), ripple)
        own = found.rule_of_thumb_kgm2
        assert found.inertia_kgm2 == pytest.approx(own, rel=within + 0.05)


def test_machine_that_needs_no_flywheel() -> None:
    machine = flywheel(machines.handloom_beatup(), 0.02).machine
    found = flywheel(machine, 0.021)
    assert found.inertia_kgm2 == 0.0 and found.machine is machine
    assert found.ripple_before == pytest.approx(0.02, rel=1e-9)


def part_of_a_turn() -> ttc.Machine:
    """A double rocker, which can close over parts of the turn alone."""
    groups = (Crank("l1", "O", "A", 0.12), RRRDyad("l2", "l3", "A", "C", "B", (0.05, 0.11), branch="right"))
    bodies = (Body("l1", 1.0, 1e-3), Body("l2", 0.5, 1e-4), Body("l3", 1.0, 1e-3))
    points = {"O": (0.0, 0.0), "C": (0.1, 0.0), "G": (-0.3, -0.1)}
    return ttc.Machine("part", points, groups, bodies, range_rad=(0.6, 1.5))


def test_a_part_of_the_turn_is_balanced_over_that_part() -> None:
    """The residual of a least-squares fit is orthogonal to its terms: cosine and sine of the crank's angle."""
    machine = part_of_a_turn()
    found = counterweights(machine)
    assert 0.6 < found.theta_rad.min() < 0.602 and 1.498 < found.theta_rad.max() < 1.5
    twin = ttc.compile(found.machine, ["torque_gravity_Nm"], method="exact")
    after = twin.evaluate(found.theta_rad)["torque_gravity_Nm"]
    assert np.sum(after**2) < 0.1 * np.sum(found.before**2)
    for wave in (np.cos(found.theta_rad), np.sin(found.theta_rad)):
        assert abs(after @ wave) < 1e-12 * np.abs(found.before).sum()
    calmer = counterweights(machine, ["l1", "l3"], "shaking_force")
    assert 0.0 < calmer.rms[1] < 0.5 * calmer.rms[0]
    sprung = balancing_spring(machine, 0.1)
    assert sprung.rms_share < 0.5 and np.isfinite(sprung.after_Nm).all()


@pytest.mark.parametrize("count", [2, 3])
def test_what_linkages_on_one_shaft_undo_needs_no_weight(count: int) -> None:
    """Evenly spaced cranks balance each other: the residual of a weight's effect is rounding, not 1e14 kg."""
    places = tuple(ShaftPlace(2.0 * math.pi * k / count) for k in range(count))
    machine = replace(machines.handloom_beatup(), linkages=places)
    for against in ("gravity_torque", "shaking_force"):
        with pytest.raises(MachineError):
            counterweights(machine, against=against)  # type: ignore[arg-type]
        found = counterweights(machine, ["l1", "l3"], against)  # type: ignore[arg-type]
        assert found.weights[0].mass_kg < 1e-9 < found.weights[1].mass_kg < 10.0
        assert found.rms[1] < found.rms[0]
    with pytest.raises(MachineError, match="no spring between these points"):
        balancing_spring(machine, ends=[("C", "A")])


def test_what_cannot_be_balanced_is_said() -> None:
    with pytest.raises(MachineError, match="lacks masses"):
        counterweights(machines.elliptic_gear_beatup())
    for link in ("l2", "l6", "l9"):
        with pytest.raises(MachineError, match="fixed point"):
            counterweights(machines.tufting(), [link])
    lying = replace(machines.tufting(), gravity_m_s2=(0.0, 0.0))
    with pytest.raises(MachineError, match="l1 changes nothing of the gravity torque"):
        counterweights(lying)
    with pytest.raises(SceneError, match="between 0 and 1"):
        flywheel(machines.tufting(), 0.0)
    for ripple, speed in ((1e-12, 16.76), (0.02, 1e-4)):
        with pytest.raises(SceneError, match="no flywheel up to"):
            flywheel(machines.tufting(), ripple, speed)
    for needs_a_turn in (lambda m: flywheel(m, 0.02), opposed_linkages):
        with pytest.raises(MachineError, match="does not turn fully"):
            needs_a_turn(part_of_a_turn())
    with pytest.raises(SceneError, match="no point"):
        balancing_spring(machines.tufting(), ends=[("O", "Z")])
    with pytest.raises(SceneError, match="positive length"):
        counterweights(machines.tufting(), radius_m=0.0)
