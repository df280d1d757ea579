"""Equations of Xu et al. 2016 that, as printed, do not describe the paper's own machine."""

from __future__ import annotations

import numpy as np

from textile_twin_core.machine.machine import Machine
from textile_twin_core.papers.rows import PrintedAndOurs, over_a_turn, span

_SAMPLES = 3600
_MOTION = ("theta_2_rad", "omega_2_rad_s", "alpha_2_rad_s2", "omega_4_rad_s", "alpha_4_rad_s2", "theta_5_rad")


def equation_rows(machine: Machine, speed_rad_s: float) -> list[PrintedAndOurs]:
    """Compare results of the printed equations and of the machine, and name the misprints.

    The machine is the tufting machine without friction, at constant speed.
    """
    p = machine.parameters
    force = [f"inertia_force_2_{axis}_N" for axis in "xy"]
    turn = over_a_turn(machine, [*_MOTION, *force, "driven_shaft_torque_Nm"], speed_rad_s, _SAMPLES)
    t1 = np.linspace(0.0, 2.0 * np.pi, _SAMPLES, endpoint=False)
    t2, w2, a2, w4, a4, t5 = (turn[name] for name in _MOTION)
    torque = turn["driven_shaft_torque_Nm"]

    half_2, half_4 = p["l2_m"] / 2.0, p["l4_m"] / 2.0
    eq_23 = -p["l2_m"] * speed_rad_s**2 * np.exp(1j * t1) + half_2 * (1j * a2 - w2**2) * np.exp(1j * t2)
    acceleration_2 = np.hypot(*(turn[name] for name in force)) / p["m2_kg"]
    # Eq. 35 counts torque clockwise, so the wrong sign of M4 = -J4 a4 counts twice.
    eq_35 = torque - 2.0 * p["J4_kgm2"] * a4
    return [
        (
            "Eq. 9: t2",
            "deg",
            span(np.degrees(np.arcsin(np.sin(t2))), 1),
            span(np.degrees(t2), 1),
            "the machine is on the other branch, pi - asin",
        ),
        (
            "Eq. 14: t5",
            "deg",
            span(np.degrees(np.arccos(np.cos(t5))), 1),
            span(np.degrees(t5), 1),
            "the machine is on the other branch, 2 pi - acos",
        ),
        ("Eq. 15: beta1 lies between", "", "l4 and l5", "l3 and l4", "rocker l3 and arm l4 are one piece"),
        (
            "Eq. 12, 13, 20, 22, 23 hold at",
            "",
            "any speed",
            "constant speed",
            "the terms with the shaft's acceleration are missing, M1 = 0 among them",
        ),
        (
            "Eq. 23: acceleration of l2, largest",
            "m/s^2",
            f"{np.abs(eq_23).max():.2f}",
            float(acceleration_2.max()),
            "l2 w1^2 must be l1 w1^2",
        ),
        (
            "Eq. 33: acceleration of l4 to C, largest",
            "m/s^2",
            f"{half_4 * np.abs(w4).max():.3f}",
            half_4 * float((w4**2).max()),
            "w4 must be w4^2",
        ),
        (
            "Eq. 35: driven-shaft torque, no friction",
            "N m",
            span(eq_35, 2),
            span(torque, 2),
            "+M4 instead of -M4, also in Eq. 43: its other terms count clockwise",
        ),
        ("Eq. 30: matrix for nine unknowns", "", "9 x 10", "9 x 9", "its ninth column is empty"),
        ("Eq. 41: matrix for eight unknowns", "", "8 x 9", "8 x 8", "its eighth column is empty"),
        (
            "Eq. 39-43: y counts",
            "",
            "up and down",
            "up",
            "Eq. 39 and its row of Eq. 43 count downwards, the others upwards",
        ),
    ]
