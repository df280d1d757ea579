"""Random machines for hypothesis: four-bars, slider-cranks and six-bars with any bodies, loads, gravity, phases."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import Body, Load
from textile_twin_core.dynamics.loads import (
    Backing,
    ForceTable,
    JointDamping,
    JointFriction,
    PointDamping,
    ShaftFriction,
    SliderFriction,
    Spring,
    TorqueTable,
    TorsionSpring,
)
from textile_twin_core.machine import Machine, ShaftPlace
from textile_twin_core.mechanism import Crank, Group, RigidArm, RRPDyad, RRRDyad, Travel

ANGLES = tuple(2.0 * math.pi * k / 16 for k in range(16))
TABLE = tuple(2.0 + math.sin(a) - 0.5 * math.cos(2.0 * a) for a in ANGLES)


KINDS = ("four-bar", "slider-crank", "rocker slider", "rocker dyad", "coupler dyad")
LEAST_TRANSMISSION = math.radians(5.0)


@st.composite
def machines(draw: Any) -> Machine:
    """Draw a machine that closes over the whole turn with a transmission angle over 5 deg."""
    return closing_machine(draw(st.sampled_from(KINDS)), np.random.default_rng(draw(st.integers(0, 2**32 - 1))))


def closing_machine(kind: str, rng: np.random.Generator) -> Machine:
    """Return the first machine of a kind that closes over the whole turn with a transmission angle over 5 deg."""
    while True:
        try:
            machine = _machine(kind, rng)
        except ttc.MachineError:
            continue
        if min(c.transmission_angle_rad for c in machine.closeness) > LEAST_TRANSMISSION:
            return machine


@st.composite
def nearly_stretched(draw: Any) -> Machine:
    """Draw a four-bar whose coupler and rocker come once a turn within 1e-9 to 1e-3 of their length to one line."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    crank, coupler = rng.uniform(0.1, 0.4), rng.uniform(0.6, 0.9)
    short = 10.0 ** rng.uniform(-9.0, -3.0)
    points = {"O": (0.1, -0.2)}
    points["C"] = _beside(points["O"], 1.0, rng.uniform(-3.0, 3.0))
    rocker = 1.0 + crank - coupler + short
    groups = (
        Crank("crank", "O", "A", crank, rng.uniform(-3.0, 3.0)),
        RRRDyad("coupler", "rocker", "A", "C", "B", (coupler, rocker), "left" if rng.random() < 0.5 else "right"),
    )
    bodies = tuple(_body(rng, link, 1.0) for link in ("crank", "coupler", "rocker"))
    try:
        return Machine("near", points, groups, bodies, (JointFriction("rocker", 0.5), ShaftFriction(0.1, 0.2)))
    except ttc.MachineError:
        assume(False)
        raise


def _machine(kind: str, rng: np.random.Generator) -> Machine:
    size = float(rng.choice([0.05, 0.3, 2.0]))
    points = {"O": (0.1 * size, -0.2 * size)}
    groups: list[Group] = [Crank("crank", "O", "A", size * rng.uniform(0.05, 0.35), rng.uniform(-3.0, 3.0))]
    links = ["crank"]
    if kind == "slider-crank":
        groups.append(_slider(rng, "A", points["O"], size))
    else:
        points["C"] = _beside(points["O"], size, rng.uniform(-math.pi, math.pi))
        groups.append(_dyad(rng, ("coupler", "rocker", "A", "C", "B"), size))
        links += ["coupler", "rocker"]
    if kind in ("rocker slider", "rocker dyad", "coupler dyad"):
        on = "coupler" if kind == "coupler dyad" else "rocker"
        groups.append(RigidArm("arm", on, "D", size * rng.uniform(0.3, 0.8), rng.uniform(-3.0, 3.0)))
        links.append("arm")
    if kind == "rocker slider":
        groups.append(_slider(rng, "D", points["C"], size))
    if kind.endswith("dyad"):
        points["G"] = _beside(points["C"], size * rng.uniform(0.5, 1.5), rng.uniform(-math.pi, math.pi))
        groups.append(_dyad(rng, ("rod", "lever", "D", "G", "E"), size))
        links += ["rod", "lever"]
    measures: tuple[Travel, ...] = ()
    if isinstance(groups[-1], RRPDyad):
        links += ["rod", "slider"]
        measures = (Travel("tool", "F", "O", groups[-1].guide_direction),)
    possible = _loads(links, measures, size)
    chosen = rng.choice(len(possible), size=rng.integers(0, 4), replace=False)
    return Machine(
        kind,
        points,
        tuple(groups),
        tuple(_body(rng, link, size) for link in links),
        tuple(possible[k] for k in chosen),
        measures,
        (rng.uniform(-10.0, 10.0), rng.uniform(-10.0, 10.0)),
        linkages=tuple(ShaftPlace(p) for p in rng.uniform(-4.0, 4.0, rng.choice([1, 1, 1, 2]))),
    )


def _beside(point: tuple[float, float], distance: float, angle: float) -> tuple[float, float]:
    return point[0] + distance * math.cos(angle), point[1] + distance * math.sin(angle)


def _dyad(rng: np.random.Generator, names: tuple[str, str, str, str, str], size: float) -> RRRDyad:
    lengths = (size * rng.uniform(0.6, 1.5), size * rng.uniform(0.6, 1.5))
    return RRRDyad(*names, lengths, "left" if rng.random() < 0.5 else "right")


def _slider(rng: np.random.Generator, start: str, near: tuple[float, float], size: float) -> RRPDyad:
    direction = rng.uniform(-math.pi, math.pi)
    guide = _beside(near, size * rng.uniform(0.0, 0.4), rng.uniform(-math.pi, math.pi))
    lengths = (size * rng.uniform(0.6, 2.0), size * rng.uniform(0.1, 1.0))
    axis = (2.0 * math.cos(direction), 2.0 * math.sin(direction))
    return RRPDyad(
        "rod", "slider", start, "E", "F", lengths, guide, axis, "forward" if rng.random() < 0.5 else "backward"
    )


def _body(rng: np.random.Generator, link: str, size: float) -> Body:
    mass = rng.uniform(0.1, 5.0)
    centroid = (rng.uniform(-0.5, 1.5), rng.uniform(-0.5, 0.5))
    return Body(link, mass, mass * size**2 * rng.uniform(0.0, 0.2), centroid)


def _loads(links: list[str], measures: tuple[Travel, ...], size: float) -> list[Load]:
    last = links[-2] if measures else links[-1]
    loads: list[Load] = [
        ShaftFriction(0.02, 0.3),
        JointFriction(last, 0.5),
        JointFriction(last, 0.4, against=links[-3] if len(links) > 2 else "crank"),
        JointDamping(last, 0.05, against="crank"),
        PointDamping("E" if len(links) > 3 or measures else "B", 3.0 / size),
        Spring("O", "E" if len(links) > 3 or measures else "B", 30.0 / size, 0.4 * size, 2.0),
        TorqueTable(ANGLES, TABLE),
        TorqueTable(ANGLES, TABLE, on=last, scale=0.3),
        ForceTable("A", (1.0, -2.0), ANGLES, TABLE),
    ]
    if measures:
        loads += [Backing("tool", 40.0 / size, size, 1.1 * size, 3.0 / size), SliderFriction("slider", 5.0 / size)]
    if "rocker" in links:
        loads.append(TorsionSpring("rocker", 3.0, 0.2, 0.1))
    return loads


@st.composite
def motions(draw: Any, count: int = 64) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw angles over several turns, speeds of both signs and accelerations, (count,) each."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    speed, growth = rng.uniform(0.5, 60.0), rng.choice([0.0, 50.0, 2000.0])
    return rng.uniform(-30.0, 30.0, count), rng.uniform(-speed, speed, count), rng.uniform(-growth, growth, count)
