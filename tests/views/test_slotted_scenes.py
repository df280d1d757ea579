"""Pictures of machines with sliders on moving links and round gears: fixed and moving parts."""

from __future__ import annotations

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.machine import Machine
from textile_twin_core.views.scene import MachineScene, build_scene


def scene(name: str) -> MachineScene:
    machine = ttc.load_machine(f"examples/{name}.yaml")
    assert isinstance(machine, Machine)
    return build_scene(machine)


def test_a_slot_on_a_lever_is_no_guide_on_the_ground() -> None:
    """Check that the fixed solids stand at the bearings and along the ram's guide, and nowhere along the crank's
    pin.
    """
    drawn = scene("whitworth_shaper")
    assert drawn.fixed_points.keys() == {"O", "C"}
    corners = drawn.fixed.vertices[:, :2]
    width = 0.04 * drawn.size_m
    bearings = np.array([(0.0, 0.0), (0.0, -0.25)])
    near = np.abs(corners[:, None, :] - bearings).max(axis=2).min(axis=1) < 2.0 * width
    assert (near | (np.abs(corners[:, 1] - 0.235) < 2.0 * width)).all()


def test_gears_are_drawn_by_their_pitch_circles() -> None:
    drawn = scene("geared_five_bar")
    assert drawn.fixed_points.keys() == {"O", "G"}  # not where the gears touch
    radii = {part.name: [float(np.hypot(*o.T).max()) for o in part.outlines] for part in drawn.moving}
    assert radii == {"l1": [pytest.approx(0.08)], "l4": [pytest.approx(0.04)], "l2": [], "l3": []}
    assert not any(part.is_cam for part in drawn.moving)
