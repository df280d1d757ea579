"""Stiffness, damping and drive of an elastic shaft from encoders and the torque at the drive's end."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.elastic_shaft import TURN, Record, WideMachine, simulate
from tests.twin.test_elastic_session import declared
from textile_twin_core.cli.main import main
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.readings import SecondAngle
from textile_twin_core.comparison.shaft_identification import identify_shaft
from textile_twin_core.files import load_machine_file, save_machine_file
from textile_twin_core.machine import Machine
from textile_twin_core.machine.main_shaft import ShaftDrive, ShaftPiece

WITHIN = {
    "shaft_stiffness_Nm_rad": 0.005,
    "shaft_damping_Nms_rad": 0.05,
    "drive_inertia_kgm2": 0.01,
    "drive_slip_Nms_rad": 0.03,
}


def truth(wide: WideMachine) -> dict[str, float]:
    """Simulated values."""
    n = wide.stations
    values = (
        wide.piece_stiffness_Nm_rad / n,
        wide.piece_damping_Nms_rad / n,
        wide.drive_inertia_kgm2,
        wide.slip_Nms_rad,
    )
    return dict(zip(WITHIN, values, strict=True))


def misdeclared(wide: WideMachine, factor: float, **changes: object) -> Machine:
    """Machine with stiffness, damping and drive wrong by a factor."""
    machine = declared(wide, True, **changes)
    shaft = machine.shaft
    assert shaft is not None
    discs = wide.disc_inertias_kgm2.tolist()
    stations = tuple(dataclasses.replace(s, inertia_kgm2=d) for s, d in zip(shaft.stations, discs, strict=True))
    pieces = tuple(
        ShaftPiece(
            piece.from_station,
            piece.to_station,
            stiffness_Nm_rad=factor * wide.piece_stiffness_Nm_rad,
            damping_Nms_rad=factor * wide.piece_damping_Nms_rad,
        )
        for piece in shaft.pieces
    )
    drive = ShaftDrive(None, factor * wide.drive_inertia_kgm2, factor * wide.slip_Nms_rad)
    return dataclasses.replace(machine, shaft=dataclasses.replace(shaft, stations=stations, pieces=pieces, drive=drive))


def far_angle(made: Record) -> np.ndarray:
    """Angles of a second encoder of 14 bits at the far end, turned by 1 rad."""
    step = TURN / 2**14
    return np.asarray(np.rint((made.angles_rad[:, -1] + 1.0) / step) * step)


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize("second", [True, *more(False)])
def test_shaft_and_drive_are_found_from_ten_percent_below(second: bool) -> None:
    wide = WideMachine(0.06)
    made = simulate(wide, 300.0, 4.0, settle_s=1.0, seed=5)
    far = SecondAngle(made.stamps_ns, np.mod(far_angle(made), TURN)) if second else None
    readings = Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns, made.measured_Nm, second=far)
    found = identify_shaft(readings, misdeclared(wide, 0.9, second_encoder_at="s16"))
    assert found.parameters.keys() == WITHIN.keys()
    for name, value in truth(wide).items():
        estimate = found.parameters[name]
        assert estimate.value == pytest.approx(value, rel=WITHIN[name]), name
        assert abs(estimate.value - value) < 4.0 * estimate.sigma < WITHIN[name] * value, name
    assert found.rms_after_Nm < 1.05 < 10.0 < found.rms_before_Nm


@pytest.mark.slow
def test_a_second_encoder_from_the_log_to_the_estimates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wide = WideMachine(0.06)
    made = simulate(wide, 300.0, 2.0, settle_s=1.0, seed=6)
    columns = (made.time_s, np.rad2deg(made.encoder_rad), np.rad2deg(far_angle(made)), made.measured_Nm)
    log, bag, file = tmp_path / "log.csv", tmp_path / "bag", tmp_path / "machine.yaml"
    np.savetxt(log, np.stack(columns, axis=1), "%.9g", ",", header="time_s,near_deg,far_deg,torque_Nm", comments="")
    assert main(["import", str(log), "--out", str(bag), "--angle", "near_deg", "--second-angle", "far_deg"]) == 0
    assert "main_shaft/second_angle  2001 messages" in capsys.readouterr().out
    save_machine_file(misdeclared(wide, 1.05, second_encoder_at="s16"), file)
    machine = load_machine_file(file)
    assert isinstance(machine, Machine)
    assert machine.shaft is not None
    assert machine.shaft.second_encoder_station == 16
    said = tmp_path / "found.json"
    assert main(["identify", str(bag), "--machine", str(file), "--json", str(said)]) == 0
    found = json.loads(said.read_text())
    assert found["second_encoder"]["rms_after_rad"] < 0.6 * TURN / 2**14 < found["second_encoder"]["rms_before_rad"]
    for name, value in truth(wide).items():
        assert found["parameters"][name]["value"] == pytest.approx(value, rel=2.0 * WITHIN[name]), name
