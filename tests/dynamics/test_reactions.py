"""Pins of more than two links: the reported force is that of the coupler, by its own balance."""

from __future__ import annotations

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import Spring
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import CamFollower, Crank, Group, RRPDyad, RRRDyad
from textile_twin_core.mechanism.law_strokes import Stroke

THETA, OMEGA, ALPHA = np.linspace(-3.0, 9.0, 97), 20.0, 150.0
MORE: tuple[Group, ...] = (
    RRRDyad("rod", "lever", "B", "G", "E", (0.35, 0.3)),
    RRPDyad("bar", "slider", "B", "F", "T", (0.5, 0.1), (0.1, 0.1), (0.3, 1.0)),
)
"""Groups mounted on the point B."""


def test_the_pin_of_a_dyad_tells_what_its_coupler_exerts() -> None:
    """The Newton-Euler equations of the coupler alone give the force, independent of other links on the pin."""
    mass, inertia, length = 0.8, 0.011, 0.31
    groups = (Crank("crank", "O", "A", 0.06), RRRDyad("coupler", "rocker", "A", "C", "B", (length, 0.25)), *MORE)
    bodies = [Body(link, 0.6, 0.003) for link in ("rocker", "rod", "lever", "bar", "slider")]
    points = {"O": (0.0, 0.0), "C": (0.3, 0.05), "G": (0.45, 0.2)}
    machine = Machine(
        "loom", points, groups, (Body("coupler", mass, inertia), *bodies), (Spring("O", "E", 900.0, 0.2),)
    )
    names = [n for n in machine.outputs if n.startswith(("reaction_", "inertia_", "point_"))]
    v = ttc.compile(machine, names, method="exact").evaluate(THETA, OMEGA, ALPHA)
    x, y = v["point_B_x_m"] - v["point_A_x_m"], v["point_B_y_m"] - v["point_A_y_m"]
    fx, fy = v["inertia_force_coupler_x_N"], v["inertia_force_coupler_y_N"] - 9.81 * mass
    bx, by = v["reaction_B_x_N"], v["reaction_B_y_N"]
    scale = np.abs([bx, by]).max()
    assert np.abs(v["reaction_A_x_N"] + fx - bx).max() < 1e-12 * scale
    assert np.abs(v["reaction_A_y_N"] + fy - by).max() < 1e-12 * scale
    moment = 0.5 * (x * fy - y * fx) + v["inertia_torque_coupler_Nm"] - (x * by - y * bx)
    assert np.abs(moment).max() < 1e-12 * scale * length


def test_the_pin_of_a_roller_tells_what_the_cam_exerts() -> None:
    strokes = (Stroke(0.3, 1.2, 0.2), Stroke(1.5, 1.5, 0.0))
    cam = CamFollower("cam", "sley", "O", "M", "B", 0.06, 0.12, strokes, pivot="C", roller_radius_m=0.012)
    points = {"O": (0.0, 0.0), "C": (0.15, 0.03), "G": (0.3, 0.3)}
    bodies = tuple(Body(link, 0.6, 0.003) for link in ("sley", "rod", "lever"))
    machine = Machine("loom", points, (cam, MORE[0]), bodies)
    names = ["reaction_B_x_N", "reaction_B_y_N", "contact_force_sley_N"]
    v = ttc.compile(machine, names, method="exact").evaluate(THETA, OMEGA, ALPHA)
    size = np.abs(v["contact_force_sley_N"])
    assert np.abs(np.hypot(v["reaction_B_x_N"], v["reaction_B_y_N"]) - size).max() < 1e-12 * size.max()
