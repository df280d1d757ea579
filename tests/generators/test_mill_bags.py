"""The recordings of the other machines: their generator against the engine, and the files in `bags/`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators.mill_bags import DURATION_S, FRICTION, RATE_HZ, SPEED_RAD_S, TORQUE_NOISE_NM, handloom_law, plan
from textile_twin_core.recordings import open_bag

BAGS = Path(__file__).parents[2] / "bags"


def test_the_handloom_of_the_generator_is_that_of_the_engine() -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 400)
    omega, alpha = np.full(400, 15.5), 30.0 * np.sin(theta)
    twin = ttc.compile(ttc.machines.handloom_beatup(), ["balancing_torque_Nm"])
    ours = twin.evaluate(theta, omega, alpha)["balancing_torque_Nm"]
    theirs = handloom_law().torque(theta, omega, alpha, FRICTION) - (0.2 + 0.01 * omega)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-7 * np.abs(theirs).max())


@pytest.mark.parametrize("machine", SPEED_RAD_S)
def test_each_recording_says_what_it_is_and_holds_its_plan(machine: str) -> None:
    bag = open_bag(BAGS / f"{machine}_synthetic")
    assert bag.metadata["origin"].startswith("synthetic") and bag.metadata["machine"] == machine
    angles = bag.read_angles()
    assert 0.97 * RATE_HZ * DURATION_S < len(angles) < RATE_HZ * DURATION_S
    time = ((angles.stamps - 1_767_081_600_000_000_000) * 1e-9).clip(0.0, DURATION_S - 1e-6)
    theta, omega, _ = plan(machine).at(time.astype(np.float64))
    late = np.remainder(angles.angles_rad - theta + np.pi, 2.0 * np.pi) - np.pi
    # A step of the encoder, and what the shaft turns within the error of a stamp.
    assert np.abs(late).max() < 2.0 * np.pi / 2**14 + 100e-6 * np.abs(omega).max()
    assert bag.has_topic("balancing_torque/measured") is (machine == "handloom_beatup")


def test_the_recorded_torque_is_the_machines_with_its_bearings() -> None:
    bag = open_bag(BAGS / "handloom_beatup_synthetic")
    torque = bag.read_torques()
    time = ((torque.stamps - 1_767_081_600_000_000_000) * 1e-9).astype(np.float64)
    theta, omega, alpha = plan("handloom_beatup").at(time)
    twin = ttc.compile(ttc.machines.handloom_beatup(), ["balancing_torque_Nm"])
    predicted = twin.evaluate(theta, omega, alpha)["balancing_torque_Nm"]
    friction = FRICTION.viscous_Nms * omega + FRICTION.coulomb_Nm * np.sign(omega)
    residual = torque.torque_Nm - predicted - friction
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(TORQUE_NOISE_NM, rel=0.05)
