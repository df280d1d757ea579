"""docs/extending.md: its group and its load are correct, and not only run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.docs.pages import blocks
from tests.generators.planned_motion import run_up_and_down
from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison import Readings, assess

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


def torque_of_sley(drag_Ns2_m2: float, theta: FloatArray, omega: FloatArray, alpha: FloatArray) -> FloatArray:
    """Torque of the page's sley in air: B from two circles, derivatives over the turn by Fourier's transform."""
    turn = 2.0 * np.pi * np.arange(4096) / 4096
    ax, ay = 0.06 * np.cos(turn), 0.06 * np.sin(turn)
    dx, dy = 0.3 - ax, -ay
    apart = np.hypot(dx, dy)
    along = (0.2**2 - 0.23**2 + apart**2) / (2.0 * apart)
    across = np.sqrt(0.2**2 - along**2)
    bx, by = ax + (along * dx - across * dy) / apart, ay + (along * dy + across * dx) / apart

    def slope(values: FloatArray) -> FloatArray:
        return np.asarray(np.fft.irfft(1j * np.arange(2049) * np.fft.rfft(values)))

    inertia = (0.01 + 2.0 * 0.115**2) * slope(np.unwrap(np.arctan2(by, bx - 0.3))) ** 2
    weight, speed = 2.0 * 9.81 * 0.5 * slope(by), np.hypot(slope(bx), slope(by))
    rows = inertia, slope(inertia), weight, speed
    j, rate, weight, speed = (np.interp(theta, turn, row, period=2.0 * np.pi) for row in rows)
    return np.asarray(j * alpha + 0.5 * rate * omega**2 + weight + drag_Ns2_m2 * speed**3 * omega * np.abs(omega))


@pytest.mark.parametrize("seed", [5, pytest.param(6, marks=pytest.mark.campaign)])
def test_the_load_takes_part_in_the_verdict(seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    machine = made(1)["machine"]
    rng = np.random.default_rng(seed)
    time = np.arange(0.05, 15.9, 1.0 / 500.0)
    motion = run_up_and_down(16.0, 30.0, rng).at(time)
    step, stamps = 2.0 * np.pi / 2**14, np.rint(time * 1e9).astype(np.int64)
    angle = np.mod(np.rint(motion[0] / step) * step, 2.0 * np.pi)
    torque = torque_of_sley(11.3, *motion) + 0.02 * rng.standard_normal(time.size)
    (load,) = machine.loads
    machine = replace(machine, loads=(replace(load, drag_Ns2_m2=8.0),))
    (cause,) = assess(Readings(stamps, angle, stamps, torque), machine).verdict
    assert (cause.cause, cause.parameter) == ("load_force", "loads.air_drag.drag_Ns2_m2")
    assert cause.value == pytest.approx(11.3 / 8.0, abs=3.0 * cause.sigma)
    assert cause.sigma < 0.02 and "N s2/m2 instead of 8" in cause.text
