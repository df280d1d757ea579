"""The loops run without numba as plain Python, and give the same states."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from textile_twin_core.shaft import ESTIMATORS, ShaftStates, create_estimator

COUNT = 120
UNCOMPILED = """
import sys
sys.modules["numba"] = None
import numpy as np
from tests.shaft.test_uncompiled import table
sys.stdout.buffer.write(table(sys.argv[1]).tobytes())
"""


def table(name: str) -> np.ndarray:
    """States of a shaft of 12 bits whose speed ripples."""
    stamps = np.arange(COUNT) * 2_000_000
    theta = 100.0 * stamps * 1e-9
    estimator = create_estimator(name)
    angles = np.round((theta + 0.02 * np.sin(theta)) / (2 * np.pi) * 4096) / 4096 * 2 * np.pi
    parts = [estimator.step(stamps, angles), estimator.finish()]
    states = ShaftStates.join([part for part in parts if len(part)])
    motion = np.column_stack([states.theta_rad, states.omega_rad_s, states.alpha_rad_s2, states.settled])
    return np.concatenate([motion, states.covariance.reshape(-1, 9)], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ESTIMATORS)
def test_uncompiled_loops_give_the_same(name: str) -> None:
    found = subprocess.run([sys.executable, "-c", UNCOMPILED, name], capture_output=True, check=True)
    assert found.stderr.count(b"\n") == 1
    uncompiled = np.frombuffer(found.stdout).reshape(-1, 13)
    compiled = table(name)
    assert uncompiled.shape == compiled.shape
    np.testing.assert_allclose(uncompiled, compiled, rtol=1e-7, atol=1e-9)
