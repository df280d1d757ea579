"""A recording played through the twin into a recording: the same numbers as offline, and nothing lost."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import textile_twin_core as ttc
from tests.ros.suite import SECOND_NS, Suite, running_suite, shaft_angles, write_bag
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.recordings import open_bag

RESIDUAL = "balancing_torque/residual"
OUTPUTS = (
    "balancing_torque/predicted",
    "balancing_torque/predicted_sigma",
    RESIDUAL,
    "needle/position",
    "joint_states",
)
JOINTS = ("main_shaft", "coupler", "rocker", "rod", "needle_bar")
# Of the machine (Xu et al. 2016, Table 1).
X1_M, X2_M, H1_M = 0.070, 0.100, 0.155


def play_through(suite: Suite, bag: Path, rate: float, *twin_parameters: str) -> Path:
    """Play a bag through twin_node into record_node; the recording, which ends when all of it has come."""
    recording = suite.folder / "recording"
    topics = ["main_shaft/angle", "balancing_torque/measured", *OUTPUTS]
    count = open_bag(bag).topics["/main_shaft/angle"].count
    expected = {topic: count if topic in topics[:2] else count - 2 for topic in topics if topic != RESIDUAL}
    recorder = suite.start(
        "record_node",
        f"bag:={recording}",
        f"topics:={json.dumps(topics)}",
        f"stop_after:={json.dumps([f'{topic}={count}' for topic, count in expected.items()])}",
        "queue_s:=20.0",
    )
    twin = suite.start("twin_node", f"wait_for:={json.dumps(OUTPUTS)}", "qos_depth:=20000", *twin_parameters)
    twin.wait_for_words("predicting from")
    replay = suite.start(
        "replay_node", f"bag:={bag}", f"rate:={rate}", 'wait_for:=["main_shaft/angle=2", "balancing_torque/measured=2"]'
    )
    assert replay.wait() == 0, suite.words()
    assert recorder.wait() == 0, suite.words()
    assert twin.end() == 0, suite.words()
    return recording


@dataclass
class Chain:
    """Played recording, offline result of the engine, and the recording of the nodes' topics."""

    stamps: IntArray
    angles: FloatArray
    measured: FloatArray
    offline: ttc.Samples
    recording: Path


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chain]:
    """One run of replay, twin and recorder over 6 s of a machine with lost samples, at twice its speed."""
    stamps, angles = shaft_angles(3000)
    keep = np.random.default_rng(7).random(len(stamps)) > 0.02
    stamps, angles = stamps[keep], angles[keep]
    outputs = ["balancing_torque_Nm", "needle_position_m", *(f"joint_{name}_position" for name in JOINTS)]
    twin = ttc.compile(ttc.machines.tufting(), outputs=outputs)
    offline = twin.session(shaft="causal").step(stamps, angles)
    # Measured is what the twin itself predicts, 1 ms later: interpolation is all that the residual holds.
    measured = np.concatenate([[0.0, 0.0], offline["balancing_torque_Nm"]])
    with running_suite(tmp_path_factory.mktemp("chain")) as suite:
        bag = write_bag(suite.folder / "played", stamps, angles, measured)
        yield Chain(stamps, angles, measured, offline, play_through(suite, bag, 2.0))


@pytest.mark.slow
def test_what_was_played_is_recorded_byte_for_byte(chain: Chain) -> None:
    played = open_bag(chain.recording.parent / "played")
    recorded = open_bag(chain.recording)
    for topic in played.topics:
        sent = [raw for _, _, raw in played.raw_messages([topic])]
        taken = [raw for _, _, raw in recorded.raw_messages([topic])]
        assert taken == sent


@pytest.mark.slow
def test_nodes_publish_what_an_offline_session_computes(chain: Chain) -> None:
    recorded, offline = open_bag(chain.recording), chain.offline
    assert len(offline) == len(chain.stamps) - 2
    for topic, values in (("predicted", offline["balancing_torque_Nm"]), ("predicted_sigma", offline.torque_sigma_Nm)):
        online = recorded.read_torques(f"balancing_torque/{topic}")
        np.testing.assert_array_equal(online.stamps, offline.stamps)
        np.testing.assert_allclose(online.torque_Nm, values, rtol=0.0, atol=1e-9)
    tip = recorded.read_points("needle/position")
    np.testing.assert_array_equal(tip.stamps, offline.stamps)
    np.testing.assert_allclose(tip.points_m[:, 0], X1_M + X2_M, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(tip.points_m[:, 1], H1_M - offline["needle_position_m"], rtol=0.0, atol=1e-9)
    stamps, positions = recorded.read_joint_states()
    np.testing.assert_array_equal(stamps, offline.stamps)
    for name in JOINTS:
        difference = positions[name] - offline[f"joint_{name}_position"]
        np.testing.assert_allclose(np.remainder(difference + 1.0, 2.0 * np.pi) - 1.0, 0.0, atol=1e-9)


@pytest.mark.slow
def test_residual_is_measured_minus_the_prediction_at_the_sensors_time(chain: Chain) -> None:
    recorded, first = open_bag(chain.recording), chain.stamps[0]
    residual = recorded.read_torques(RESIDUAL)
    predicted = recorded.read_torques("balancing_torque/predicted")
    expected = np.interp(residual.stamps - first, predicted.stamps - first, predicted.torque_Nm)
    sent = np.searchsorted(chain.stamps + 1_000_000, residual.stamps)
    np.testing.assert_array_equal(chain.stamps[sent] + 1_000_000, residual.stamps)
    np.testing.assert_allclose(residual.torque_Nm, chain.measured[sent] - expected, rtol=0.0, atol=1e-9)
    # Angles that a busy twin reads before the first torque of all have no residual: then they cannot be compared yet.
    began = sent[0]
    assert began < len(chain.stamps) // 2
    # None for the last sample, nor in the intervals in which the needle enters or leaves.
    theta = chain.offline.theta_rad
    revolutions = (theta[-1] - theta[max(began - 2, 0)]) / (2.0 * np.pi)
    left_out = len(chain.stamps) - began - len(residual)
    # While the estimator finds its feet, a tool near the backing may be taken to pass its plane more than once.
    assert abs(left_out - (1 + 2.0 * revolutions)) <= 8.0


def test_an_independent_reader_counts_the_same(chain: Chain) -> None:
    counts: Counter[str] = Counter()
    with AnyReader([chain.recording], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            assert message.header.stamp.sec >= chain.stamps[0] // SECOND_NS
            counts[connection.topic] += 1
        assert counts == Counter({connection.topic: connection.msgcount for connection in reader.connections})
    assert counts["/main_shaft/angle"] == counts["/balancing_torque/measured"] == len(chain.stamps)
    for topic in ("balancing_torque/predicted", "balancing_torque/predicted_sigma", "needle/position", "joint_states"):
        assert counts[f"/{topic}"] == len(chain.stamps) - 2


@pytest.mark.campaign
@pytest.mark.slow
def test_fixed_lag_gives_every_sample_too(suite: Suite) -> None:
    stamps, angles = shaft_angles(600)
    bag = write_bag(suite.folder / "played", stamps, angles, angles)
    recorded = open_bag(play_through(suite, bag, 1.0, "shaft:=lag", "shaft_lag_s:=0.04"))
    twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
    session = twin.session(shaft="lag", shaft_lag_s=0.04)
    parts = [session.step(stamps, angles), session.finish()]
    online = recorded.read_torques("balancing_torque/predicted")
    np.testing.assert_array_equal(online.stamps, np.concatenate([part.stamps for part in parts]))
    offline = np.concatenate([part["balancing_torque_Nm"] for part in parts])
    np.testing.assert_allclose(online.torque_Nm, offline, rtol=0.0, atol=1e-9)
