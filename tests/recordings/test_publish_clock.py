"""Messages without a stamp get the time of publishing if it is the better clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.cdr_encode import encode_floats
from textile_twin_core.recordings.recorded_clock import better_clock
from textile_twin_core.recordings.rolling_recording import RollingRecording


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


@pytest.fixture(scope="module")
def bursts(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A recording received in bursts of 16 ms, and its even times of publishing."""
    published = 10**18 + 2_000_000 * np.arange(2000)
    logged = (published // 16_000_000 + 1) * 16_000_000
    path = tmp_path_factory.mktemp("bursts") / "bag.mcap"
    return write_floats(path, logged, published, np.mod(0.032 * np.arange(2000), 6.28)), published


@pytest.mark.parametrize("command", [["recover"], ["replay", "--machine", "tufting"]])
def test_a_copy_keeps_the_times_of_publishing(
    tmp_path: Path, bursts: tuple[Path, np.ndarray], command: list[str]
) -> None:
    path, published = bursts
    assert main([command[0], str(path), "--out", str(tmp_path / "copy"), *command[1:]]) == 0
    (file,) = (tmp_path / "copy").glob("*.mcap")
    with file.open("rb") as stream:
        kept = [message.publish_time for *_, message in make_reader(stream).iter_messages(["/main_shaft/angle"])]
    assert kept == published.tolist()
    assert np.array_equal(open_bag(tmp_path / "copy").read_angles().stamps, published)


def test_a_cut_keeps_the_times_of_publishing(tmp_path: Path) -> None:
    rolling = RollingRecording(tmp_path / "rolling")
    rolling.writer.add_topic("main_shaft/angle", "std_msgs/msg/Float64")
    logged, published = 10**18 + 10_000_000 * np.arange(50), 10**18 + 7_000_000 * np.arange(50)
    for log, publish, row in zip(logged.tolist(), published.tolist(), encode_floats(np.arange(50.0)), strict=True):
        rolling.writer.write("main_shaft/angle", log, row.tobytes(), publish)
    rolling.close()
    assert rolling.cut(logged[10], logged[39], tmp_path / "cut") == 30
    times = [(log, publish) for _, log, publish, _ in open_bag(tmp_path / "cut").timed_messages()]
    assert times == list(zip(logged[10:40].tolist(), published[10:40].tolist(), strict=True))
