"""Exported FMUs of machines with an elastic main shaft: equal to `drive` and to the chain that follows a motion."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from textile_twin_core.driveline import elastic_shaft, follow_motion
from textile_twin_core.fmu import write_fmu
from textile_twin_core.machine import Machine, MainShaft, ShaftPlace
from textile_twin_core.machine.main_shaft import ShaftDrive, ShaftPiece, Station

fmpy = pytest.importorskip("fmpy")
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

OUTPUTS = ("balancing_torque_Nm", "needle_position_m", "torque_piece_b_c_Nm", "station_c_angle_rad")


@pytest.fixture(scope="module")
def machine() -> Machine:
    """Two needle linkages behind a motor with a gear, backlash before the second, a phase between them."""
    shaft = MainShaft(
        (Station("motor", 0.4, 0.2), Station("b", 0.02), Station("c", 0.03, 0.1)),
        (
            ShaftPiece("motor", "b", stiffness_Nm_rad=9.0e4, damping_Nms_rad=8.0, gear_ratio=2.0),
            ShaftPiece("b", "c", diameter_m=0.05, length_m=0.8, damping_Nms_rad=10.0, backlash_rad=2e-3),
        ),
        torque_sensor=("motor", "b"),
        drive=ShaftDrive("motor", 0.3, 5.0),
    )
    return replace(ttc.machines.tufting(), shaft=shaft, linkages=(ShaftPlace(0.0, "b"), ShaftPlace(0.7, "c")))


def simulated(path: Path, start: dict[str, float], stop: float, step: float, **more: Any) -> Any:
    return fmpy.simulate_fmu(
        str(path), stop_time=stop, step_size=step, output_interval=step, start_values=start, **more
    )  # fmt: skip


@pytest.mark.parametrize("fmi", [2, *more(3)])
def test_a_driven_chain_moves_as_drive_does(fmi: Literal[2, 3], machine: Machine, tmp_path: Path) -> None:
    """Through steps of the loads, backlash, standstill and reversal; co-simulation to 1e-9, model exchange to 1e-6."""
    path = tmp_path / "chain.fmu"
    made = write_fmu(path, machine, input="torque", fmi=fmi, outputs=OUTPUTS)
    assert made.has_binary and not validate_fmu(str(path))
    ratio = 2.0  # of the motor over the first linkage
    for torque, theta, omega in ((40.0, 0.4, 20.0), (-60.0, 1.0, 8.0), (90.0, 0.4, 0.0)):
        time = np.linspace(0.0, 0.25, 51)
        true = ttc.drive(machine, torque, theta, omega, time, tolerance=1e-12)
        start = {"theta_rad": theta, "omega_rad_s": omega, "drive_torque_Nm": torque}
        found = simulated(path, start, 0.25, 0.005)
        speed, twist = np.abs(true.omega_rad_s).max(), np.abs(true.motion.piece_torque_Nm).max()
        assert np.abs(found["theta_rad"] - true.theta_rad).max() < 1e-9
        assert np.abs(found["omega_rad_s"] - true.omega_rad_s).max() < 1e-9 * max(speed, 1.0)
        assert np.abs(found["station_c_angle_rad"] - true.motion.theta_rad[:, 2]).max() < 1e-9
        assert np.abs(found["torque_piece_b_c_Nm"] - true.motion.piece_torque_Nm[:, 1]).max() < 1e-7 * twist
        assert np.abs(found["balancing_torque_Nm"] - true.motion.piece_torque_Nm[:, 0]).max() < 1e-7 * twist
        assert ratio == pytest.approx(true.motion.omega_rad_s[-1, 0] / true.omega_rad_s[-1], rel=1e-12)
    true = ttc.drive(machine, 40.0, 0.4, 20.0, [0.0, 0.1], tolerance=1e-12)
    start = {"theta_rad": 0.4, "omega_rad_s": 20.0, "drive_torque_Nm": 40.0}
    exchanged = simulated(path, start, 0.1, 0.005, fmi_type="ModelExchange", relative_tolerance=1e-10)
    assert exchanged["theta_rad"][-1] == pytest.approx(true.theta_rad[-1], abs=1e-6)
    assert exchanged["omega_rad_s"][-1] == pytest.approx(true.omega_rad_s[-1], abs=1e-5)


def test_numbers_of_the_shaft_are_parameters(machine: Machine, tmp_path: Path) -> None:
    """A softer piece, a heavier motor and more play, as start values and in the machine."""
    made = write_fmu(tmp_path / "p.fmu", machine, input="torque", outputs=OUTPUTS)
    values = {
        "shaft.pieces.motor_b.stiffness_Nm_rad": 5.0e4,
        "shaft.stations.motor.inertia_kgm2": 0.5,
        "shaft.pieces.b_c.backlash_rad": 3e-3,
    }
    assert set(values) <= set(made.parameters)
    shaft = machine.shaft
    assert shaft is not None
    motor, *others = shaft.stations
    first, second = shaft.pieces
    changed = replace(
        shaft,
        stations=(replace(motor, inertia_kgm2=0.5), *others),
        pieces=(replace(first, stiffness_Nm_rad=5.0e4), replace(second, backlash_rad=3e-3)),
    )
    time = np.linspace(0.0, 0.05, 11)
    true = ttc.drive(replace(machine, shaft=changed), 40.0, 0.4, 20.0, time, tolerance=1e-12)
    start = {"theta_rad": 0.4, "omega_rad_s": 20.0, "drive_torque_Nm": 40.0, **values}
    found = simulated(tmp_path / "p.fmu", start, 0.05, 0.005)
    assert np.abs(found["station_c_angle_rad"] - true.motion.theta_rad[:, 2]).max() < 1e-9


@pytest.mark.parametrize("fmi", [3, *more(2)])
def test_a_chain_that_follows_the_encoder_is_the_twin(fmi: Literal[2, 3], tmp_path: Path) -> None:
    """Every output against the twin within its tolerance; the torque to 1e-9 where no load steps."""
    machine = ttc.load_machine("examples/wide_tufting.yaml")
    names = [each for each in machine.outputs if not each.startswith(("joint_", "reaction_", "inertia_", "station_"))]
    names += ["station_s16_angle_rad", "station_s16_speed_rad_s"]
    path = tmp_path / "wide.fmu"
    write_fmu(path, machine, input="angle", fmi=fmi, outputs=names)
    assert not validate_fmu(str(path))
    step, alpha = 2e-4, 30.0
    for begin, samples, exact in ((2.3, 101, True), (0.3, 401, False)):
        time = step * np.arange(samples)
        theta, omega = begin + 20.0 * time + 0.5 * alpha * time**2, 20.0 + alpha * time
        motion = np.array(
            list(zip(time, theta, omega, np.full(samples, alpha), strict=True)),
            dtype=[(name, float) for name in ("time", "theta_rad", "omega_rad_s", "alpha_rad_s2")],
        )
        start = {"theta_rad": begin, "omega_rad_s": 20.0, "alpha_rad_s2": alpha}
        found = simulated(path, start, float(time[-1]), step, input=motion)
        if exact:
            whole = follow_motion(elastic_shaft(machine), time, theta, omega, np.full(samples, alpha), tolerance=1e-11)
            off = np.abs(found["balancing_torque_Nm"] - whole.piece_torque_Nm[:, 0]).max()
            assert off < 1e-9 * np.abs(whole.piece_torque_Nm).max()
        twin = ttc.compile(machine, outputs=names)
        true = twin.evaluate(theta, omega, np.full(samples, alpha), time=time)
        off = {name: np.abs(found[name] - true[name]).max() / max(np.abs(true[name]).max(), 1e-9) for name in names}
        # the twin's tolerance is 1e-3 of the torque of a piece; accelerations have no integral that smooths them
        rough = {name: 2e-2 if "alpha_" in name or "acceleration" in name else 2e-3 for name in names}
        assert {name: by for name, by in off.items() if by > rough[name]} == {}
    exchanged = simulated(path, start, 0.02, 1e-3, input=motion, fmi_type="ModelExchange", relative_tolerance=1e-5)
    peak = float(np.abs(found["balancing_torque_Nm"]).max())
    assert abs(exchanged["balancing_torque_Nm"][-1] - found["balancing_torque_Nm"][100]) < 0.03 * peak
