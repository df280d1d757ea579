"""Scenes of the benchmark: their outputs, and an error that hides nothing."""

from __future__ import annotations

import math

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.bench.scenes import Workload, scenes
from textile_twin_core.mechanism import Crank


def test_an_error_that_is_not_a_number_is_not_none() -> None:
    scene = Workload(ttc.machines.tufting(), "both", ("balancing_torque_Nm", "needle_position_m"), samples=100)
    exact = scene.exact
    assert scene.error({name: values.astype(float) for name, values in exact.items()}) < 1e-15
    for broken in exact:
        found = {name: np.where(name == broken, math.nan, values.astype(float)) for name, values in exact.items()}
        assert math.isnan(scene.error(found))


def test_a_machine_without_measures_has_scenes_of_torque_alone() -> None:
    bare = ttc.Machine("bare", {"O": (0.0, 0.0)}, (Crank("l1", "O", "A", 0.1),))
    assert [scene.name for scene in scenes(bare)] == ["torque", "everything"]
