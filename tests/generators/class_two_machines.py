"""Random machines of every class-II group, including slotted levers, yokes, sliders on moving links and gears."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from textile_twin_core.dynamics import Body
from textile_twin_core.errors import MachineError
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import (
    MAIN_SHAFT,
    Crank,
    GearPair,
    Group,
    Guide,
    PRPDyad,
    RigidArm,
    RPPDyad,
    RPRDyad,
    RRPDyad,
    RRRDyad,
)

LEAST_TRANSMISSION = math.radians(8.0)
_TEETH = ((40, 20), (30, 30), (60, 20), (21, 7))


def class_two_machine(kind: str, rng: np.random.Generator) -> Machine:
    """Return the first random machine of a kind that closes over the whole turn, away from dead points."""
    while True:
        try:
            machine = _machine(kind, rng)
        except MachineError:
            continue
        close = machine.closeness
        if all(c.transmission_angle_rad > LEAST_TRANSMISSION and c.margin > 1e-2 for c in close):
            return machine


def _machine(kind: str, rng: np.random.Generator) -> Machine:
    points = {"O": (0.0, 0.0), "C": tuple(rng.uniform(-0.4, 0.4, 2).tolist())}
    crank = Crank("crank", "O", "A", rng.uniform(0.04, 0.12), rng.uniform(-3.0, 3.0))
    rocker = RRRDyad("coupler", "rocker", "A", "C", "B", tuple(rng.uniform(0.15, 0.5, 2).tolist()), _side(rng))
    groups: list[Group] = [crank, *_KINDS[kind](rng, points, rocker)]
    used = {word for group in groups for word in vars(group).values() if isinstance(word, str)}
    points = {name: place for name, place in points.items() if name in used}
    links = list(Machine("frame", points, tuple(groups)).linkage.solved.links)
    bodies = tuple(
        Body(link, rng.uniform(0.1, 3.0), rng.uniform(1e-4, 1e-2), tuple(rng.uniform(-0.4, 1.2, 2).tolist()))
        for link in links
    )
    return Machine(kind, points, tuple(groups), bodies, gravity_m_s2=tuple(rng.uniform(-10.0, 10.0, 2).tolist()))


def _side(rng: np.random.Generator) -> Any:
    return "left" if rng.random() < 0.5 else "right"


def _sense(rng: np.random.Generator) -> Any:
    return "forward" if rng.random() < 0.5 else "backward"


def _offset(rng: np.random.Generator) -> float:
    return 0.0 if rng.random() < 0.4 else rng.uniform(-0.05, 0.05)


def _pair(rng: np.random.Generator, low: float, high: float) -> tuple[float, float]:
    one, two = rng.uniform(low, high, 2).tolist()
    return one, two


def _slotted_lever(rng: np.random.Generator, start: str, pivot: str) -> RPRDyad:
    return RPRDyad(
        "block", "lever", start, pivot, "D", "T", (0.04, rng.uniform(0.2, 0.5)), _offset(rng), None, _sense(rng)
    )


def _ram(rng: np.random.Generator, start: str, on: str | None = None) -> RRPDyad:
    lengths = rng.uniform(0.2, 0.6), 0.1
    return RRPDyad(
        "rod", "ram", start, "E", "F", lengths, _pair(rng, -0.1, 0.1), _pair(rng, -1.0, 1.0), _sense(rng), on
    )


def _yoke(rng: np.random.Generator, start: str, on: str | None = None) -> RPPDyad:
    angle = rng.uniform(0.4, 2.7) * (1.0 if rng.random() < 0.7 else -1.0)
    place, along = _pair(rng, -0.1, 0.1), _pair(rng, -1.0, 1.0)
    return RPPDyad("die", "yoke", start, "Q", ("T1", "T2"), (0.03, 0.2), place, along, angle, on)


def _crossing(rng: np.random.Generator, one: str, two: str | None) -> PRPDyad:
    guides = tuple(Guide(on, _pair(rng, -0.1, 0.1), _pair(rng, -1.0, 1.0)) for on in (one, two))
    return PRPDyad(("first", "second"), "R", ("T1", "T2"), (0.05, 0.2), (guides[0], guides[1]))


def _gears(rng: np.random.Generator, at: str, to: str, driver: str | None) -> GearPair:
    teeth = _TEETH[rng.integers(len(_TEETH))]
    ring = teeth[0] != teeth[1] and rng.random() < 0.4
    return GearPair(
        "gear", at, to, "G", rng.uniform(0.02, 0.06), teeth, driver, ring, rng.uniform(-3.0, 3.0),
        pressure_angle_rad=0.0,
    )  # fmt: skip


def _links(rng: np.random.Generator, points: dict[str, Any], start: str) -> tuple[Group, ...]:
    """Build a rocker's dyad on a point of a slider."""
    points["X"] = _pair(rng, -0.5, 0.5)
    return (RRRDyad("coupler", "rocker", start, "X", "B", _pair(rng, 0.2, 0.7), _side(rng)),)


def _train(rng: np.random.Generator, points: dict[str, Any]) -> tuple[Group, ...]:
    """Build a second gear behind the first, and a crank on its shaft elsewhere."""
    points["X"], points["Y"] = _pair(rng, -0.5, 0.5), _pair(rng, -0.5, 0.5)
    teeth = _TEETH[rng.integers(len(_TEETH))]
    wheel = GearPair("wheel", "C", "X", "W", 0.03, teeth, "gear", phase_rad=0.5, mesh="M", pressure_angle_rad=0.0)
    return wheel, Crank("arm", "Y", "H", 0.05, 0.3, "wheel"), _ram(rng, "H")


_KINDS: dict[str, Any] = {
    "slotted lever": lambda rng, points, rocker: (_slotted_lever(rng, "A", "C"),),
    "oscillating cylinder": lambda rng, points, rocker: (_slotted_lever(rng, "C", "A"),),
    "lever on a rocker": lambda rng, points, rocker: (
        rocker, RigidArm("arm", "rocker", "H", 0.15, rng.uniform(-3.0, 3.0)), _slotted_lever(rng, "H", "O"),
    ),
    "slider between moving links": lambda rng, points, rocker: (
        rocker, RigidArm("arm", "rocker", "H", 0.2, rng.uniform(-3.0, 3.0)), _slotted_lever(rng, "H", "A"),
    ),
    "shaper with a link": lambda rng, points, rocker: (_slotted_lever(rng, "A", "C"), _ram(rng, "D")),
    "shaper with a block": lambda rng, points, rocker: (_slotted_lever(rng, "A", "C"), _crossing(rng, "lever", None)),
    "yoke": lambda rng, points, rocker: (_yoke(rng, "A"),),
    "yoke on a rocker": lambda rng, points, rocker: (rocker, _yoke(rng, "A", "rocker")),
    "ram on a coupler": lambda rng, points, rocker: (rocker, _ram(rng, "C", "coupler")),
    "two moving guides": lambda rng, points, rocker: (rocker, _crossing(rng, "rocker", "coupler")),
    "geared five-bar": lambda rng, points, rocker: (
        _gears(rng, "O", "C", "crank"), RRRDyad("coupler", "rocker", "A", "G", "B", rocker.lengths_m, rocker.branch),
    ),
    "gear on the shaft": lambda rng, points, rocker: (_gears(rng, "O", "C", MAIN_SHAFT), _ram(rng, "G")),
    "planet": lambda rng, points, rocker: (_gears(rng, "O", "A", None), _ram(rng, "G")),
    "gears on a rocker": lambda rng, points, rocker: (rocker, _gears(rng, "B", "C", "coupler"), _ram(rng, "G")),
    "links on a block": lambda rng, points, rocker: (_slotted_lever(rng, "A", "C"), *_links(rng, points, "T")),
    "links on a crossing": lambda rng, points, rocker: (
        _slotted_lever(rng, "A", "C"), _crossing(rng, "lever", None),
        *_links(rng, points, "R"),
    ),
    "links on a yoke": lambda rng, points, rocker: (_yoke(rng, "A"), *_links(rng, points, "Q")),
    "gear train": lambda rng, points, rocker: (
        _gears(rng, "O", "C", "crank"), *_train(rng, points),
    ),
    "planet and slotted lever": lambda rng, points, rocker: (
        _gears(rng, "O", "A", None), _slotted_lever(rng, "G", "C"), _yoke(rng, "D"),
    ),
}  # fmt: skip
KINDS = tuple(_KINDS)
