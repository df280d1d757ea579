"""Peak force, depth of the pierce and work of each stitch, against the integrals of the true law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.generators.configured_machine import configured_machine
from tests.generators.force_laws import LAWS, PLANE_M, case_of, force, reach, record_law
from tests.generators.shaft_law import Friction
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.fault_watch import WatchSettings
from textile_twin_core.comparison.monitor import Monitor, Trend, monitor_recording
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.machine import Machine


@pytest.fixture(scope="module")
def watched() -> Trend:
    law = LAWS["pierce"]
    case = replace(case_of(law, 1, duration_s=18.0), friction=Friction(0.01, 0.25))
    made, machine = record_law(law, case), configured_machine(case)
    machine = replace(machine, loads=(*machine.loads, ShaftFriction(0.01, 0.25)))
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return monitor_recording(readings, machine, WatchSettings(learn_turns=20))


def _true_work(growing: bool) -> float:
    place = np.linspace(PLANE_M, reach("tufting"), 4001)
    values = force(LAWS["pierce"], place, growing)
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(place)))


@pytest.mark.slow
def test_work_peak_and_depth_are_those_of_the_law(watched: Trend) -> None:
    steady = np.abs(watched.columns["speed_rad_s"]) > 10.0
    median = {name: float(np.median(values[steady])) for name, values in watched.columns.items()}
    assert median["work_in_J"] == pytest.approx(_true_work(True), rel=0.02)
    assert median["work_out_J"] == pytest.approx(_true_work(False), rel=0.02)
    assert median["force_peak_N"] == pytest.approx(1235.0, rel=0.05)  # the mean of a twelfth of the depth
    assert median["pierce_depth_m"] == pytest.approx(0.2 * (reach("tufting") - PLANE_M), abs=0.001)
    single = watched.columns["work_in_J"][steady]
    assert np.std(single) < 0.02 * median["work_in_J"]  # every stitch, not their mean alone


def test_a_machine_without_a_load_over_a_measure_has_no_such_columns() -> None:
    machine = configured_machine(case_of(LAWS["beat-up"], 1))
    assert isinstance(machine, Machine)
    assert Monitor(machine).finish().columns == {}
