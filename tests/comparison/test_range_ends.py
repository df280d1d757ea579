"""Torques clipped by a sensor or drive: reported and left out; torques that only look clipped stay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import healthy, record
from textile_twin_core.comparison import Readings, assess, calibrate
from textile_twin_core.comparison.range_ends import at_range_ends


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "largest_Nm"), [("loom", 3.0), *more(("tufting", 15.0), ("tufting", 10.0))])
def test_a_clipped_torque_gives_no_false_cause(machine: str, largest_Nm: float) -> None:
    case = healthy(machine, 977, duration_s=24.0)
    made = record(replace(case, torque=replace(case.torque, gain=1.08, delay_s=0.002)))
    torque = np.clip(made.torque, -largest_Nm, largest_Nm)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, torque)
    found = assess(readings, configured_machine(case))
    assert {cause.cause for cause in found.verdict} == {"torque_gain", "delay"}
    assert any(f"{largest_Nm:g} N m, as at the end of the range" in note for note in found.notes)
    settled = calibrate(readings, configured_machine(case))
    exact = settled.given_file["torque.gain"]
    assert abs(exact.value - 1.08) < 4.0 * exact.sigma < 0.01
    assert (
        abs(settled.gain.value - 1.08) < 3.0 * settled.gain.sigma < 0.06
    )  # the file's masses determine the scale no better
    assert abs(settled.delay_s.value - 0.002) < 4.0 * settled.delay_s.sigma < 1e-3


@pytest.mark.parametrize("offset_Nm", [0.0, -30.0])
def test_the_ends_of_a_clipped_wave_are_found(offset_Nm: float) -> None:
    noise = 0.05 * np.random.default_rng(1).normal(size=20_000)
    wave = offset_Nm + 10.0 * np.sin(np.linspace(0.0, 400.0, noise.size)) + noise
    cut = np.minimum(wave, offset_Nm + 9.0)
    np.testing.assert_array_equal(at_range_ends(cut), wave >= offset_Nm + 9.0)
    np.testing.assert_array_equal(at_range_ends(np.round(cut, 2)), np.round(cut, 2) == offset_Nm + 9.0)


@pytest.mark.parametrize("step_Nm", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("noise_Nm", [0.0, 0.05])
def test_steps_and_repeating_turns_are_no_ends(step_Nm: float, noise_Nm: float) -> None:
    """The extreme step of a wave lasts longest; without noise every value occurs in each turn."""
    angle = np.arange(20_000) * (2.0 * math.pi / 200)
    torque = 10.0 * np.sin(angle) + noise_Nm * np.random.default_rng(2).normal(size=angle.size)
    assert not at_range_ends(np.round(torque / step_Nm) * step_Nm).any()
    assert not at_range_ends(np.empty(0)).any() and not at_range_ends(np.ones(5)).any()
