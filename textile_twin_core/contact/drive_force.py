"""What springs, dampers, stops and pads do to the driven element."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.forces import LinearForces
from textile_twin_core.contact.mode import derivative
from textile_twin_core.contact.model import ContactModel
from textile_twin_core.contact.result import Segment


def part_normals(model: ContactModel, ends: list[tuple[str, str]]) -> FloatArray:
    """Rows (parts, movers) with +1 at the first and -1 at the second end of each part; the frame has no column."""
    movers = len(model.bodies) + 1
    rows = np.zeros((len(ends), movers + 1))
    for row, (plus, minus) in zip(rows, ends, strict=True):
        row[model.index[plus]] += 1.0
        row[model.index[minus]] -= 1.0
    return rows[:, :movers]


def pad_normals(model: ContactModel) -> FloatArray:
    """Rows (pads, movers): times the positions, less its position, each gives a pad's compression."""
    return part_normals(model, [(pad.upper, pad.lower) for pad in model.pads])


def stop_normals(model: ContactModel) -> FloatArray:
    """Rows (stops, movers): times the positions, plus the limit, each gives a stop's gap."""
    return part_normals(model, [(stop.lower, stop.upper) for stop in model.stops])


class DriveForce:
    """Force on the driven element of one model."""

    def __init__(self, model: ContactModel) -> None:
        self._forces = LinearForces.of(model)
        self._row = len(model.bodies)
        self._pads = pad_normals(model)[:, self._row]
        self._stops = stop_normals(model)[:, self._row]

    def series(self, segment: Segment) -> FloatArray:
        """Power series (order,) of the force [N] on the driven element over a segment."""
        speeds = derivative(segment.positions) / segment.span_s
        force = self._forces.on_movers(segment.positions[:, :-1], speeds)[self._row]
        if self._pads.any():
            force = force - self._pads @ segment.pad_forces
        for number, push in zip(segment.closed, segment.stop_forces, strict=True):
            force[: push.size] += self._stops[number] * push
        return np.asarray(force)
