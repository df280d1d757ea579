"""Compiled twins: floats and arrays, shapes, and errors for people."""

from __future__ import annotations

import math

import numpy as np
import pytest

import textile_twin_core as ttc


@pytest.fixture(scope="module")
def machine() -> ttc.Machine:
    return ttc.machines.tufting()


def test_floats_and_arrays_agree(machine: ttc.Machine) -> None:
    twin = ttc.compile(machine, machine.outputs, method="exact")
    theta = np.linspace(-7.0, 7.0, 9001)  # more than one chunk, the last one short
    block = twin.evaluate(theta, 12.0, 3.0)
    for i in (0, 4095, 4096, 9000):
        single = twin.evaluate(float(theta[i]), 12.0, 3.0)
        for name, value in single.items():
            assert block[name][i] == pytest.approx(value, rel=1e-13, abs=1e-12), name


def test_shapes_are_kept_and_broadcast(machine: ttc.Machine) -> None:
    twin = ttc.compile(machine, ["balancing_torque_Nm"], method="exact")
    theta, omega = np.linspace(0, 6, 7)[:, None], np.array([0.0, 5.0, 16.0])
    r = twin.evaluate(theta, omega, 0.0)["balancing_torque_Nm"]
    assert r.shape == (7, 3)
    assert r[3, 1] == pytest.approx(twin.evaluate(float(theta[3, 0]), 5.0, 0.0)["balancing_torque_Nm"], rel=1e-14)


def test_out_is_written_in_place(machine: ttc.Machine) -> None:
    twin = ttc.compile(machine, ["needle_position_m"], method="exact")
    theta, out = np.linspace(0, 6, 10000), {"needle_position_m": np.empty(10000)}
    assert twin.evaluate(theta, 0.0, 0.0, out=out)["needle_position_m"] is out["needle_position_m"]
    with pytest.raises(ttc.MotionError, match="contiguous float64 array of shape"):
        twin.evaluate(theta, 0.0, 0.0, out={"needle_position_m": np.empty(3)})


def test_nan_stays_where_it_came_in(machine: ttc.Machine) -> None:
    twin = ttc.compile(machine, ["balancing_torque_Nm"], method="exact")
    r = twin.evaluate(np.array([0.1, math.nan, 0.3]), 16.0, 0.0)["balancing_torque_Nm"]
    assert np.isnan(r).tolist() == [False, True, False]
    assert math.isnan(twin.evaluate(math.nan, 16.0, 0.0)["balancing_torque_Nm"])
    with pytest.raises(ttc.MotionError, match="finite angle"):
        twin.evaluate(math.inf, 16.0, 0.0)


def test_errors_name_what_is_wrong(machine: ttc.Machine) -> None:
    with pytest.raises(ttc.SceneError, match="did you mean balancing_torque_Nm"):
        ttc.compile(machine, ["balancing_torque"])
    with pytest.raises(ttc.SceneError, match="no method 'fast'"):
        ttc.compile(machine, ["balancing_torque_Nm"], method="fast")
    with pytest.raises(ttc.MotionError, match=r"theta \(3,\), omega \(2,\)"):
        ttc.compile(machine, ["balancing_torque_Nm"]).evaluate(np.zeros(3), np.zeros(2), 0.0)
    with pytest.raises(ttc.MachineError, match="no machine 'tuftin'; did you mean tufting"):
        ttc.machines.create("tuftin")
    with pytest.raises(ttc.MachineError, match=r"shaft angle of \d+\.\d+ deg,? where .*stretched"):
        ttc.machines.tufting(l2_m=0.05)
    with pytest.raises(ttc.MachineError, match=r"l1.*positive length"):
        ttc.machines.tufting(l1_m=-0.015)
    with pytest.raises(ttc.MachineError, match="mass_kg"):
        ttc.machines.tufting(m2_kg=-1.0)
