"""A contact model as arrays: masses, linear forces, and the attachment of stops and pads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.compiling import by_reference, compiled
from textile_twin_core.contact.model import ContactModel


@by_reference
class Plant(NamedTuple):
    """Arrays of one model. Movers are the bodies, then the driven element.

    The linear force on the movers is constant - stiffness x - damping v. Row k of `stops` times the positions, plus the
    limit, is the gap of stop k. Row k of `pads` times the positions, less its place, is the compression of pad k.
    """

    masses: FloatArray
    """(bodies,) [kg]"""
    stiffness: FloatArray
    """(movers, movers) [N/m]"""
    damping: FloatArray
    """(movers, movers) [N s/m]"""
    constant: FloatArray
    """(movers,) [N]"""
    stops: FloatArray
    """(stops, movers), entries -1, 0 and 1"""
    limits: FloatArray
    """(stops,) [m]"""
    restitutions: FloatArray
    """(stops,)"""
    pads: FloatArray
    """(pads, movers), entries -1, 0 and 1"""
    pad_places: FloatArray
    """(pads,) [m]"""
    pad_stiffness: FloatArray
    """(pads, powers): coefficients of c, c^2, c^3, ..."""
    pad_damping: FloatArray
    """(pads,) [N s/m]"""
    pad_pulls: BoolArray
    """(pads,)"""
    length_m: float
    """scale of rounding and tolerance of a length"""
    rate_s: float
    """bound [1/s] on the rate of the forces of springs and dampers"""


def plant_of(model: ContactModel) -> Plant:
    """Build the arrays of a model, without forces on the frame."""
    movers = len(model.bodies) + 1
    stiffness = np.zeros((movers + 1, movers + 1))
    damping = np.zeros((movers + 1, movers + 1))
    constant = np.zeros(movers + 1)
    constant[: movers - 1] = [body.force_N for body in model.bodies]
    ends = _normals(model, [(spring.upper, spring.lower) for spring in model.springs])
    for spring, pull in zip(model.springs, ends, strict=True):
        stiffness += spring.stiffness_N_m * np.outer(pull, pull)
        damping += spring.damping_Ns_m * np.outer(pull, pull)
        constant += spring.stiffness_N_m * spring.free_length_m * pull
    masses = np.array([body.mass_kg for body in model.bodies])
    stiffness, damping = (np.ascontiguousarray(matrix[:-1, :-1]) for matrix in (stiffness, damping))
    powers = max((len(pad.stiffness) for pad in model.pads), default=1)
    lengths = [abs(stop.limit_m) for stop in model.stops]
    lengths += [abs(pad.position_m) for pad in model.pads]
    lengths += [abs(spring.free_length_m) for spring in model.springs]
    return Plant(
        masses=masses,
        stiffness=stiffness,
        damping=damping,
        constant=constant[:-1].copy(),
        stops=_moving(_normals(model, [(stop.lower, stop.upper) for stop in model.stops])),
        limits=np.array([stop.limit_m for stop in model.stops], dtype=float),
        restitutions=np.array([stop.restitution for stop in model.stops], dtype=float),
        pads=_moving(_normals(model, [(pad.upper, pad.lower) for pad in model.pads])),
        pad_places=np.array([pad.position_m for pad in model.pads], dtype=float),
        pad_stiffness=np.array(
            [[*pad.stiffness, *[0.0] * (powers - len(pad.stiffness))] for pad in model.pads], dtype=float
        ).reshape(len(model.pads), powers),
        pad_damping=np.array([pad.damping_Ns_m for pad in model.pads], dtype=float),
        pad_pulls=np.array([pad.pulls for pad in model.pads], dtype=bool),
        length_m=max(lengths, default=0.0) or 1.0,
        rate_s=max(_rate(damping, masses), _rate(stiffness, masses) ** 0.5, 1.0),
    )


def _normals(model: ContactModel, ends: list[tuple[str, str]]) -> FloatArray:
    """Build rows (parts, movers + frame) with +1 at the first and -1 at the second end of each part."""
    rows = np.zeros((len(ends), len(model.index)))
    for row, (plus, minus) in zip(rows, ends, strict=True):
        row[model.index[plus]] += 1.0
        row[model.index[minus]] -= 1.0
    return rows


def _moving(normals: FloatArray) -> FloatArray:
    return np.ascontiguousarray(normals[:, :-1])


def _rate(matrix: FloatArray, masses: FloatArray) -> float:
    return float(np.abs(matrix[:-1] / masses[:, None]).sum(axis=1).max(initial=0.0))


@compiled
def linear_force(plant: Plant, mover: int, positions: FloatArray, velocities: FloatArray) -> float:
    """Compute the force [N] of springs, dampers and constants on one mover."""
    force = plant.constant[mover]
    for other in range(positions.size):
        force -= plant.stiffness[mover, other] * positions[other] + plant.damping[mover, other] * velocities[other]
    return force


@compiled
def elastic_force(stiffness: FloatArray, compression: float) -> float:
    """Compute the elastic force [N] of a pad with these coefficients at a compression [m]."""
    total = 0.0
    for power in range(stiffness.size - 1, -1, -1):
        total = (total + stiffness[power]) * compression
    return total
