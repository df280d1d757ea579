"""A file whose elastic shaft is wrong beside a sensor or a force: both are named, with values within their sigmas."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

from tests.benchmarks.elastic_shaft import changed
from tests.campaign import more
from tests.generators.elastic_shaft import Record, WideMachine, simulate
from tests.twin.test_elastic_session import declared
from textile_twin_core.comparison import Readings, assess
from textile_twin_core.comparison.assessment import Assessment
from textile_twin_core.dynamics.loads import Backing
from textile_twin_core.inference.elastic_torque import (
    DAMPING,
    INERTIA,
    OF_SHAFT,
    STIFFNESS,
    LinearisedTorque,
    shaft_values,
    with_shaft_values,
)
from textile_twin_core.inference.parameter import DELAY, ZERO
from textile_twin_core.machine import Machine

WIDE = WideMachine(0.045, 2.0, 4, None, 0.015, 1.0, 60.0)
FORCE = "loads.backing.force_N"


@cache
def made() -> Record:
    """A recording at half the speed, then at the full one, which tells a zero from a lag."""
    time = np.arange(6001) * 1e-3
    return simulate(WIDE, 300.0 * np.interp(time, [0.0, 2.0, 3.5], [0.5, 0.5, 1.0]), 6.0, seed=3)


def judged(machine: Machine, *, zero_rad: float = 0.0, late_s: float = 0.0, gain: float = 1.0) -> Assessment:
    """Judge the recording with other sensors."""
    record = made()
    angle = np.mod(record.encoder_rad + zero_rad, 2.0 * math.pi)
    stamps = record.stamps_ns
    return assess(Readings(stamps, angle, stamps + round(late_s * 1e9), gain * record.measured_Nm), machine)


def off_in_sigmas(found: Assessment, name: str, true: float) -> float:
    """Error of a value over its standard deviation."""
    assert found.found is not None
    posterior = found.found.posterior
    return (posterior.value(name) - true) / posterior.sigma(name)


@pytest.mark.slow
@pytest.mark.parametrize("mistake", ["lag", *more("zero", "force")])
def test_a_wrong_shaft_is_named_beside_another_mistake(mistake: str) -> None:
    machine = changed(declared(WIDE, True), 1.03)
    zero, late, force = math.radians(5.0), 3e-3, 1000.0
    if mistake == "force":
        (backing,) = machine.loads
        assert isinstance(backing, Backing)
        machine = dataclasses.replace(machine, loads=(dataclasses.replace(backing, force_N=1.2 * force),))
    found = judged(machine, zero_rad=zero * (mistake == "zero"), late_s=late * (mistake == "lag"))
    name, cause, true = {
        "zero": (ZERO, "encoder_zero", zero),
        "lag": (DELAY, "delay", late),
        "force": (FORCE, "load_force", force),
    }[mistake]
    assert sorted(each.cause for each in found.verdict) == sorted((cause, "elastic_shaft"))
    shaft = next(each for each in found.verdict if each.cause == "elastic_shaft")
    assert "stiffness" in shaft.text and "damping" not in shaft.text
    assert isinstance(shaft.value, dict)
    assert shaft.value["first_mode_Hz"] == pytest.approx(WIDE.first_mode_rad_s / (2.0 * math.pi), rel=0.005)
    assert abs(off_in_sigmas(found, name, true)) < 3.0
    assert abs(off_in_sigmas(found, STIFFNESS, WIDE.piece_stiffness_Nm_rad / WIDE.stations)) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gain", "damping", "causes"),
    [(1.0, 1.0, []), *more((1.1, 1.0, ["torque_gain"]), (-1.0, 1.0, ["torque_sign"]), (1.0, 1.5, ["elastic_shaft"]))],
)
def test_a_right_shaft_is_not_accused(gain: float, damping: float, causes: list[str]) -> None:
    found = judged(changed(declared(WIDE, True), 1.0, damping), gain=gain)
    assert [each.cause for each in found.verdict] == causes
    assert abs(off_in_sigmas(found, DAMPING, WIDE.piece_damping_Nms_rad / WIDE.stations)) < 4.0


def test_values_of_a_shaft_are_those_of_its_pieces_in_series() -> None:
    machine = declared(WIDE, True)
    values = shaft_values(machine)
    assert values[STIFFNESS] == pytest.approx(WIDE.piece_stiffness_Nm_rad / WIDE.stations)
    assert values[DAMPING] == pytest.approx(WIDE.piece_damping_Nms_rad / WIDE.stations)
    other = {name: 1.3 * value for name, value in values.items()}
    assert shaft_values(with_shaft_values(machine, other)) == pytest.approx(other)


def test_a_predicted_torque_is_cubic_between_readings_and_linear_in_its_parameters() -> None:
    """A vibration of 110 Hz that is sampled at 1 kHz: a straight line between readings would be off by 6 %."""
    time, w = np.arange(200) * 1e-3, 2.0 * math.pi * 110.0
    slopes, rates = np.cos(w * time)[:, None], -w * np.sin(w * time)[:, None]
    usable = np.ones(199, np.bool_)
    usable[50] = False
    about = {INERTIA: 2.0}
    torque = LinearisedTorque(time, np.sin(w * time), w * np.cos(w * time), usable, (), about, slopes, rates, {}, 0.0)
    between = np.linspace(0.0, 0.199, 1234)
    found, slope, good, columns = torque.at(between, {name: 2.5 for name in OF_SHAFT}, True)
    assert good.sum() == np.count_nonzero((between < 0.05) | (between >= 0.051))
    np.testing.assert_allclose(found, np.sin(w * between) + 0.5 * np.cos(w * between), atol=8e-4)
    np.testing.assert_allclose(slope, w * (np.cos(w * between) - 0.5 * np.sin(w * between)), atol=8e-3 * w)
    np.testing.assert_allclose(columns[INERTIA], np.cos(w * between), atol=8e-4)
