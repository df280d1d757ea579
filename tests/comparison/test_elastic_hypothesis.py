"""A recording of a machine whose shaft twists, judged with a file whose shaft is rigid."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import pytest
import scipy

import textile_twin_core as ttc
from tests.generators.elastic_shaft import Record, WideMachine, simulate
from textile_twin_core.comparison import Readings, assess, calibrate
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Sensors, ShaftPlace, TorqueSensor


@cache
def _made() -> tuple[WideMachine, Record]:
    wide = WideMachine(0.06)
    return wide, simulate(wide, 500.0, 2.5, settle_s=1.0)


def test_a_shaft_that_twists_is_named_behind_a_filter() -> None:
    """The torque behind a first-order low pass of 30 Hz, which the file declares."""
    wide, made = _made()
    b, a = scipy.signal.butter(1, 2.0 * math.pi * 30.0, analog=True)
    time = (made.stamps_ns - made.stamps_ns[0]) * 1e-9
    _, measured, _ = scipy.signal.lsim((b, a), made.measured_Nm - made.measured_Nm.mean(), time)
    sensors = Sensors(torque=TorqueSensor(low_pass_hz=30.0))
    machine = dataclasses.replace(ttc.machines.tufting(), linkages=(ShaftPlace(),) * wide.stations, sensors=sensors)
    readings = Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns, measured + made.measured_Nm.mean())
    value = assess(readings, machine).verdict[0].value
    assert isinstance(value, dict)
    assert value["first_mode_Hz"] == pytest.approx(wide.first_mode_rad_s / (2.0 * math.pi), rel=0.03)


@pytest.mark.slow
def test_a_shaft_that_twists_is_named_and_no_sensor() -> None:
    wide, made = _made()
    machine = dataclasses.replace(ttc.machines.tufting(), linkages=(ShaftPlace(),) * wide.stations)
    readings = Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns, made.measured_Nm)
    found = assess(readings, machine)
    assert [cause.cause for cause in found.verdict] == ["elastic_shaft"]
    value = found.verdict[0].value
    assert isinstance(value, dict)
    assert value["first_mode_Hz"] == pytest.approx(wide.first_mode_rad_s / (2.0 * math.pi), rel=0.03)
    assert value["stiffness_Nm_rad"] == pytest.approx(wide.piece_stiffness_Nm_rad / wide.stations, rel=0.4)
    with pytest.raises(RecordingError, match="declare `shaft`"):
        calibrate(readings, machine)
