"""Monitor functions, whose sign changes are events: gaps, stop forces, compressions and forces of pads."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.polynomials import first_crossing, largest
from textile_twin_core.contact.state import EPSILON, LENGTH_NOISE, OFF, PUSHING, ContactState

CLOSES, RELEASES, TURNS_OFF, TURNS_PUSHING, TURNS_SLACK = range(5)
"""Possible events of a stop (the first two) and of a pad."""

_FORCE_NOISE = 1e-13
_OWN_NOISE = 1e-14
_RELEASE_NOISE = 1e-12


@compiled
def first_event(
    plant: Plant, state: ContactState, series: FloatArray, forces: FloatArray, span_s: float
) -> tuple[float, int, int]:
    """Find the place u of the earliest event of a step (infinity without one), its kind, and its stop or pad.

    `series` (movers + pads, order+1) comes from the step, `forces` (stops, order-1) from the closed stops. The search
    is on polynomials without sampling, so that no pair of crossings is missed.
    """
    length = LENGTH_NOISE * plant.length_m
    length += 4.0 * EPSILON * abs(state.clock[0]) * state.clock[1]  # the drive continues from the rounded time
    force = _FORCE_NOISE * _force_scale(plant, state.clock[1])
    best, kind, which = math.inf, CLOSES, 0
    for stop in range(state.closed.size):
        if not state.closed[stop]:
            found = first_crossing(_between(plant.stops[stop], 1.0, plant.limits[stop], series), length)
            if found < best:
                best, kind, which = found, CLOSES, stop
    slack_noise = force
    for pad in range(state.pads.size):
        if state.pads[pad] == OFF:
            found = first_crossing(_between(plant.pads[pad], -1.0, plant.pad_places[pad], series), length)
            if found < best:
                best, kind, which = found, TURNS_PUSHING, pad
            continue
        depth = _between(plant.pads[pad], 1.0, -plant.pad_places[pad], series)
        found = first_crossing(depth, length)
        if found < best:
            best, kind, which = found, TURNS_OFF, pad
        if state.pads[pad] == PUSHING:
            pressure = series[plant.masses.size + 1 + pad, : depth.size - 1]
        else:
            pressure = _withheld(plant, pad, depth, span_s)
        own = _tangent(plant.pad_stiffness[pad], max(depth[0], 0.0)) * length + _OWN_NOISE * largest(pressure)
        slack_noise += own
        if not plant.pad_pulls[pad]:
            found = first_crossing(pressure, force + own)
            if found < best:
                best, kind, which = found, TURNS_SLACK if state.pads[pad] == PUSHING else TURNS_PUSHING, pad
    for stop in range(state.closed.size):
        if state.closed[stop]:
            found = first_crossing(forces[stop], slack_noise + _RELEASE_NOISE * largest(forces[stop]))
            if found < best:
                best, kind, which = found, RELEASES, stop
    return best, kind, which


@compiled
def _force_scale(plant: Plant, speed_m_s: float) -> float:
    """Compute the magnitude [N] of the linear forces, the scale of their rounding."""
    stiffness = damping = constant = 0.0
    movers = plant.constant.size
    for mover in range(movers):
        k = b = 0.0
        for other in range(movers):
            k += abs(plant.stiffness[mover, other])
            b += abs(plant.damping[mover, other])
        stiffness, damping = max(stiffness, k), max(damping, b)
        constant = max(constant, abs(plant.constant[mover]))
    return stiffness * plant.length_m + constant + damping * speed_m_s


@compiled
def _between(normal: FloatArray, sign: float, shift: float, series: FloatArray) -> FloatArray:
    """Compute the power series of a normal's distance, times a sign, plus a shift."""
    result = np.zeros(series.shape[1])
    for mover in range(normal.size):
        weight = sign * normal[mover]
        if weight != 0.0:
            for k in range(result.size):
                result[k] += weight * series[mover, k]
    result[0] += shift
    return result


@compiled
def _withheld(plant: Plant, pad: int, depth: FloatArray, span_s: float) -> FloatArray:
    """Compute the power series of the pull that a slack pad would exert; positive while it stays slack."""
    result = np.zeros(depth.size - 1)
    for power in range(plant.pad_stiffness.shape[1] - 1, -1, -1):  # Horner, truncated at the order of the pad's force
        result[0] += plant.pad_stiffness[pad, power]
        for k in range(result.size - 1, -1, -1):
            total = 0.0
            for j in range(k + 1):
                total += depth[j] * result[k - j]
            result[k] = total
    for k in range(result.size):
        result[k] = -result[k] - plant.pad_damping[pad] * (k + 1) * depth[k + 1] / span_s
    return result


@compiled
def _tangent(stiffness: FloatArray, compression: float) -> float:
    """Compute the derivative of a pad's elastic force [N/m] at a compression [m]."""
    total = 0.0
    for power in range(stiffness.size - 1, -1, -1):
        total = total * compression + (power + 1) * stiffness[power]
    return total
