"""The state of a contact model between two instants."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.compiling import by_reference, compiled
from textile_twin_core.contact.plant import Plant, elastic_force

LENGTH_NOISE = 64 * 2.220446049250313e-16
"""Rounding of a gap, relative to the lengths it is the difference of."""
EPSILON = 2.220446049250313e-16


class PadState(IntEnum):
    """A pad is not touched, pushes, or is touched but slack because the body leaves faster than it recovers."""

    OFF = 0
    PUSHING = 1
    SLACK = 2


# The same as plain numbers, for loops that are compiled.
OFF, PUSHING, SLACK = (int(each) for each in PadState)


@by_reference
class ContactState(NamedTuple):
    """Where everything is, which stops are closed, what the pads do; changed in place as time goes on."""

    clock: FloatArray
    """(2,): time [s]; the largest speed so far [m/s], by which rounding and tolerance of a speed are measured"""
    positions: FloatArray
    """(movers,) [m]: the bodies, then the driven element"""
    velocities: FloatArray
    """(movers,) [m/s]"""
    closed: BoolArray
    """(stops,)"""
    released: BoolArray
    """(stops,): those whose force has come down to zero at this very instant"""
    pads: npt.NDArray[np.int64]
    """(pads,): `PadState` of each"""

    @property
    def time_s(self) -> float:
        """Its time."""
        return float(self.clock[0])

    def copy(self) -> ContactState:
        """An independent copy."""
        return ContactState._make(each.copy() for each in self)


@compiled
def forget_releases(state: ContactState) -> None:
    """Go on to another instant."""
    for stop in range(state.released.size):
        state.released[stop] = False


@compiled
def gap(plant: Plant, state: ContactState, stop: int) -> float:
    """Gap of a stop [m]."""
    total = 0.0
    for mover in range(state.positions.size):
        total += plant.stops[stop, mover] * state.positions[mover]
    return total + plant.limits[stop]


@compiled
def opening_speed(plant: Plant, state: ContactState, stop: int) -> float:
    """Speed at which a stop opens [m/s]."""
    total = 0.0
    for mover in range(state.velocities.size):
        total += plant.stops[stop, mover] * state.velocities[mover]
    return total


@compiled
def quiet_speed(plant: Plant, state: ContactState) -> float:
    """Speed [m/s] that cannot be told from zero: by the speeds there were, or by the rounding of lengths in forces."""
    return max(1e-13 * state.clock[1], 0.1 * LENGTH_NOISE * plant.length_m * plant.rate_s)


@compiled
def pad_compression(plant: Plant, state: ContactState, pad: int) -> tuple[float, float]:
    """Compression [m] of a pad and its rate [m/s]."""
    depth = rate = 0.0
    for mover in range(state.positions.size):
        depth += plant.pads[pad, mover] * state.positions[mover]
        rate += plant.pads[pad, mover] * state.velocities[mover]
    return depth - plant.pad_places[pad], rate


@compiled
def pad_force(plant: Plant, state: ContactState, pad: int) -> float:
    """Force [N] with which a pad pushes."""
    if state.pads[pad] != PUSHING:
        return 0.0
    depth, rate = pad_compression(plant, state, pad)
    return elastic_force(plant.pad_stiffness[pad], depth) + plant.pad_damping[pad] * rate
