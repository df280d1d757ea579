"""Events of one turn at constant shaft speed forward: where loads set in, where measures turn back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from textile_twin_core.expression import Expr
from textile_twin_core.expression.blocks import BlockProgram
from textile_twin_core.expression.scalar import compile_scalar

if TYPE_CHECKING:
    from textile_twin_core.machines.machine import Machine

_SAMPLES = 2880
_START = 0.1234
"""Where the search begins [rad]: no angle at which machines are set, so that no event lies on a sample."""


@dataclass(frozen=True)
class Event:
    """Something that happens at a shaft angle in [0, 2 pi) [rad]."""

    name: str
    angle_rad: float


def machine_events(machine: Machine) -> tuple[Event, ...]:
    """Events of the first linkage, by angle; crossings to the rounding of the angle."""
    linkage = machine.model.first
    found: list[Event] = []
    for load in machine.loads:
        for crossing in load.crossings(linkage.load_context):
            rising, falling = crossings(crossing.level)
            found += [Event(crossing.name, angle) for angle in (rising if crossing.rising else falling)]
    for name, displacement in linkage.displacements.items():
        rising, falling = crossings(displacement.first)
        found += [Event(f"{name}_largest", angle) for angle in falling]
        found += [Event(f"{name}_smallest", angle) for angle in rising]
    return tuple(sorted(found, key=lambda event: event.angle_rad))


def crossings(level: Expr) -> tuple[list[float], list[float]]:
    """Angles in [0, 2 pi) where a periodic expression of theta crosses zero: rising, falling [rad]."""
    theta = _START + np.linspace(0.0, 2.0 * math.pi, _SAMPLES, endpoint=False)
    values = np.empty_like(theta)
    BlockProgram([level], ["theta"])([theta], [values])
    function = compile_scalar([level], ["theta"])
    rising: list[float] = []
    falling: list[float] = []
    positive = values >= 0.0
    following = np.roll(positive, -1)  # the last interval ends where the first begins, one turn on
    for i in np.flatnonzero(positive != following):
        low = float(theta[i])
        angle = _root(lambda t: function(t)[0], low, low + 2.0 * math.pi / _SAMPLES) % (2.0 * math.pi)
        (rising if following[i] else falling).append(angle)
    return rising, falling


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    at_low, at_high = function(low), function(high)
    if at_low * at_high >= 0.0:  # one end is the root, to rounding
        return low if abs(at_low) <= abs(at_high) else high
    root: float = brentq(function, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps)
    return root
