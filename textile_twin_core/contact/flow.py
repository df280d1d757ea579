"""Motion between events: Taylor series of the solution, and their range of accuracy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.drive_series import DriveTerms, reach, taylor
from textile_twin_core.contact.mode import DRIVEN, Mode, fastest_rate
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.polynomials import largest, stretch
from textile_twin_core.contact.state import PUSHING, ContactState

_LINEAR_ORDER: Any = np.int64(24)
_LINEAR_REACH = 2.5
"""Phase over which the truncated series stays below rounding: (reach)^(order+1) / (order+1)! = 6e-16."""
_ROUNDING = 1e-15
_SLOWEST = 1e-3
_LONGER = 4.0
_LAST = 6
_TINY = 1e-300


@compiled
def step(
    plant: Plant, mode: Mode, state: ContactState, drive: DriveTerms, longest_s: float, tolerance: float
) -> tuple[float, FloatArray]:
    """Compute the next step's length [s] and power series (movers + pads, order+1) of positions [m] and pad forces [N].

    Without a pad the equations are linear: the series is that of the matrix exponential, truncated below rounding,
    whatever the tolerance. The force of a pad is a polynomial, so that coefficients follow from one another by products
    of series. The order depends on the tolerance (higher than in the reference), the step on the decay of the last
    coefficients. The error is at most the tolerance times the distance moved in the step at the largest speed so far.

    References:
        Jorba and Zou, Experimental Mathematics 14, 2005: Taylor integration.
    """
    time_s, speed_scale = state.clock[0], state.clock[1]
    rate = max(fastest_rate(plant, mode, state.pads), _SLOWEST)
    pushing = False
    for pad in range(state.pads.size):
        pushing = pushing or state.pads[pad] == PUSHING
    if not pushing:
        h = reach(drive, time_s, min(_LINEAR_REACH / rate, longest_s), _LINEAR_ORDER, _ROUNDING)
        return h, _series(plant, mode, state, taylor(drive, time_s, h, _LINEAR_ORDER), h)
    order = min(max(math.ceil(-0.8 * math.log(tolerance)) + 2, 8), 30)
    drive_error = max(1e-16, 1e-3 * min(tolerance, 1e-7))
    h = reach(drive, time_s, min(1.0 / max(rate, 1.0), longest_s), order, drive_error)
    series = _series(plant, mode, state, taylor(drive, time_s, h, order), h)
    factor = _LONGER
    for own in range(mode.clusters[0]):
        row = series[mode.first[own]]
        factor = min(factor, _holds(row, max(speed_scale * h, _TINY), order, tolerance))
    strongest = _TINY
    for pad in range(plant.masses.size + 1, series.shape[0]):
        strongest = max(strongest, largest(series[pad]))
    for pad in range(plant.masses.size + 1, series.shape[0]):
        factor = min(factor, _holds(series[pad, :order], strongest, order, tolerance))
    factor = reach(drive, time_s, min(h * factor, longest_s), order, drive_error) / h
    stretch(series, factor)
    return h * factor, series


@compiled
def _holds(series: FloatArray, scale: float, order: int, tolerance: float) -> float:
    """Compute the factor on the step at which the truncated terms reach the tolerance, relative to the series' scale.

    The radius of convergence is estimated from the last six coefficients, since some may vanish by symmetry.
    """
    radius = math.inf
    for power in range(series.size - _LAST, series.size):
        if series[power] != 0.0:
            radius = min(radius, (scale / abs(series[power])) ** (1.0 / power))
    return 0.9 * radius * tolerance ** (1.0 / (order - 2))


@compiled
def _series(plant: Plant, mode: Mode, state: ContactState, drive: FloatArray, h: float) -> FloatArray:
    """Compute the power series of every mover's position and every pad's force, from the clusters' equations."""
    bodies, pads, clusters, order = plant.masses.size, state.pads.size, mode.clusters[0], drive.size - 1
    series = np.zeros((bodies + 1 + pads, order + 1))
    powers = np.zeros((pads, plant.pad_stiffness.shape[1], order))
    for k in range(order + 1):
        series[bodies, k] = drive[k]
    _begin(plant, mode, state, series, h)
    for k in range(order):
        for pad in range(pads):
            if state.pads[pad] == PUSHING:
                series[bodies + 1 + pad, k] = _pad_term(plant, pad, series, powers[pad], k, h)
        if k == order - 1:
            break
        for own in range(clusters):
            right = mode.by_position[own] * drive[k] + (mode.constant[own] if k == 0 else 0.0)
            rate = mode.by_velocity[own] * drive[k + 1]
            for other in range(clusters):
                right -= mode.stiffness[own, other] * series[mode.first[other], k]
                rate -= mode.damping[own, other] * series[mode.first[other], k + 1]
            for pad in range(pads):
                right -= mode.by_pad[own, pad] * series[bodies + 1 + pad, k]
            term = (h * h * right + h * (k + 1) * rate) / ((k + 1) * (k + 2))
            for body in range(bodies):
                if mode.cluster[body] == own:
                    series[body, k + 2] = term
    return series


@compiled
def _begin(plant: Plant, mode: Mode, state: ContactState, series: FloatArray, h: float) -> None:
    """Write the bodies' first two coefficients, mass-weighted over each cluster, to conserve momentum."""
    bodies = plant.masses.size
    for own in range(mode.clusters[0]):
        position = speed = 0.0
        for body in range(bodies):
            if mode.cluster[body] == own:
                share = plant.masses[body] / mode.mass[own]
                position += share * (state.positions[body] - mode.offset[body])
                speed += share * state.velocities[body]
        for body in range(bodies):
            if mode.cluster[body] == own:
                series[body, 0], series[body, 1] = position + mode.offset[body], speed * h
    for body in range(bodies):
        if mode.cluster[body] < 0:
            if mode.cluster[body] == DRIVEN:
                for k in range(series.shape[1]):
                    series[body, k] = series[bodies, k]
            series[body, 0] += mode.offset[body]


@compiled
def _pad_term(plant: Plant, pad: int, series: FloatArray, powers: FloatArray, k: int, h: float) -> float:
    """Compute coefficient k of a pad's force, updating the powers (powers, order) of its compression."""
    compression = -plant.pad_places[pad] if k == 0 else 0.0
    rate = 0.0
    for mover in range(plant.masses.size + 1):
        compression += plant.pads[pad, mover] * series[mover, k]
        rate += plant.pads[pad, mover] * series[mover, k + 1]
    powers[0, k] = compression
    total = plant.pad_stiffness[pad, 0] * compression + plant.pad_damping[pad] * (k + 1) / h * rate
    for power in range(1, powers.shape[0]):
        term = 0.0
        for j in range(k + 1):
            term += powers[power - 1, j] * powers[0, k - j]
        powers[power, k] = term
        total += plant.pad_stiffness[pad, power] * term
    return total


@compiled
def arrive(state: ContactState, series: FloatArray, span_s: float, time_s: float) -> None:
    """Set the state at the end of a stretch."""
    for mover in range(state.positions.size):
        position = speed = 0.0
        for k in range(series.shape[1] - 1, -1, -1):
            position += series[mover, k]
            speed += k * series[mover, k]
        state.positions[mover], state.velocities[mover] = position, speed / span_s
        state.clock[1] = max(state.clock[1], abs(speed / span_s))
    state.clock[0] = time_s
