"""What springs, dampers, stops and pads do to the driven element."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.result import Segment


def drive_force(plant: Plant, segment: Segment) -> FloatArray:
    """Power series (order,) of the force [N] on the driven element over a segment."""
    row = plant.constant.size - 1
    force = -(plant.stiffness[row] @ segment.positions[:, :-1]) - plant.damping[row] @ segment.velocities
    force[0] += plant.constant[row]
    force -= plant.pads[:, row] @ segment.pad_forces
    force[:-1] += plant.stops[:, row] @ segment.stop_forces
    return np.asarray(force)
