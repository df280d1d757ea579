"""Pacing without drift, and time that is set back."""

from __future__ import annotations

import threading
import time

from hypothesis import given
from hypothesis import strategies as st

from tests.ros.suite import SECOND_NS
from textile_twin_core.twin.restart import RestartWatch
from textile_twin_ros.pacing import Pace


def test_moments_are_never_early_and_do_not_drift() -> None:
    pace = Pace(threading.Event(), rate=10.0)
    start = time.monotonic()
    for number in range(200):
        assert pace.wait_until(number / 100.0)
        assert time.monotonic() - start >= number / 1000.0 - 1e-3


def test_the_rate_may_change_meanwhile() -> None:
    pace = Pace(threading.Event(), rate=1.0)
    pace.set_rate(100.0)
    start = time.monotonic()
    assert pace.wait_until(10.0)
    assert time.monotonic() - start > 0.09


def test_a_stop_ends_the_waiting() -> None:
    stop = threading.Event()
    threading.Timer(0.05, stop.set).start()
    assert not Pace(stop).wait_until(1000.0)


def test_a_rate_that_is_raised_ends_a_long_pause() -> None:
    pace = Pace(threading.Event(), rate=1.0)
    waiting = threading.Thread(target=pace.wait_until, args=(3600.0,), daemon=True)
    waiting.start()
    pace.set_rate(1e5)
    waiting.join(60.0)
    assert not waiting.is_alive()


@given(st.lists(st.integers(0, 900_000_000), max_size=60))
def test_late_samples_are_no_restart(late_ns: list[int]) -> None:
    watch = RestartWatch()
    assert not any(watch.restarted(k * 2_000_000 - late) for k, late in enumerate(late_ns))


def test_one_stamp_far_in_the_future_is_overcome() -> None:
    watch = RestartWatch()
    assert not watch.restarted(0)
    assert not watch.restarted(10**18)
    states = [watch.restarted(k * 2_000_000) for k in range(1, 30)]
    assert states.index(True) == 9 and sum(states) == 1


def test_a_recording_played_again_is_a_restart_once() -> None:
    watch = RestartWatch()
    states = [watch.restarted(k % 1000 * 2_000_000 + SECOND_NS) for k in range(3000)]
    assert [k for k, restarted in enumerate(states) if restarted] == [1009, 2009]
