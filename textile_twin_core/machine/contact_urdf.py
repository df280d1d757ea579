"""URDF of a contact machine: elements that slide along one line."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from textile_twin_core.contact import ContactRun
from textile_twin_core.dynamics.body import Body
from textile_twin_core.machine.robot import BAR_WIDTH_SHARE, Limits, Robot
from textile_twin_core.mechanism.joint import BASE


def contact_urdf(name: str, run: ContactRun, masses_kg: Mapping[str, float], axis: tuple[float, float]) -> str:
    """Build the URDF text: each element as a bar that slides along `axis`, within the limits of a run."""
    rows = {element: row for element, row in run.model.index.items() if element in masses_kg}
    strokes = {element: run.positions[row] for element, row in rows.items()}
    length = max(float(np.ptp(positions)) for positions in strokes.values())
    robot = Robot(name, length * BAR_WIDTH_SHARE)
    for element, positions in sorted(strokes.items()):
        # A sliding element has no declared inertia: take that of a rod.
        mass = masses_kg[element]
        robot.bar(element, length, [Body(element, mass, mass * length**2 / 12.0)])
        fastest = float(np.abs(run.velocities[rows[element]]).max())
        limits = Limits(float(positions.min()), float(positions.max()), fastest)
        robot.joint(element, "prismatic", BASE, element, (0.0, 0.0), math.atan2(axis[1], axis[0]), limits)
    return robot.text()
