"""Torque of an elastic shaft from two encoders, against an independently integrated machine."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.comparison.test_shaft_identification import far_angle, misdeclared
from tests.generators.elastic_shaft import TURN, Record, WideMachine, simulate
from tests.twin.test_elastic_session import TORQUE, error_over_peak
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.machine_topics import SECOND_ANGLE_TOPIC
from textile_twin_core.recordings.replay import replay_bag
from textile_twin_core.twin import Samples

WIDE = WideMachine(0.06)


@cache
def record() -> Record:
    """Sixteen linkages at 300 rpm."""
    return simulate(WIDE, 300.0, 3.0, settle_s=1.0, seed=3)


def machine(factor: float) -> Machine:
    """The machine with stiffness, damping and drive wrong by a factor, and a second encoder at its far end."""
    return misdeclared(WIDE, factor, second_encoder_at="s16")


def both(factor: float, stamps_ns: np.ndarray, angles: np.ndarray, shaft: str = "causal") -> Samples:
    """Predictions from the encoder at the drive and readings of the second one."""
    session = ttc.compile(machine(factor), outputs=(TORQUE, "twist_rad")).session(shaft)
    session.take_second(stamps_ns, angles)
    samples = session.step(record().stamps_ns, record().encoder_rad)
    return samples if shaft == "causal" else session.finish()


def test_an_exact_file_is_as_good_as_with_one_encoder() -> None:
    made = record()
    samples = both(1.0, made.stamps_ns, np.mod(far_angle(made), TURN))
    assert error_over_peak(samples, made, 1.5) < 0.003
    late = made.time_s[samples.index] > 1.5
    inside = np.abs(samples[TORQUE] - made.torque_Nm[samples.index]) < samples.torque_sigma_Nm
    assert np.mean(inside[late]) > 0.6


@pytest.mark.parametrize("shaft", ["causal", "smooth"])
def test_a_wrong_shaft_costs_a_fifth_as_much(shaft: str) -> None:
    made = record()
    session = ttc.compile(machine(1.05), outputs=(TORQUE,)).session()
    one = error_over_peak(session.step(made.stamps_ns, made.encoder_rad), made, 1.5)
    samples = both(1.05, made.stamps_ns, far_angle(made), shaft)
    assert error_over_peak(samples, made, 1.5) < 0.2 * one
    twist = (made.angles_rad[:, 0] - made.angles_rad[:, -1])[samples.index]
    late = made.time_s[samples.index] > 1.5
    assert np.std((samples["twist_rad"] - twist)[late]) < 0.5 * TURN / 2**14


def test_readings_between_those_of_the_first_encoder() -> None:
    made = record()
    late_s, step = 4e-4, TURN / 2**14
    readings = np.rint((made.angles_rad[:, -1] - late_s * made.speeds_rad_s[:, -1]) / step) * step
    readings[::97] = np.nan
    readings[50::101] += 0.5
    kept = np.random.default_rng(2).random(readings.size) > 0.1
    samples = both(1.05, (made.stamps_ns - round(1e9 * late_s))[kept], readings[kept])
    assert error_over_peak(samples, made, 1.5) < 0.04


def test_blocks_of_any_size_give_the_same_numbers() -> None:
    made, far = record(), far_angle(record())
    whole = both(1.05, made.stamps_ns, far)
    session = ttc.compile(machine(1.05), outputs=(TORQUE, "twist_rad")).session()
    torques: list[float] = []
    for begin, end in ((0, 1), (1, 3), (3, 500), (500, 1499), (1499, 1500)):
        session.take_second(made.stamps_ns[begin:end], far[begin:end])
        torques += session.step(made.stamps_ns[begin:end], made.encoder_rad[begin:end])[TORQUE].tolist()
    for stamp, near, other in zip(made.stamps_ns[1500:].tolist(), made.encoder_rad[1500:], far[1500:], strict=True):
        session.take_second([stamp], [other])
        torques += [sample.outputs[TORQUE] for sample in session.step_one(stamp, near)]
    np.testing.assert_allclose(torques, whole[TORQUE], rtol=0.0, atol=1e-9 * np.abs(whole[TORQUE]).max())


def test_a_second_encoder_may_fall_silent() -> None:
    made, half = record(), 1500
    whole = both(1.05, made.stamps_ns[:half], far_angle(made)[:half])
    session = ttc.compile(machine(1.05), outputs=(TORQUE,)).session()
    session.take_second(made.stamps_ns[:half], far_angle(made)[:half])
    parts = [slice(begin, begin + 100) for begin in range(0, made.stamps_ns.size, 100)]
    torques = [session.step(made.stamps_ns[part], made.encoder_rad[part])[TORQUE] for part in parts]
    np.testing.assert_allclose(
        np.concatenate(torques), whole[TORQUE], rtol=0.0, atol=1e-9 * np.abs(whole[TORQUE]).max()
    )


def test_replay_uses_the_second_encoder_of_the_recording(tmp_path: Path) -> None:
    made = record()
    with BagWriter(tmp_path / "bag") as out:
        for topic, angles in (("main_shaft/angle", made.encoder_rad), (SECOND_ANGLE_TOPIC, far_angle(made))):
            out.write_joint_states(topic, made.stamps_ns, ["main_shaft"], angles)
    with BagWriter(tmp_path / "replayed") as out:
        assert replay_bag(open_bag(tmp_path / "bag"), out, machine(1.05)).notes == []
    predicted = open_bag(tmp_path / "replayed").read_torques("balancing_torque/predicted").torque_Nm
    whole = both(1.05, made.stamps_ns, far_angle(made))[TORQUE]
    np.testing.assert_allclose(predicted, whole, rtol=0.0, atol=1e-9 * np.abs(whole).max())


def test_what_is_refused() -> None:
    one = misdeclared(WIDE, 1.0)
    with pytest.raises(SceneError, match="second_encoder_at"):
        ttc.compile(one, outputs=(TORQUE,)).session().take_second([0], [0.0])
    assert one.shaft is not None
    with pytest.raises(MachineError, match="first encoder already"):
        dataclasses.replace(one.shaft, second_encoder_at="s0")
