"""A force that grows and a gain that falls while a recording runs are named as such, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import healthy, record, torque_of
from textile_twin_core.comparison import Cause, Readings, assess


def verdict(force: float, gain: float) -> tuple[Cause, ...]:
    """Assess a tufting machine whose needle force and torque gain grow by a share between 4 and 12 s of 14 s."""
    case = healthy("tufting", 981, run_up=False, duration_s=14.0)
    rates = {"encoder": replace(case.encoder, rate_hz=250.0), "torque": replace(case.torque, rate_hz=250.0)}
    case = replace(case, **rates)
    made = record(case)
    time = (made.torque_stamps_ns - made.torque_stamps_ns[0]) * 1e-9 + 0.0507
    moved = made.plan.at(np.clip(time, 0.0, case.duration_s))
    without = replace(case, backing=replace(case.backing, force_N=0.0))
    needles = torque_of(case, *moved) - torque_of(without, *moved)
    grown = np.clip((time - 4.0) / 8.0, 0.0, 1.0)
    torque = (made.torque + force * grown * needles) * (1.0 + gain * grown)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, torque)
    return assess(readings, configured_machine(case)).verdict


@pytest.mark.slow
def test_a_force_that_grows_by_90_percent_is_named_with_its_last_value() -> None:
    (cause,) = verdict(force=0.9, gain=0.0)
    assert cause.cause == "load_force" and cause.parameter == "loads.backing.force_N"
    assert cause.value == pytest.approx(1.9, abs=0.06)
    assert "changes within the recording, from 10" in cause.text


@pytest.mark.slow
def test_a_gain_that_falls_is_named_with_its_last_value() -> None:
    (cause,) = verdict(force=0.0, gain=-0.4)
    assert cause.cause == "torque_gain" and cause.parameter == "sensors.torque.gain"
    assert cause.value == pytest.approx(0.6, abs=0.03)
