"""An elastic shaft that is not that of its machine file: named with its stiffness, damping and drive, or not at all."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from tests.benchmarks.elastic_shaft import changed
from tests.campaign import more
from tests.generators.elastic_shaft import WideMachine
from tests.twin.test_elastic_session import declared, record
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison import shaft_departure as shaft_departure_module
from textile_twin_core.comparison.shaft_departure import shaft_cause, shaft_departure
from textile_twin_core.comparison.shaft_identification import DAMPING, STIFFNESS, shaft_values
from textile_twin_core.comparison.uncertainty import Estimate

WIDE = WideMachine(0.06)


def readings(gain: float = 1.0, late: int = 0) -> Readings:
    """Return a recording of 1.2 s at 300 rpm, with a torque sensor of another gain that lags by samples."""
    made = record(WIDE, 300.0, 1.2)
    torque = gain * made.measured_Nm[: made.measured_Nm.size - late]
    return Readings(made.stamps_ns, made.encoder_rad, made.stamps_ns[late:], torque)


@pytest.mark.slow
@pytest.mark.parametrize(("stiffness", "damping"), [(0.95, 1.0), *more((1.0, 1.5), (1.03, 1.0))])
def test_stiffness_and_damping_of_the_file_are_corrected(stiffness: float, damping: float) -> None:
    machine = declared(WIDE, True)
    wrong = changed(machine, stiffness, damping)
    found = shaft_departure(readings(), wrong)
    assert found is not None
    true = WIDE.piece_stiffness_Nm_rad / WIDE.stations
    assert found.parameters[STIFFNESS].value == pytest.approx(true, rel=0.005)
    assert found.parameters[DAMPING].value == pytest.approx(WIDE.piece_damping_Nms_rad / WIDE.stations, rel=0.05)
    cause = shaft_cause(found, wrong)
    assert cause.cause == "elastic_shaft" and isinstance(cause.value, dict)
    assert cause.value["first_mode_Hz"] == pytest.approx(112.17, rel=0.003)
    assert ("stiffness" in cause.text) == (stiffness != 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "late"), [(1.0, 0), (1.1, 0), (-1.0, 0), (1.0, 2)])
def test_sensors_are_not_taken_for_another_shaft(gain: float, late: int) -> None:
    assert shaft_departure(readings(gain, late), declared(WIDE, True)) is None


def test_a_better_shaft_with_the_numbers_of_the_file_is_no_departure(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the residual of the file is that of a start from standstill, which the fit of another drive takes up."""
    machine = declared(WIDE, True)
    known = {name: Estimate(value, 0.2 * value) for name, value in shaft_values(machine).items()}
    same = SimpleNamespace(parameters=known, machine=machine)
    stiff = Estimate(2.0 * known[STIFFNESS].value, 0.1 * known[STIFFNESS].value)
    other = SimpleNamespace(parameters=known | {STIFFNESS: stiff}, machine=machine)
    monkeypatch.setattr(shaft_departure_module, "scan_shaft", lambda *_: SimpleNamespace(share=0.1))
    for fitted, named in ((same, False), (other, True)):
        monkeypatch.setattr(shaft_departure_module, "fit_shaft", lambda *_, fitted=fitted: fitted)
        assert (shaft_departure(readings(), machine) is not None) == named
