"""Rotor without a linkage: gain, inertia and friction give the same torque, and all angles look alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from textile_twin_core.comparison import Readings, assess, calibrate, identify
from textile_twin_core.machine import Machine

INERTIA_KGM2, VISCOUS_NMS, COULOMB_NM = 9.6e-4, 2e-3, 0.065


def machine(folder: Path, inertia: float = 1.0, friction: float = 1.0) -> Machine:
    """Rotor with shares of its inertia and of its friction."""
    path = folder / "rotor.yaml"
    path.write_text(
        "points: {O: [0, 0]}\n"
        "groups: [{type: crank, name: rotor, at: O, end: A, length_m: 0.01}]\n"
        f"bodies: {{rotor: {{mass_kg: 0, inertia_kgm2: {inertia * INERTIA_KGM2:.9e}}}}}\n"
        f"loads: [{{type: shaft_friction, viscous_Nms: {friction * VISCOUS_NMS:.9e}"
        f", coulomb_Nm: {friction * COULOMB_NM:.9e}}}]\n"
        "gravity_m_s2: [0, 0]\n"
    )
    return ttc.load_machine(path)


def readings(seed: int, gain: float = 1.0) -> Readings:
    """Twelve strokes of six turns to and fro with standstills between them, 16 bits and torque at 1 kHz."""
    top, rise, hold, rest = 60.0, 0.15, 0.48, 0.3
    fine = np.arange(0.0, 0.5 + 12.0 * (2.0 * rise + hold + rest), 1e-5)
    stroke, within = np.divmod(np.maximum(fine - 0.5, 0.0), 2.0 * rise + hold + rest)
    up, down = (np.clip((within - start) / rise, 0.0, 1.0) for start in (0.0, rise + hold))
    pull = np.sin(np.pi * up) ** 2 - np.sin(np.pi * down) ** 2
    alpha = 2.0 * top / rise * pull * (1.0 - 2.0 * np.mod(stroke, 2.0))
    omega = np.concatenate([[0.0], np.cumsum(alpha[:-1]) * 1e-5])
    omega[np.abs(omega) < 1e-6 * top] = 0.0
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) * 1e-5])
    torque = INERTIA_KGM2 * alpha + VISCOUS_NMS * omega + COULOMB_NM * np.sign(omega)
    rng = np.random.default_rng([seed, 51])
    samples = slice(0, None, 100)
    stamps = np.rint(fine[samples] * 1e9).astype(np.int64)
    step = 2.0 * np.pi / 2**16
    shown = gain * torque[samples] + 0.003 * rng.standard_normal(stamps.size)
    return Readings(stamps, np.rint(theta[samples] / step) * step, stamps, shown)


def test_a_right_file_has_no_fault(tmp_path: Path) -> None:
    found = assess(readings(1), machine(tmp_path))
    assert not found.verdict and found.explained > 0.99


@pytest.mark.parametrize("share", [0.2, *more(0.5, 0.05)])
def test_an_inertia_that_the_file_lacks_is_no_gain_with_less_friction(tmp_path: Path, share: float) -> None:
    """Both explain the torque to the last digit; one mistake is likelier than three."""
    (cause,) = assess(readings(2), machine(tmp_path, inertia=share)).verdict
    assert cause.cause == "unmodelled_inertia" and isinstance(cause.value, float)
    assert cause.value == pytest.approx((1.0 - share) * INERTIA_KGM2, abs=4.0 * cause.sigma)
    assert cause.sigma < 0.02 * INERTIA_KGM2  # given the tolerance of the inertia that the file has


def test_a_gain_is_no_inertia_with_more_friction(tmp_path: Path) -> None:
    (cause,) = assess(readings(3, gain=1.25), machine(tmp_path)).verdict
    assert cause.cause == "torque_gain" and cause.value == pytest.approx(1.25, abs=4.0 * cause.sigma)


def test_friction_that_the_file_lacks_is_no_gear(tmp_path: Path) -> None:
    """A gear acts as a gain if the friction is free."""
    (cause,) = assess(readings(4), machine(tmp_path, friction=0.0)).verdict
    assert cause.cause == "unmodelled_friction"
    assert cause.value == pytest.approx(COULOMB_NM + 60.0 * VISCOUS_NMS, rel=0.05)


def test_a_line_that_explains_little_of_the_torque_is_no_cause(tmp_path: Path) -> None:
    """A real drive has lines of 4e-5 of its torque's variance, which were named where its inertia was wrong."""
    seen = readings(6)
    line = 0.002 * np.sin(2.0 * np.pi * 77.0 * 1e-9 * seen.torque_stamps_ns)
    found = assess(replace(seen, torque=seen.torque + line), machine(tmp_path, inertia=0.2))
    assert found.found is not None and found.found.lines[0].frequency_hz == pytest.approx(77.0, abs=0.1)
    assert [cause.cause for cause in found.verdict] == ["unmodelled_inertia"]


def test_no_zero_is_stated(tmp_path: Path) -> None:
    found = calibrate(readings(5), machine(tmp_path))
    assert found.zero_rad.value == 0.0
    assert any(each.between == ("zero_rad",) and "does not depend" in each.text for each in found.ambiguous)


@pytest.mark.parametrize("share", [0.5, *more(1.0, 0.05)])
def test_the_gain_stays_and_inertia_and_friction_are_estimated(tmp_path: Path, share: float) -> None:
    found = identify(readings(6), machine(tmp_path, inertia=share, friction=share))
    assert "torque_sensor_gain" in {each.name for each in found.not_identifiable}
    true = {"added_inertia_kgm2": (1.0 - share) * INERTIA_KGM2, "shaft_viscous_Nms": VISCOUS_NMS}
    true["shaft_coulomb_Nm"] = COULOMB_NM
    for name, value in true.items():
        told = found.parameters[name]
        assert told.value == pytest.approx(value, abs=4.0 * told.sigma), name
        assert told.sigma < 0.03 * max(value, INERTIA_KGM2), name


def test_noise_and_ripple_give_no_false_cause(tmp_path: Path) -> None:
    """Run-up of 20 s; noise and a ripple of the turn hide the torque of the inertia."""
    rng = np.random.default_rng(57)
    time = np.arange(0.0, 20.0, 1e-3)
    settle_s, top = 2.0, 150.0
    omega = top * (1.0 - np.exp(-time / settle_s))
    theta = top * (time - settle_s * (1.0 - np.exp(-time / settle_s)))
    alpha = top / settle_s * np.exp(-time / settle_s)
    torque = INERTIA_KGM2 * alpha + VISCOUS_NMS * omega + 4.0 * COULOMB_NM
    torque = torque + 0.05 * np.sin(theta) + 0.2 * rng.standard_normal(time.size)
    stamps = np.rint(time * 1e9).astype(np.int64)
    step = 2.0 * np.pi / 2**14
    noisy = Readings(stamps, np.rint(theta / step) * step, stamps, torque)
    (cause,) = assess(noisy, machine(tmp_path)).verdict
    assert cause.cause == "unmodelled_friction"
    assert cause.value == pytest.approx(3.0 * COULOMB_NM, abs=4.0 * cause.sigma) and cause.sigma < 0.12 * COULOMB_NM
    found = identify(noisy, machine(tmp_path)).parameters
    assert found["added_inertia_kgm2"].value == pytest.approx(0.0, abs=3.0 * found["added_inertia_kgm2"].sigma)
