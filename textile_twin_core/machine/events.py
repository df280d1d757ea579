"""Events of one forward turn at constant speed: loads that set in, measures that turn back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from textile_twin_core.expression import Expr, const, derivative, substitute, variable
from textile_twin_core.expression.loop import Loop
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.machine.model import MachineModel
from textile_twin_core.mechanism.motion import FULL_TURN

DWELL_SHARE = 0.05
"""Largest distance from the turning point of a measure that counts as dwell, as a share of the stroke."""
_TURN = 2.0 * math.pi
_SAMPLES = 2880
_START = 0.1234
"""Start of the search [rad], at an unlikely setting of a machine, so that no event lies on a sample."""


@dataclass(frozen=True)
class Event:
    """A named event of a machine.

    Attributes:
        name: name of the event, such as `needle_enters_backing`.
        angle_rad: shaft angle in [0, 2 pi) [rad].
    """

    name: str
    angle_rad: float


def machine_events(model: MachineModel) -> tuple[Event, ...]:
    """Locate the events of the first linkage, by angle; crossings are exact to the rounding of the angle."""
    machine, linkage = model.machine, model.first
    found: list[Event] = []
    for load in machine.loads:
        for crossing in load.crossings(linkage.load_context):
            rising, falling = crossings(crossing.level, machine.range_rad)
            found += [Event(crossing.name, angle) for angle in (rising if crossing.rising else falling)]
    for name, displacement in linkage.displacements.items():
        rising, falling = crossings(displacement.first, machine.range_rad)
        found += [Event(f"{name}_largest", angle) for angle in falling]
        found += [Event(f"{name}_smallest", angle) for angle in rising]
    found += _lift_offs(model)
    return tuple(sorted(found, key=lambda event: event.angle_rad))


def _lift_offs(model: MachineModel) -> list[Event]:
    """Locate lift-off of bodies that only press on each other, at nominal speed; at angle 0 if they never press."""
    machine = model.machine
    steady = {variable("omega"): const(machine.nominal_speed_rad_s), variable("alpha"): const(0.0)}
    found: list[Event] = []
    contacts = [contact for group in machine.groups for contact in group.contact_forces]
    for contact in contacts if machine.bodies and not machine.missing_for_torque else ():
        (force,) = substitute([model.output(contact.output)], steady)
        rising, falling = crossings(force, machine.range_rad)
        at_start = compile_scalar([force], ["theta"])(machine.range_rad[0])[0]
        parting = falling if rising or falling or at_start >= 0.0 else [machine.range_rad[0] % _TURN]
        found += [Event(contact.lift_off, angle) for angle in parting]
    return found


def crossings(level: Expr, range_rad: tuple[float, float] = FULL_TURN) -> tuple[list[float], list[float]]:
    """Find the angles in [0, 2 pi) where an expression of theta crosses zero within a range: rising, falling [rad].

    Over a full turn the expression is taken as periodic. A double crossing between two samples is found by the turning
    point between them.
    """
    low, high = range_rad
    if high - low >= (1.0 - 1e-12) * _TURN:
        low, high = _START, _START + _TURN
    theta = np.linspace(low, high, _SAMPLES + 1)
    slope = derivative([level], variable("theta"))[0]
    values, slopes = np.empty_like(theta), np.empty_like(theta)
    Loop([level, slope], ["theta"])([theta], [values, slopes])
    at, along = (compile_scalar([e], ["theta"]) for e in (level, slope))
    nearing = (values[:-1] * slopes[:-1] < 0.0) & (values[1:] * slopes[1:] > 0.0)
    between = [_root(lambda t: along(t)[0], *theta[i : i + 2].tolist()) for i in np.flatnonzero(nearing)]
    theta = np.union1d(theta, between)
    values = np.array([at(t)[0] for t in theta.tolist()]) if between else values
    rising: list[float] = []
    falling: list[float] = []
    positive = values >= 0.0
    for i in np.flatnonzero(positive[:-1] != positive[1:]):
        angle = _root(lambda t: at(t)[0], *theta[i : i + 2].tolist()) % _TURN
        (rising if positive[i + 1] else falling).append(angle)
    return rising, falling


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Bisect to neighbouring numbers: as exact as Brent's method, without the import of an optimiser at every start."""
    at_low, at_high = function(low), function(high)
    if at_low * at_high >= 0.0:  # one end is the root to rounding
        return low if abs(at_low) <= abs(at_high) else high
    while low < (middle := 0.5 * (low + high)) < high:
        at_middle = function(middle)
        if at_middle * at_low > 0.0:
            low, at_low = middle, at_middle
        else:
            high, at_high = middle, at_middle
    return low if abs(at_low) <= abs(at_high) else high
