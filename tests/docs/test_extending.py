"""docs/extending.md: its group and its load are correct, and not only run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.docs.pages import blocks

PYTHON = [block.text for block in blocks(Path("docs/extending.md")) if block.language == "python"]


def made(number: int) -> dict[str, Any]:
    names: dict[str, Any] = {"__name__": "extending"}
    exec(compile(PYTHON[number], "extending.md", "exec", dont_inherit=True), names)
    return names


def test_the_group(capsys: pytest.CaptureFixture[str]) -> None:
    names = made(0)
    found, theta = names["found"], names["theta"]
    np.testing.assert_allclose(found["reaction_A_x_N"], -1.5 * 0.05 * 400.0 * np.cos(theta), atol=1e-12)
    torque = 1.5 * 0.05**2 * 400.0 * np.sin(theta) * np.cos(theta) + 0.4 * 9.81 * 0.025 * np.cos(theta)
    for route in ("balancing_torque_Nm", "balancing_torque_newton_euler_Nm"):
        np.testing.assert_allclose(found[route], torque, atol=1e-14)
    assert '<child link="bar"' in names["machine"].urdf()


def test_the_load(capsys: pytest.CaptureFixture[str]) -> None:
    names = made(1)
    found, machine = names["found"], names["machine"]
    torques = found["balancing_torque_Nm"], found["balancing_torque_newton_euler_Nm"]
    np.testing.assert_allclose(*torques, atol=1e-13)
    slope = 1e-6
    twin = names["ttc"].compile(machine, outputs=["point_B_x_m", "point_B_y_m"])
    before, after = (twin.evaluate(names["theta"] + side * slope) for side in (-1.0, 1.0))
    speed = np.hypot(*((after[n] - before[n]) / (2.0 * slope) * 30.0 for n in before))
    np.testing.assert_allclose(found["torque_load_Nm"], 0.8 * speed**3 / 30.0, rtol=1e-6, atol=1e-7)
