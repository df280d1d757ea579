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

_SAMPLES = 2881


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
    """Angles in [0, 2 pi) where an expression of theta crosses zero: rising, falling [rad]."""
    theta = np.linspace(0.0, 2.0 * math.pi, _SAMPLES)
    values = np.empty_like(theta)
    BlockProgram([level], ["theta"])([theta], [values])
    function = compile_scalar([level], ["theta"])
    rising: list[float] = []
    falling: list[float] = []
    positive = values >= 0.0
    for i in np.flatnonzero(positive[1:] != positive[:-1]):
        angle = _root(lambda t: function(t)[0], float(theta[i]), float(theta[i + 1])) % (2.0 * math.pi)
        (rising if positive[i + 1] else falling).append(angle)
    return rising, falling


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    if function(low) == 0.0:
        return low
    if function(high) == 0.0:
        return high
    root: float = brentq(function, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps)
    return root
