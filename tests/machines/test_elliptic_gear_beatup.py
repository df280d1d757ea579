"""The elliptic-gear beat-up against print, and its forces against momentum worked out in 40 digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import textile_twin_core as ttc
from tests.machines.four_bar_by_hand import cross, rocker_joint
from textile_twin_core.machines import elliptic_gear_beatup
from textile_twin_core.mechanism import EllipticGearPair
from textile_twin_core.papers.beatup import elliptic_gear_rows

SPEED = 10 * np.pi
MASSES = {
    "gear_1_kg": 2.0,
    "gear_2_kg": 2.5,
    "crank_kg": 0.3,
    "coupler_kg": 0.4,
    "rocker_kg": 0.8,
    "sley_kg": 3.0,
    "gear_1_kgm2": 0.004,
    "gear_2_kgm2": 0.005,
    "crank_kgm2": 1e-4,
    "coupler_kgm2": 4e-4,
    "rocker_kgm2": 2e-3,
    "sley_kgm2": 2e-2,
}


def sley(machine: ttc.Machine, theta: np.ndarray) -> tuple[np.ndarray, ...]:
    names = ["sley_position_m", "sley_velocity_m_s", "sley_acceleration_m_s2"]
    motion = ttc.compile(machine, outputs=names).evaluate(theta, SPEED, 0.0)
    return tuple(motion[name] for name in names)


def test_sley_as_computed_and_printed() -> None:
    theta = np.radians(np.arange(0.0, 360.0, 0.01))
    position, speed, acceleration = sley(elliptic_gear_beatup(), theta)
    assert position.argmax() == 0 and position[0] == pytest.approx(84.991e-3, abs=5e-7)
    assert np.degrees(position[0] / 0.1895) == pytest.approx(25.697, abs=5e-4)
    assert 2 * 0.1895 * np.sin(position[0] / 0.1895 / 2) == pytest.approx(84.28e-3, abs=5e-6)
    assert speed[0] == pytest.approx(0.0, abs=1e-14)
    assert -acceleration[0] == pytest.approx(610.82, abs=5e-3)
    assert position[9200] == pytest.approx(6.83e-3, abs=5e-6)
    assert position[28500] == pytest.approx(5.34e-3, abs=5e-6)
    near = np.degrees(theta[position < 7e-3])
    assert near[0] == pytest.approx(91, abs=0.2) and near[-1] == pytest.approx(291, abs=0.2)
    assert len(near) == pytest.approx(20016, abs=1), "one stretch of 200 deg"


def test_four_degrees_before_the_largest_ratio_gives_no_such_dwell() -> None:
    before = elliptic_gear_beatup(past_largest_ratio_rad=np.radians(-4.0))
    position, _, _ = sley(before, np.radians([0.0, 92.0, 285.0]))
    assert np.abs(sley(before, np.linspace(0, 2 * np.pi, 36001))[2]).max() == pytest.approx(641.78, abs=5e-3)
    assert position[1:] == pytest.approx([1.67e-3, 13.29e-3], abs=5e-6)


def test_published_rows() -> None:
    rows = {row.quantity: row for row in elliptic_gear_rows()}
    assert rows["largest displacement of the sley"].computed == pytest.approx(84.991, abs=5e-4)
    beat_up = rows["acceleration of the sley at beat-up, 300 rpm"]
    assert beat_up.printed == 615.8434 and beat_up.computed == pytest.approx(610.82, abs=5e-3)
    assert beat_up.reason
    assert rows["dwell at the rear"].computed == pytest.approx(200.16, abs=0.01)
    assert rows["angle from AD to the crank, sley in front"].computed == pytest.approx(61.2496, abs=5e-5)
    assert rows["acceleration at beat-up, k = 0.90 over k = 0.85"].computed < 1


def test_speed_ratio_of_the_gears() -> None:
    machine = elliptic_gear_beatup()
    theta = np.linspace(0, 2 * np.pi, 36001)
    ratio = -ttc.compile(machine, outputs=["omega_gear_2_rad_s"]).evaluate(theta, 1.0, 0.0)["omega_gear_2_rad_s"]
    assert ratio.max() == pytest.approx(3.2264, abs=5e-5) and ratio.min() == pytest.approx(0.3099, abs=5e-5)
    assert np.degrees(theta[ratio.argmax()]) == pytest.approx(356.0, abs=0.02)


def test_torque_without_masses_says_which_are_missing() -> None:
    machine = elliptic_gear_beatup()
    for output in ("balancing_torque_Nm", "reaction_P_x_N", "kinetic_energy_J", "equivalent_inertia_kgm2"):
        with pytest.raises(ttc.TwinError) as caught:
            ttc.compile(machine, outputs=[output])
        assert all(name in str(caught.value) for name in MASSES) and "\n" not in str(caught.value)
    some = elliptic_gear_beatup(**{k: v for k, v in MASSES.items() if k not in ("sley_kg", "rocker_kgm2")})
    with pytest.raises(ttc.TwinError) as caught:
        ttc.compile(some, outputs=["balancing_torque_Nm"])
    assert "sley_kg, rocker_kgm2" in str(caught.value) and "gear_1_kg" not in str(caught.value)


ANGLE = st.floats(-3.1, 3.1)


@given(
    axis_ratio=st.floats(0.45, 1.0),
    angles=st.tuples(ANGLE, ANGLE, ANGLE, ANGLE),
    pressure_angle=st.floats(0.0, 0.4),
    lengths=st.floats(0.8, 1.2),
    alpha=st.floats(-2000.0, 2000.0),
)
@settings(max_examples=20)
def test_both_torque_routes_agree_over_a_turn(
    axis_ratio: float, angles: tuple[float, ...], pressure_angle: float, lengths: float, alpha: float
) -> None:
    past, ground, line, arm = angles
    machine = elliptic_gear_beatup(
        axis_ratio=axis_ratio,
        past_largest_ratio_rad=past,
        ground_angle_rad=ground,
        centre_line_rad=line,
        sley_angle_rad=arm,
        pressure_angle_rad=pressure_angle,
        rocker_m=0.18 * lengths,
        **MASSES,
    )
    theta = np.linspace(-4.0, 10.0, 1001)
    twin = ttc.compile(machine, outputs=["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"])
    r = twin.evaluate(theta, SPEED * (1 + 0.02 * np.cos(theta)), alpha * np.sin(3 * theta))
    one, other = r["balancing_torque_Nm"], r["balancing_torque_newton_euler_Nm"]
    assert np.abs(one - other).max() < 1e-12 * np.abs(one).max()


class ByHand:
    """Bodies of the default machine as functions of theta: (mass, inertia, place, angle) each, in mpmath's digits."""

    def __init__(self) -> None:
        self.a = 2 * mp.mpf(0.071233)
        self.e = mp.sqrt(1 - mp.mpf(0.85) ** 2)
        self.foot = self.a + mp.mpf(0.199) * mp.expj(mp.radians(135))
        self.front = mp.radians(135) + mp.acos(
            (mp.mpf("0.14") ** 2 + mp.mpf("0.199") ** 2 - mp.mpf("0.18") ** 2) / (2 * mp.mpf("0.14") * mp.mpf("0.199"))
        )

    def gear_2_turn(self, f1: mp.mpf) -> mp.mpf:
        turns = mp.floor((f1 + mp.pi) / (2 * mp.pi))
        rest = f1 - 2 * mp.pi * turns
        return 2 * mp.pi * turns + 2 * mp.atan((1 - self.e) / (1 + self.e) * mp.tan(rest / 2))

    def bodies(self, theta: mp.mpf) -> list[tuple[float, float, mp.mpc, mp.mpf]]:
        f0 = mp.pi + mp.radians(4)
        f1 = f0 + theta
        turned = self.gear_2_turn(f1)
        gear_1, gear_2 = mp.pi + f1, mp.pi - turned
        crank = self.front - (turned - self.gear_2_turn(f0))
        pin = self.a + mp.mpf("0.04") * mp.expj(crank)
        joint = rocker_joint(pin, self.foot, 0.1, 0.18, +1)
        along, down = joint - pin, (joint - self.foot) / abs(joint - self.foot)
        m = MASSES
        return [
            (m["gear_1_kg"], m["gear_1_kgm2"], self.e * self.a / 2 * mp.expj(gear_1), gear_1),
            (m["gear_2_kg"], m["gear_2_kgm2"], self.a + self.e * self.a / 2 * mp.expj(gear_2), gear_2),
            (m["crank_kg"], m["crank_kgm2"], (self.a + pin) / 2, crank),
            (m["coupler_kg"], m["coupler_kgm2"], (pin + joint) / 2, mp.arg(along)),
            (m["rocker_kg"], m["rocker_kgm2"], (self.foot + joint) / 2, mp.arg(down)),
            (m["sley_kg"], m["sley_kgm2"], self.foot + mp.mpf("0.1895") / 2 * down, mp.arg(down)),
        ]


@pytest.mark.parametrize("theta", [0.05, 1.0, 3.0, 4.4, 6.1])
@pytest.mark.parametrize("alpha", [0.0, 900.0])
def test_forces_balance_the_momentum_of_the_whole_machine(theta: float, alpha: float) -> None:
    """Ground reactions and torque are the rate of momentum, power that of energy; from positions in 40 digits alone."""
    by_hand = ByHand()
    pins = [f"reaction_{point}_{axis}_N" for point in "OAPD" for axis in "xy"]
    ours = ttc.compile(elliptic_gear_beatup(**MASSES), outputs=["balancing_torque_Nm", *pins]).evaluate(
        theta, SPEED, alpha
    )
    force = {point: ours[f"reaction_{point}_x_N"] + 1j * ours[f"reaction_{point}_y_N"] for point in "OAPD"}

    with mp.workdps(40):
        here = by_hand.bodies(mp.mpf(theta))

        def rates(k: int, part) -> tuple[float, float]:  # type: ignore[no-untyped-def]
            return tuple(float(mp.diff(lambda t: part(by_hand.bodies(t)[k]), mp.mpf(theta), n)) for n in (1, 2))

        total, moment, power = 0j, 0.0, 0.0
        for k, (mass, inertia, place, _) in enumerate(here):
            x1, x2 = rates(k, lambda body: body[2].real)
            y1, y2 = rates(k, lambda body: body[2].imag)
            p, q = rates(k, lambda body: body[3])
            acceleration = complex(x2, y2) * SPEED**2 + complex(x1, y1) * alpha
            spin = q * SPEED**2 + p * alpha
            push = mass * (acceleration + 9.81j)
            total += push
            moment += cross(complex(place), push) + inertia * spin
            power += (push * complex(x1, -y1)).real + inertia * spin * p
        foot = complex(by_hand.foot)
        reach = float(by_hand.a)

    assert ours["balancing_torque_Nm"] == pytest.approx(power, rel=1e-12, abs=1e-11)
    assert abs(force["O"] + force["A"] + force["D"] - total) < 1e-11 * max(1, abs(total))
    ground = cross(reach, force["A"]) + cross(foot, force["D"]) + ours["balancing_torque_Nm"]
    assert ground == pytest.approx(moment, rel=1e-11, abs=1e-10)


def test_teeth_press_at_the_pressure_angle() -> None:
    """The tooth force stands 20 deg off the common tangent of the ellipses and never pulls the gears together."""
    machine = elliptic_gear_beatup(**MASSES)
    pair = machine.groups[0]
    assert isinstance(pair, EllipticGearPair)
    theta = np.linspace(0, 2 * np.pi, 721)
    names = [f"point_{p}_{a}_m" for p in "OPF" for a in "xy"] + ["reaction_P_x_N", "reaction_P_y_N"]
    r = ttc.compile(machine, outputs=names).evaluate(theta, SPEED, 0.0)
    touch, focus = (r[f"point_{p}_x_m"] + 1j * r[f"point_{p}_y_m"] for p in "PF")
    force = r["reaction_P_x_N"] + 1j * r["reaction_P_y_N"]
    # of the ellipse's normal, from driver to driven gear: it halves the angle between the lines to the foci
    normal = touch / np.abs(touch) + (touch - focus) / np.abs(touch - focus)
    normal /= np.abs(normal)
    pressing = (force * normal.conj()).real / np.abs(force)
    assert np.degrees(np.arcsin(pressing)) == pytest.approx(np.full(721, 20.0), abs=1e-9)


def test_lengths_without_a_front_dead_centre_are_refused() -> None:
    with pytest.raises(ttc.MachineError, match="no triangle"):
        elliptic_gear_beatup(coupler_m=0.5)
    with pytest.raises(ttc.MachineError, match="shaft angle"):
        elliptic_gear_beatup(crank_m=0.15, coupler_m=0.1)
