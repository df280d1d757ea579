"""Stiffness, damping and drive of an elastic shaft from the encoder and the torque at the drive's end."""

from __future__ import annotations

import dataclasses

import pytest

from tests.generators.elastic_shaft import WideMachine, simulate
from tests.twin.test_elastic_session import declared
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.shaft_identification import identify_shaft
from textile_twin_core.machine.main_shaft import ShaftDrive, ShaftPiece


@pytest.mark.slow
def test_shaft_and_drive_are_found_from_ten_percent_below() -> None:
    wide = WideMachine(0.06)
    made = simulate(wide, 300.0, 4.0, settle_s=1.0, seed=5)
    machine = declared(wide, True)
    shaft = machine.shaft
    assert shaft is not None
    wrong = dataclasses.replace(
        shaft,
        stations=tuple(
            dataclasses.replace(station, inertia_kgm2=float(disc))
            for station, disc in zip(shaft.stations, wide.disc_inertias_kgm2, strict=True)
        ),
        pieces=tuple(
            ShaftPiece(
                piece.from_station,
                piece.to_station,
                stiffness_Nm_rad=0.9 * wide.piece_stiffness_Nm_rad,
                damping_Nms_rad=0.9 * wide.piece_damping_Nms_rad,
            )
            for piece in shaft.pieces
        ),
        drive=ShaftDrive(None, 0.9, 72.0),
    )
    readings = Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns, made.measured_Nm)
    found = identify_shaft(readings, dataclasses.replace(machine, shaft=wrong))
    n = wide.stations
    truth = {
        "shaft_stiffness_Nm_rad": (wide.piece_stiffness_Nm_rad / n, 0.01),
        "shaft_damping_Nms_rad": (wide.piece_damping_Nms_rad / n, 0.1),
        "drive_inertia_kgm2": (1.0, 0.02),
        "drive_slip_Nms_rad": (80.0, 0.05),
    }
    assert found.parameters.keys() == truth.keys()
    for name, (value, within) in truth.items():
        assert found.parameters[name].value == pytest.approx(value, rel=within), name
    assert found.rms_after_Nm < 1.2 < 10.0 < found.rms_before_Nm
