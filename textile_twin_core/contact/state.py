"""State of a contact model between two instants."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.compiling import by_reference, compiled
from textile_twin_core.contact.plant import Plant, elastic_force

LENGTH_NOISE = 64 * 2.220446049250313e-16
"""Rounding of a gap, relative to the lengths whose difference it is."""
EPSILON = 2.220446049250313e-16


class PadState(IntEnum):
    """State of a pad: not touched, pushing, or touched but slack behind a body that leaves too fast."""

    OFF = 0
    PUSHING = 1
    SLACK = 2


# The same as plain numbers, for compiled loops.
OFF, PUSHING, SLACK = (int(each) for each in PadState)


@by_reference
class ContactState(NamedTuple):
    """Positions, closed stops and states of the pads; changed in place as time advances."""

    clock: FloatArray
    """(2,): time [s]; largest speed so far [m/s], the scale of rounding and tolerance of a speed"""
    positions: FloatArray
    """(movers,) [m]: the bodies, then the driven element"""
    velocities: FloatArray
    """(movers,) [m/s]"""
    closed: BoolArray
    """(stops,)"""
    released: BoolArray
    """(stops,): stops whose force has just reached zero"""
    pads: npt.NDArray[np.int64]
    """(pads,): `PadState` of each"""

    @property
    def time_s(self) -> float:
        """Time [s]."""
        return float(self.clock[0])

    def copy(self) -> ContactState:
        """Return an independent copy."""
        return ContactState._make(each.copy() for each in self)


@compiled
def forget_releases(state: ContactState) -> None:
    """Clear the releases for the next instant."""
    for stop in range(state.released.size):
        state.released[stop] = False


@compiled
def gap(plant: Plant, state: ContactState, stop: int) -> float:
    """Compute the gap of a stop [m]."""
    total = 0.0
    for mover in range(state.positions.size):
        total += plant.stops[stop, mover] * state.positions[mover]
    return total + plant.limits[stop]


@compiled
def opening_speed(plant: Plant, state: ContactState, stop: int) -> float:
    """Compute the opening speed of a stop [m/s]."""
    total = 0.0
    for mover in range(state.velocities.size):
        total += plant.stops[stop, mover] * state.velocities[mover]
    return total


@compiled
def quiet_speed(plant: Plant, state: ContactState) -> float:
    """Compute the speed [m/s] below which speeds are rounding, of earlier speeds or of lengths in forces."""
    return max(1e-13 * state.clock[1], 0.1 * LENGTH_NOISE * plant.length_m * plant.rate_s)


@compiled
def pad_compression(plant: Plant, state: ContactState, pad: int) -> tuple[float, float]:
    """Compute the compression [m] of a pad and its rate [m/s]."""
    depth = rate = 0.0
    for mover in range(state.positions.size):
        depth += plant.pads[pad, mover] * state.positions[mover]
        rate += plant.pads[pad, mover] * state.velocities[mover]
    return depth - plant.pad_places[pad], rate


@compiled
def pad_force(plant: Plant, state: ContactState, pad: int) -> float:
    """Compute the force [N] of a pushing pad."""
    if state.pads[pad] != PUSHING:
        return 0.0
    depth, rate = pad_compression(plant, state, pad)
    return elastic_force(plant.pad_stiffness[pad], depth) + plant.pad_damping[pad] * rate
