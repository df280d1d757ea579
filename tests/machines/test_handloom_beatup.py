"""The carpet loom's beat-up against print and against statics worked out by hand."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

import textile_twin_core as ttc
from tests.machines.four_bar_by_hand import cross, joint_forces, rocker_joint, second_derivative
from textile_twin_core.machines import handloom_beatup
from textile_twin_core.papers.beatup import handloom_rows
from textile_twin_core.synthesis import crank_rocker

SPEED = 15.5


def test_lengths_are_the_chosen_design() -> None:
    best = crank_rocker(np.radians(30.0), np.pi).best
    assert best is not None
    lengths, chosen = best.scaled(0.3), handloom_beatup().parameters
    for ours, printed in (
        (lengths.crank_m, chosen["crank_m"]),
        (lengths.coupler_m, chosen["coupler_m"]),
        (lengths.rocker_m, chosen["rocker_m"]),
    ):
        assert ours == pytest.approx(printed, abs=5e-5)


def test_beater_as_computed_and_printed() -> None:
    machine = handloom_beatup()
    names = ["beater_position_m", "beater_velocity_m_s", "beater_acceleration_m_s2"]
    theta = np.linspace(0, 2 * np.pi, 72001)
    motion = ttc.compile(machine, outputs=names).evaluate(theta, SPEED, 0.0)
    position, speed, acceleration = (motion[name] for name in names)
    assert np.degrees(np.ptp(position) / 0.3001) == pytest.approx(29.979, abs=5e-4)
    assert position.min() == pytest.approx(0.0, abs=1e-10)
    assert -acceleration.min() == pytest.approx(25.43, abs=5e-3)
    assert acceleration.max() == pytest.approx(14.68, abs=5e-3)
    assert -acceleration[position.argmax()] == pytest.approx(25.05, abs=5e-3)
    assert np.abs(speed).max() == pytest.approx(1.289, abs=5e-4)
    # the front dead centre: crank and coupler stretched, at beta = 48 deg
    (front,) = [e.angle_rad for e in machine.events() if e.name == "beater_largest"]
    assert np.degrees(front) == pytest.approx(48.0, abs=0.01)


def test_published_rows() -> None:
    rows = {row.quantity: row for row in handloom_rows()}
    assert rows["swing of the beater"].computed == pytest.approx(29.979, abs=5e-4)
    assert rows["largest acceleration of the beater"].computed == pytest.approx(25.43, abs=5e-3)
    assert rows["largest beat-up force"].computed == pytest.approx(63.6, abs=0.05)
    assert rows["inertia of DC"].computed == pytest.approx(4.80e-5, abs=5e-8)
    assert "15 mm" in rows["inertia of DC"].reason
    for quantity, digits in (("mass of DC", 5e-4), ("mass of CB", 5e-4), ("mass of AE", 5e-4), ("inertia of AE", 5e-5)):
        deviation = rows[quantity].deviation
        assert deviation is not None and abs(deviation) < digits


@pytest.mark.parametrize("theta", [0.0, 0.8378, 2.5, 4.0, 5.9])
@pytest.mark.parametrize("alpha", [0.0, -300.0])
def test_joint_loads_by_hand(theta: float, alpha: float) -> None:
    """Loads of Fig. 7 and the torque from accelerations in 40 digits and a 9 x 9 system."""
    machine = handloom_beatup(ground_angle_rad=0.3)
    p = machine.parameters
    pivot = mp.mpc(p["ground_m"] * mp.expj(mp.mpf(0.3)))

    def pin(t: mp.mpf) -> mp.mpc:
        return p["crank_m"] * mp.expj(t)

    def joint(t: mp.mpf) -> mp.mpc:
        return rocker_joint(pin(t), pivot, p["coupler_m"], p["rocker_m"], +1)

    def towards(t: mp.mpf) -> mp.mpc:
        return (joint(t) - pivot) / p["rocker_m"]

    def acceleration(curve) -> complex:  # type: ignore[no-untyped-def]
        with mp.workdps(40):
            slope = complex(mp.diff(lambda t: curve(t).real, theta), mp.diff(lambda t: curve(t).imag, theta))
        return second_derivative(curve, theta) * SPEED**2 + slope * alpha

    def turning(start, end) -> float:  # type: ignore[no-untyped-def]
        """Angular acceleration of a link from those of its ends."""
        at = complex(end(mp.mpf(theta)) - start(mp.mpf(theta)))
        return cross(at, acceleration(end) - acceleration(start)) / abs(at) ** 2

    def ground(_: mp.mpf) -> mp.mpc:
        return mp.mpc(0)

    def middle(t: mp.mpf) -> mp.mpc:
        return pin(t) / 2

    def coupler_middle(t: mp.mpf) -> mp.mpc:
        return (pin(t) + joint(t)) / 2

    def arm_middle(t: mp.mpf) -> mp.mpc:
        return pivot + p["arm_m"] / 2 * towards(t)

    def beater(t: mp.mpf) -> mp.mpc:
        return pivot + p["arm_m"] * towards(t)

    gravity, here = -9.81j, mp.mpf(theta)
    arm_force = p["arm_kg"] * (gravity - acceleration(arm_middle))
    beater_force = p["beater_kg"] * (gravity - acceleration(beater))
    swing = turning(lambda t: pivot, joint)
    wrenches = [
        (complex(middle(here)), p["crank_kg"] * (gravity - acceleration(middle)), -p["crank_kgm2"] * alpha),
        (
            complex(coupler_middle(here)),
            p["coupler_kg"] * (gravity - acceleration(coupler_middle)),
            -p["coupler_kgm2"] * turning(pin, joint),
        ),
        (
            complex(arm_middle(here)),
            arm_force + beater_force,
            cross(complex(beater(here) - arm_middle(here)), beater_force) - p["arm_kgm2"] * swing,
        ),
    ]
    c, b, a = complex(pin(here)), complex(joint(here)), complex(pivot)
    forces, torque = joint_forces((0j, c), (c, b), (a, b), wrenches)

    pins = [f"reaction_{point}_{axis}_N" for point in "DCBA" for axis in "xy"]
    names = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm", *pins]
    ours = ttc.compile(machine, outputs=names).evaluate(theta, SPEED, alpha)
    assert ours["balancing_torque_Nm"] == pytest.approx(torque, abs=1e-12)
    assert ours["balancing_torque_newton_euler_Nm"] == pytest.approx(torque, abs=1e-12)
    for k, point in enumerate("DCBA"):
        there = ours[f"reaction_{point}_x_N"] + 1j * ours[f"reaction_{point}_y_N"]
        assert abs(there - forces[k]) < 1e-10, point


def test_both_torque_routes_agree_over_a_turn() -> None:
    theta = np.linspace(0, 2 * np.pi, 2001)
    names = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]
    twin = ttc.compile(handloom_beatup(arm_angle_rad=0.4, rocker_kg=0.2), outputs=names)
    for alpha in (0.0, 200.0 * np.sin(3 * theta)):
        r = twin.evaluate(theta, SPEED * (1 + 0.02 * np.cos(theta)), alpha)
        one, other = (r[name] for name in names)
        assert np.abs(one - other).max() < 1e-12 * np.abs(one).max()


def test_open_linkage_is_refused_with_its_angle() -> None:
    with pytest.raises(ttc.MachineError, match=r"shaft angle of .* deg"):
        handloom_beatup(coupler_m=0.05)
    with pytest.raises(ttc.MachineError, match="mass"):
        handloom_beatup(beater_kg=-1.0)
