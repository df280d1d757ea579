"""Compiled twins: floats and arrays, shapes, and error messages."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body, loads
from textile_twin_core.machine import Scene
from textile_twin_core.mechanism import Crank, RRRDyad


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


def test_shapes_are_preserved_and_broadcast(machine: ttc.Machine) -> None:
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


def test_names_may_come_from_numpy(machine: ttc.Machine) -> None:
    names = list(np.array(["balancing_torque_Nm", "needle_position_m"]))
    assert ttc.compile(machine, names).evaluate(0.5, 16.0, 0.0).keys() == set(names)


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


@pytest.mark.parametrize("method", ["exact", "table", "auto"])
def test_no_samples_give_no_values(machine: ttc.Machine, method: str) -> None:
    twin = ttc.compile(machine, ["balancing_torque_Nm"], method)
    assert twin.evaluate(np.empty((0, 3)), 1.0)["balancing_torque_Nm"].shape == (0, 3)


def test_out_must_be_apart_from_the_motion_and_from_each_other(machine: ttc.Machine) -> None:
    names = ["balancing_torque_Nm", "needle_position_m"]
    twin = ttc.compile(machine, names, method="exact")
    theta = np.linspace(0, 6, 100)
    with pytest.raises(ttc.MotionError, match="shares memory with the motion"):
        twin.evaluate(theta[:50], 1.0, out={names[0]: theta[25:75], names[1]: np.empty(50)})
    with pytest.raises(ttc.MotionError):
        twin.evaluate(theta[::2], 1.0, out={names[0]: np.empty(50), names[1]: theta[25:75]})
    with pytest.raises(ttc.MotionError, match="share memory; give each"):
        twin.evaluate(theta, 1.0, out=dict.fromkeys(names, np.empty(100)))
    frozen = np.empty(100)
    frozen.flags.writeable = False
    for unfit in (frozen, [0.0] * 100):
        with pytest.raises(ttc.MotionError, match="writeable, contiguous"):
            twin.evaluate(theta, 1.0, out={names[0]: unfit, names[1]: np.empty(100)})
    block = np.vstack([theta, theta, theta])  # neighbours in one block do not overlap
    found = twin.evaluate(block[0], 1.0, out={names[0]: block[1], names[1]: block[2]})
    assert np.array_equal(found[names[0]], twin.evaluate(theta, 1.0)[names[0]])


@pytest.mark.parametrize("wrong", ["a", 1j, ["a"]])
def test_what_is_no_number_is_refused(machine: ttc.Machine, wrong: object) -> None:
    with pytest.raises(ttc.MotionError, match="omega must be a real number"):
        ttc.compile(machine, ["needle_position_m"]).evaluate(0.0, wrong)


def test_nan_in_the_speed_reaches_friction_singly_and_in_blocks(machine: ttc.Machine) -> None:
    twin = ttc.compile(machine, ["torque_load_Nm"], method="exact")
    assert math.isnan(twin.evaluate(0.5, math.nan, 0.0)["torque_load_Nm"])
    assert np.isnan(twin.evaluate(np.array([0.5]), math.nan, 0.0)["torque_load_Nm"]).all()


def test_the_scene_says_method_and_tolerance(machine: ttc.Machine) -> None:
    scene = Scene(outputs=("needle_position_m",), method="table", tolerance=1e-6)
    twin = ttc.compile(replace(machine, scene=scene))
    assert (twin.outputs, twin.method, twin.tolerance) == (("needle_position_m",), "table", 1e-6)
    assert ttc.compile(replace(machine, scene=scene), method="exact").method == "exact"


def test_a_name_is_no_machine() -> None:
    with pytest.raises(ttc.SceneError, match=r"ttc\.machines\.create\('tufting'\)"):
        ttc.compile("tufting")


def four_bar(crank: float, coupler: float, rocker: float, **declared: object) -> ttc.Machine:
    groups = (Crank("l1", "O", "A", crank), RRRDyad("l2", "l3", "A", "C", "B", (coupler, rocker)))
    bodies = (Body("l2", 1.0, 0.01), Body("l3", 1.0, 0.01))
    return ttc.Machine("four_bar", {"O": (0.0, 0.0), "C": (0.3, 0.0)}, groups, bodies, **declared)


def test_change_points_are_named_and_do_not_end_a_session() -> None:
    parallelogram = four_bar(0.1, 0.3, 0.1)
    twin = ttc.compile(parallelogram, ["balancing_torque_Nm", "theta_1_rad"])
    with pytest.raises(ttc.MotionError, match=r"change point at a shaft angle of 0\.0000 deg"):
        twin.evaluate(0.0, 1.0, 0.0)
    samples = twin.session().step(np.arange(10) * 1e-3, np.zeros(10))
    assert len(samples) == 8
    assert np.isnan(samples.torque_sigma_Nm).all()


def test_auto_keeps_to_closed_forms_where_no_table_is_fine_enough() -> None:
    near = four_bar(0.1, 0.2, 0.2)  # all links in one line once a turn
    with pytest.raises(ttc.SceneError, match="1e-08: the motion is too sharp, as near a change point; use method"):
        ttc.compile(near, ["omega_2_rad_s"], "table", 1e-8)
    theta = np.linspace(0.0, 3.0, 200_001)
    auto, exact = (ttc.compile(near, ["omega_2_rad_s"], m).evaluate(theta, 1.0) for m in ("auto", "exact"))
    assert np.array_equal(auto["omega_2_rad_s"], exact["omega_2_rad_s"])


def test_description_names_every_load() -> None:
    machine = four_bar(0.06, 0.2, 0.23, loads=(loads.JointDamping("l3", 0.5), loads.TorsionSpring("l3", 10.0, 1.0)))
    torque = ttc.compile(machine, ["balancing_torque_Nm"], "exact").describe()
    assert "load joint_damping: evaluated" in torque
    assert "load torsion_spring: evaluated" in torque
    assert "load torsion_spring: dropped" in ttc.compile(machine, ["theta_3_rad"], "exact").describe()


def test_a_machine_with_history_checks_its_arrays() -> None:
    twin = ttc.compile(ttc.machines.needle_transfer(), ["element_1_position_m"])
    assert ttc.machines.needle_transfer().name == "needle_transfer"  # its imports do not replace it
    theta = np.linspace(0.0, 1.0, 20)
    assert twin.evaluate(np.empty(0), 26.0)["element_1_position_m"].shape == (0,)
    with pytest.raises(ttc.MotionError, match="do not fit"):
        twin.evaluate(theta, 26.0, time=np.arange(3.0))
    with pytest.raises(ttc.MotionError):
        twin.evaluate(theta, 26.0, out={})


def test_a_second_compilation_gives_the_same_to_the_last_digit() -> None:
    rng = np.random.default_rng(8)
    motion = rng.normal(size=(3, 70_000)) * np.array([[100.0], [20.0], [1e3]])  # long enough to be compiled at once
    code = (
        "import sys, numpy as np, textile_twin_core as ttc\n"
        "motion = np.frombuffer(sys.stdin.buffer.read()).reshape(3, -1)\n"
        "found = ttc.compile(ttc.machines.tufting(), ['balancing_torque_Nm']).evaluate(*motion)\n"
        "sys.stdout.buffer.write(found['balancing_torque_Nm'].tobytes())"
    )
    here = [ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"]).evaluate(*motion) for _ in range(3)]
    there = subprocess.run([sys.executable, "-c", code], input=motion.tobytes(), capture_output=True, check=True)
    for found in here:
        assert found["balancing_torque_Nm"].tobytes() == there.stdout


def test_cores_share_a_long_block(machine: ttc.Machine) -> None:
    twin = ttc.compile(machine, ["balancing_torque_Nm"], method="exact")
    theta = np.linspace(0.0, 50.0, 70_001)
    alone, shared = (twin.evaluate(theta, 16.0, 0.0, cores=cores)["balancing_torque_Nm"] for cores in (1, 2))
    assert np.array_equal(alone, shared)
    with pytest.raises(ttc.SceneError, match="cores must be 1 or more"):
        twin.evaluate(theta, cores=0)
