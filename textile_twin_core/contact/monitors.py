"""The functions whose sign changes are events: gaps, stop forces, compressions and forces of pads, over one step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.model import ContactModel
from textile_twin_core.contact.polynomials import earliest_crossing
from textile_twin_core.contact.result import PadState, Segment


@dataclass(frozen=True)
class Noise:
    """What cannot be told from zero."""

    length_m: float
    force_N: float


@dataclass(frozen=True)
class Crossing:
    """The first event of a step: place u, kind ("close", "release", or the pad's next state), stop or pad."""

    u: float
    kind: str | PadState
    number: int


def pad_series(model: ContactModel, number: int, normal: FloatArray, positions: FloatArray) -> FloatArray:
    """Power series of a pad's compression, from the movers' positions (movers, order+1)."""
    depth = normal @ positions
    depth[0] -= model.pads[number].position_m
    return np.asarray(depth)


def elastic_series(stiffness: tuple[float, ...], depth: FloatArray) -> FloatArray:
    """Power series of a pad's elastic force, cut at the order of the compression's."""
    total = np.zeros_like(depth)
    for coefficient in reversed(stiffness):
        total[0] += coefficient
        total = np.convolve(total, depth)[: depth.size]
    return total


def first_event(
    model: ContactModel,
    segment: Segment,
    stop_normals: FloatArray,
    limits: FloatArray,
    pad_normals: FloatArray,
    noise: Noise,
) -> Crossing | None:
    """The earliest event inside a step, or None; nothing is sampled, so that no pair of crossings can slip through."""
    rows: list[FloatArray] = []
    noises: list[float] = []
    meaning: list[tuple[str | PadState, int]] = []
    gaps = stop_normals.T @ segment.positions
    gaps[:, 0] += limits
    for number in range(len(model.stops)):
        if number not in segment.closed:
            rows.append(gaps[number])
            noises.append(noise.length_m)
            meaning.append(("close", number))
    force_noise = noise.force_N
    for number, state in enumerate(segment.pads):
        pad = model.pads[number]
        depth = pad_series(model, number, pad_normals[number], segment.positions)
        if state is PadState.OFF:
            rows.append(-depth)
            noises.append(noise.length_m)
            meaning.append((PadState.PUSHING, number))
            continue
        rows.append(depth)
        noises.append(noise.length_m)
        meaning.append((PadState.OFF, number))
        if state is PadState.PUSHING:
            pressure = segment.pad_forces[number]
        else:
            rate = depth[1:] * np.arange(1.0, depth.size) / segment.span_s
            pressure = -(elastic_series(pad.stiffness, depth)[:-1] + pad.damping_Ns_m * rate)
        own = pad.tangent(max(float(depth[0]), 0.0)) * noise.length_m + 1e-14 * float(np.abs(pressure).max())
        force_noise += own
        if pad.pulls:
            continue
        rows.append(pressure)
        noises.append(noise.force_N + own)
        meaning.append((PadState.SLACK if state is PadState.PUSHING else PadState.PUSHING, number))
    for series, number in zip(segment.stop_forces, segment.closed, strict=True):
        rows.append(series)
        noises.append(force_noise + 1e-12 * float(np.abs(series).max()))
        meaning.append(("release", number))
    if not rows:
        return None
    width = max(row.size for row in rows)
    table = np.zeros((len(rows), width))
    for line, row in zip(table, rows, strict=True):
        line[: row.size] = row
    found = earliest_crossing(table, np.array(noises))
    if found is None:
        return None
    kind, number = meaning[found[0]]
    return Crossing(found[1], kind, number)
