"""A tufting machine on its drive, from standstill to speed: motor, flywheel, elastic shaft, bearings, six-bar.

The linkage is that of Xu et al. 2016 (Table 1). The drive line around it is invented, and sized for a speed ripple of a
few percent at 160 rpm. It includes effects beyond a twin of the linkage: shaft elasticity and damping, bearing
friction, needle points that are not level, friction that needs a slip.

    motor, flywheel --- torque sensor, elastic shaft --- bearings, crank with encoder, six-bar, backing
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from tests.generators.multibody import Body, Floats, Guide, Multibody, Pin, Weld

STEPS_PER_SECOND = 16_000


@dataclass(frozen=True)
class Rig:
    """True parameters of a recording, SI units.

    The backing holds the needles below `backing_plane_m` (distance under C) with `backing_force_N` against their
    motion. The needle points lie within `needle_spread_m`, half above and half below the nominal one, so the force
    grows over that depth. Friction builds up over a creep speed: tanh(speed / creep).
    """

    speed_rpm: float = 160.0
    brake_s: float = 1.0
    ramp_s: float = 3.0
    start_rad: float = 5.03
    wander: float = 0.003
    wander_period_s: float = 7.3
    breakdown_torque_Nm: float = 40.0
    breakdown_slip_rad_s: float = 4.5
    mean_slip_rad_s: float = 0.32
    flywheel_inertia_kgm2: float = 1.2
    shaft_stiffness_Nm_rad: float = 80_000.0
    shaft_damping_Nms_rad: float = 14.0
    bearing_viscous_Nms: float = 0.010
    bearing_coulomb_Nm: float = 0.15
    bearing_creep_rad_s: float = 0.05
    backing_force_N: float = 1000.0
    backing_plane_m: float = 0.55784
    needle_spread_m: float = 0.0004
    backing_creep_m_s: float = 0.005


@dataclass(frozen=True)
class Run:
    """Simulated motion at STEPS_PER_SECOND: time, angle and speed of the crank, torque in the shaft."""

    time_s: Floats
    theta_rad: Floats
    omega_rad_s: Floats
    shaft_torque_Nm: Floats


def tufting_multibody() -> Multibody:
    """Build the needle six-bar of Xu et al. 2016, Table 1: l3 and l4 two bodies welded at C, centroids mid-link."""
    l1, l2, l3, l4, l5, l6 = 0.015, 0.138, 0.115, 0.125, 0.120, 0.440
    x1, x2, height = 0.070, 0.100, 0.155
    bodies = [
        Body(3.07, 4.34e-3, (0.0, 0.0, 0.0)),
        Body(3.79, 26.99e-3, (-0.015, 0.07, math.radians(108.0))),
        Body(2.96, 10.77e-3, (0.015, 0.145, math.radians(192.0))),
        Body(1.74, 6.69e-3, (0.132, 0.155, 0.0)),
        Body(0.36, 0.91e-3, (0.182, 0.096, math.radians(258.0))),
        Body(1.47, 19.15e-3, (0.170, -0.183, -0.5 * math.pi)),
    ]
    joints: list[Pin | Weld | Guide] = [
        Pin(0, (-l1 / 2, 0.0), None, (0.0, 0.0)),
        Pin(0, (l1 / 2, 0.0), 1, (-l2 / 2, 0.0)),
        Pin(1, (l2 / 2, 0.0), 2, (l3 / 2, 0.0)),
        Pin(2, (-l3 / 2, 0.0), None, (x1, height)),
        Pin(3, (-l4 / 2, 0.0), None, (x1, height)),
        Weld(2, 3, math.radians(168.0) - 2.0 * math.pi),
        Pin(3, (l4 / 2, 0.0), 4, (-l5 / 2, 0.0)),
        Pin(4, (l5 / 2, 0.0), 5, (-l6 / 2, 0.0)),
        Guide(5, x1 + x2, -0.5 * math.pi),
    ]
    return Multibody(bodies, joints, driven=0)


class Linkage:
    """The six-bar reduced to the shaft, tabulated over one turn and interpolated linearly."""

    nodes = 1 << 14

    def __init__(self) -> None:
        system = tufting_multibody()
        turn = system.turn(2.0 * math.pi * np.arange(self.nodes + 1) / self.nodes)
        inertia, half_slope = system.inertia(turn)
        needle_below_c = 0.155 - (turn.q[:, 16] - 0.220)
        columns = (inertia, half_slope, system.gravity_torque(turn), needle_below_c, -turn.q1[:, 16])
        self._values = list(zip(*(c[:-1].tolist() for c in columns), strict=True))
        self._steps = list(zip(*(np.diff(c).tolist() for c in columns), strict=True))
        self._scale = self.nodes / (2.0 * math.pi)

    def at(self, theta: float) -> tuple[float, float, float, float, float]:
        """Interpolate inertia, half its slope, gravity torque, needle tip below C [m] and its slope [m/rad]."""
        position = theta * self._scale
        node = math.floor(position)
        part = position - node
        j, c, g, s, s1 = self._values[node & (self.nodes - 1)]
        dj, dc, dg, ds, ds1 = self._steps[node & (self.nodes - 1)]
        return j + part * dj, c + part * dc, g + part * dg, s + part * ds, s1 + part * ds1


@cache
def tabulated_linkage() -> Linkage:
    """Tabulate the linkage once."""
    return Linkage()


State = tuple[float, float, float, float]


class Machine:
    """Flywheel angle and speed, crank angle and speed under motor, shaft, bearings, linkage and backing."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.linkage = tabulated_linkage()

    def at_rest(self) -> State:
        """Return the initial state: brake on, crank hanging in the shaft, whose twist carries the linkage's weight."""
        gravity = self.linkage.at(self.rig.start_rad)[2]
        return self.rig.start_rad + gravity / self.rig.shaft_stiffness_Nm_rad, 0.0, self.rig.start_rad, 0.0

    def shaft_torque(self, state: State) -> float:
        """Compute the torque of the flywheel end on the crank end [N m]."""
        twist, twist_rate = state[0] - state[2], state[1] - state[3]
        return self.rig.shaft_stiffness_Nm_rad * twist + self.rig.shaft_damping_Nms_rad * twist_rate

    def motor_torque(self, time: float, speed: float) -> float:
        """Compute the torque of an inverter-fed induction motor by Kloss' formula, with a ramped, wandering field."""
        rig = self.rig
        rated = rig.speed_rpm * math.pi / 30.0 + rig.mean_slip_rad_s
        since = time - rig.brake_s
        field = rated * min(1.0, since / rig.ramp_s)
        field *= 1.0 + rig.wander * math.sin(2.0 * math.pi * since / rig.wander_period_s)
        slip = (field - speed) / rig.breakdown_slip_rad_s
        return 2.0 * rig.breakdown_torque_Nm * slip / (1.0 + slip * slip)

    def rates(self, time: float, state: State) -> State:
        """Compute the time derivative of the state."""
        rig = self.rig
        _, flywheel_speed, theta, omega = state
        inertia, half_slope, gravity, drop, drop_slope = self.linkage.at(theta)
        shaft = self.shaft_torque(state)
        load = half_slope * omega * omega + gravity
        load += rig.bearing_viscous_Nms * omega + rig.bearing_coulomb_Nm * math.tanh(omega / rig.bearing_creep_rad_s)
        inside = 0.5 + (drop - rig.backing_plane_m) / rig.needle_spread_m
        if inside > 0.0:
            force = rig.backing_force_N * min(1.0, inside)
            load += drop_slope * force * math.tanh(drop_slope * omega / rig.backing_creep_m_s)
        motor = self.motor_torque(time, flywheel_speed)
        return flywheel_speed, (motor - shaft) / rig.flywheel_inertia_kgm2, omega, (shaft - load) / inertia


def run(rig: Rig, duration_s: float) -> Run:
    """Integrate the rig from standstill by classical Runge-Kutta steps of fourth order."""
    machine = Machine(rig)
    count = round(duration_s * STEPS_PER_SECOND)
    brake = round(rig.brake_s * STEPS_PER_SECOND)
    step = 1.0 / STEPS_PER_SECOND
    theta, omega, torque = np.empty(count), np.empty(count), np.empty(count)
    state = machine.at_rest()
    for k in range(count):
        theta[k], omega[k], torque[k] = state[2], state[3], machine.shaft_torque(state)
        if k >= brake:
            state = _runge_kutta(machine, k * step, state, step)
    return Run(np.linspace(0.0, (count - 1) * step, count), theta, omega, torque)


def _runge_kutta(machine: Machine, time: float, state: State, step: float) -> State:
    half = 0.5 * step
    k1 = machine.rates(time, state)
    k2 = machine.rates(time + half, _moved(state, k1, half))
    k3 = machine.rates(time + half, _moved(state, k2, half))
    k4 = machine.rates(time + step, _moved(state, k3, step))
    mean = (
        k1[0] + 2.0 * (k2[0] + k3[0]) + k4[0],
        k1[1] + 2.0 * (k2[1] + k3[1]) + k4[1],
        k1[2] + 2.0 * (k2[2] + k3[2]) + k4[2],
        k1[3] + 2.0 * (k2[3] + k3[3]) + k4[3],
    )
    return _moved(state, mean, step / 6.0)


def _moved(state: State, rate: State, step: float) -> State:
    return (
        state[0] + step * rate[0],
        state[1] + step * rate[1],
        state[2] + step * rate[2],
        state[3] + step * rate[3],
    )
