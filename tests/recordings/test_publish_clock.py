"""Messages without a stamp get the time of publishing if it is the better clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.writer import Writer

from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.cdr_encode import encode_floats
from textile_twin_core.recordings.recorded_clock import better_clock


def write_floats(path: Path, logged: np.ndarray, published: np.ndarray, values: np.ndarray) -> Path:
    """Write an MCAP file by the library of the format."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/main_shaft/angle", "cdr", schema)
        for log, publish, row in zip(logged.tolist(), published.tolist(), encode_floats(values), strict=True):
            writer.add_message(channel, log, row.tobytes(), publish)
        writer.finish()
    return path


def test_publish_times_are_used_where_log_times_come_in_bursts(tmp_path: Path) -> None:
    published = 10**18 + 2_000_000 * np.arange(1000)
    bursts = (published // 16_000_000 + 1) * 16_000_000
    values = 0.03 * np.arange(1000)
    angles = open_bag(write_floats(tmp_path / "a.mcap", bursts, published, values)).read_angles()
    assert np.array_equal(angles.stamps, published)
    assert np.array_equal(angles.angles_rad, values)
    even = open_bag(write_floats(tmp_path / "b.mcap", published + 500, bursts, values)).read_angles()
    assert np.array_equal(even.stamps, published + 500)


def test_invalid_times_of_publishing_are_not_used() -> None:
    logged = 10**18 + 2_000_000 * np.arange(100) + 500_000 * (np.arange(100) % 3)
    for published in (np.zeros(100, np.int64), 1 + 2_000_000 * np.arange(100), logged[::-1]):
        assert np.array_equal(better_clock(logged, published), logged)
