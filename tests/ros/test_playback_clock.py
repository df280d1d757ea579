"""Holes in a recording's log times, repetitions, and which of its topics are a twin's."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE, SECOND_NS, Suite, shaft_angles
from tests.ros.test_live_topics import stamp_of
from textile_twin_core.recordings import BagWriter
from textile_twin_core.recordings.schemas import FLOAT64, JOINT_STATE, POINT, WRENCH
from textile_twin_ros.machine_namespace import published_by_twins
from textile_twin_ros.messages import JointTemplate
from textile_twin_ros.pacing import PlaybackClock

MINUTE_NS = 60 * SECOND_NS
YEAR_2024_NS = 1_704_067_200 * SECOND_NS


@pytest.mark.parametrize("hole_ns", [61 * SECOND_NS, 86_400 * SECOND_NS, YEAR_2024_NS])
@pytest.mark.parametrize("place", [1, 50, 99])
def test_a_hole_is_one_second(hole_ns: int, place: int) -> None:
    log = np.arange(100) * 2_000_000
    log[place:] += hole_ns
    times = PlaybackClock(MINUTE_NS)
    taken = [times.take(int(time)) for time in log]
    steps = np.diff([played for played, _ in taken])
    expected = np.full(99, 2_000_000)
    expected[place - 1] = SECOND_NS
    np.testing.assert_array_equal(steps, expected)
    assert [skipped for _, skipped in taken if skipped] == [hole_ns + 2_000_000 - SECOND_NS]


def test_shorter_pauses_are_played_and_all_where_asked_for() -> None:
    for longest_ns, pause_ns in ((MINUTE_NS, 59 * SECOND_NS), (0, YEAR_2024_NS)):
        times = PlaybackClock(longest_ns)
        assert [times.take(log) for log in (5, 5 + pause_ns)] == [(0, 0), (pause_ns, 0)]


def test_stamps_go_on_after_a_hole_by_what_they_span() -> None:
    for stamps, span in ((np.arange(100) * 2_000_000 + YEAR_2024_NS, 198_000_000), (np.array([0, 0, 7, 9]), None)):
        times = PlaybackClock(MINUTE_NS)
        for number, stamp in enumerate(stamps.tolist()):
            times.take(0 if number < 2 else YEAR_2024_NS + number * 2_000_000)
            times.note_stamp(stamp)
        moved = times.repeat()
        assert (span or 0) < moved < 2 * SECOND_NS
        assert times.take(0)[0] > 0


TWIN = {
    "/m1/balancing_torque/predicted": WRENCH,
    "/m1/balancing_torque/residual": WRENCH,
    "/m1/horse_head/position": POINT,
    "/m1/joint_states": JOINT_STATE,
    "/m1/robot_description": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


@pytest.mark.parametrize(
    ("inputs", "left_out"),
    [
        ({"/m1/main_shaft/angle": JOINT_STATE, "/m1/balancing_torque/measured": WRENCH}, set(TWIN)),
        ({"/m1/main_shaft/angle": FLOAT64, "/oil/temperature": FLOAT64}, set(TWIN)),
        ({"/press/encoder": JOINT_STATE}, set(TWIN)),
        # Joint states are the machine's own: a twin can have made the others from them alone.
        (
            {"/m1/balancing_torque/measured": WRENCH},
            {topic for topic, kind in TWIN.items() if kind in (WRENCH, POINT)} | {"/diagnostics"},
        ),
    ],
)
def test_what_a_twin_publishes_is_known(inputs: dict[str, str], left_out: set[str]) -> None:
    assert published_by_twins({**inputs, **TWIN}) == left_out
    assert published_by_twins(inputs) == set()


def test_a_recording_without_inputs_is_played_whole() -> None:
    assert published_by_twins({name: kind for name, kind in TWIN.items() if kind != JOINT_STATE}) == set()


def test_log_times_that_begin_at_0_are_played_at_once(suite: Suite) -> None:
    stamps, angles = shaft_angles(60)
    template = JointTemplate(["main_shaft"], velocities=False)
    with BagWriter(suite.folder / "played") as bag:
        bag.add_topic("main_shaft/angle", JOINT_STATE)
        for number, (stamp, angle) in enumerate(zip(stamps.tolist(), angles.tolist(), strict=True)):
            bag.write("main_shaft/angle", 0 if number < 30 else stamp, template.message(stamp, angle))
        bag.write_wrenches("balancing_torque/predicted", stamps, np.zeros(60))
    replay = suite.start("replay_node", f"bag:={suite.folder / 'played'}", "loop:=true", "clock_rate_hz:=50.0")
    node = suite.node()
    heard: list[int] = []
    node.create_subscription(JointState, "main_shaft/angle", lambda message: heard.append(stamp_of(message)), RELIABLE)
    suite.spin_until(lambda: len(heard) >= 150, "two repetitions")
    assert node.count_publishers("balancing_torque/predicted") == 0
    assert replay.end() == 0
    np.testing.assert_array_equal(heard[:60], stamps)
    assert 0 < heard[60] - heard[59] < 2 * SECOND_NS
    words = replay.words()
    assert words.count("the log times step by 1.7e+09 s after 30 messages") >= 1, words
    assert "left out, as a twin publishes it: /balancing_torque/predicted" in words
