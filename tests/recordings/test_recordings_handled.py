"""Recordings as users pass them on: files in any order, compressed or decompressed by hand, without metadata."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from mcap.writer import Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from textile_twin_core.cli.main import main
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter, open_bag

N = 2000
STAMPS = 1_767_081_604_000_000_000 + 2_000_000 * np.arange(N)
ANGLE = 0.03 * np.arange(N) + 0.3
TORQUE = np.sin(ANGLE)
STORE = get_typestore(Stores.ROS2_JAZZY)


def write(path: Path, here: slice = slice(None)) -> Path:
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", STAMPS[here], ["main_shaft"], ANGLE[here])
        out.write_wrenches("balancing_torque/measured", STAMPS[here], TORQUE[here])
    return path


def rosbags(path: Path, plugin: StoragePlugin, mode: CompressionMode | None) -> Path:
    """Write the same recording by the rosbags library."""
    source = open_bag(write(path.with_name("source")))
    writer = RosbagsWriter(path, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = {
            name: writer.add_connection(name, info.msgtype, typestore=STORE) for name, info in source.topics.items()
        }
        for topic, time, cdr in source.raw_messages():
            writer.write(topics[topic], time, cdr)
    return path


def check(bag: Path) -> None:
    opened = open_bag(bag)
    angles, torques = opened.read_angles(), opened.read_torques()
    np.testing.assert_array_equal(angles.stamps, STAMPS)
    np.testing.assert_array_equal(angles.angles_rad, ANGLE)
    np.testing.assert_array_equal(torques.stamps, STAMPS)
    np.testing.assert_array_equal(torques.torque_Nm, TORQUE)
    assert opened.notices == []


def pack(path: Path, end: str = ".zstd") -> Path:
    packed = path.with_name(path.name + end)
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    return packed


def information(bag: Path, **entries: object) -> None:
    content = yaml.safe_load((bag / "metadata.yaml").read_text())
    content["rosbag2_bagfile_information"] |= entries
    (bag / "metadata.yaml").write_text(yaml.dump(content))


@pytest.mark.parametrize(
    ("order", "metadata"),
    [([0, 2, 1, 3], True), ([3, 2, 1, 0], True), ([1, 0, 3, 2], False), ([2, 0, 1, 3], False), ([0, 3, 1, 2], True)],
)
def test_files_of_a_split_recording_in_any_order(order: list[int], metadata: bool, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    for name, part in enumerate(order):
        write(bag / f"s_{name}.mcap", slice(500 * part, 500 * (part + 1)))
    if metadata:
        write(tmp_path / "whole")
        (bag / "metadata.yaml").write_bytes((tmp_path / "whole/metadata.yaml").read_bytes())
        information(bag, relative_file_paths=[f"s_{k}.mcap" for k in range(4)])
    check(bag)


def alone(folder: Path) -> Path:
    return pack(write(folder / "rec_0.mcap"))


def alone_as_zst(folder: Path) -> Path:
    return pack(write(folder / "rec_0.mcap"), ".zst")


def without_metadata(folder: Path) -> Path:
    bag = write(folder / "bag")
    pack(next(bag.glob("*.mcap")))
    (bag / "metadata.yaml").unlink()
    return bag


def packed_by_hand(folder: Path) -> Path:
    """Compress a file without updating metadata.yaml, which names the original file."""
    bag = write(folder / "bag")
    pack(next(bag.glob("*.mcap")))
    return bag


def unpacked_by_hand(folder: Path) -> Path:
    """Decompress a file without updating metadata.yaml, which says FILE and names either file."""
    bag = write(folder / "bag")
    information(bag, compression_mode="FILE", compression_format="zstd", relative_file_paths=["bag_0.mcap.zstd"])
    return bag


def unpacked_and_named(folder: Path) -> Path:
    bag = write(folder / "bag")
    information(bag, compression_mode="FILE", compression_format="zstd")
    return bag


def both_there(folder: Path) -> Path:
    bag = write(folder / "bag")
    file = next(bag.glob("*.mcap"))
    whole = file.read_bytes()
    pack(file)
    file.write_bytes(whole)
    (bag / "metadata.yaml").unlink()
    return bag


def messages_without_metadata(folder: Path) -> Path:
    bag = rosbags(folder / "bag", StoragePlugin.MCAP, CompressionMode.MESSAGE)
    (bag / "metadata.yaml").unlink()
    return bag


def messages_in_a_single_file(folder: Path) -> Path:
    return next(rosbags(folder / "bag", StoragePlugin.MCAP, CompressionMode.MESSAGE).glob("*.mcap"))


def messages_said_to_be_plain(folder: Path) -> Path:
    bag = rosbags(folder / "bag", StoragePlugin.MCAP, CompressionMode.MESSAGE)
    information(bag, compression_mode="", compression_format="")
    return bag


def lone_database(folder: Path) -> Path:
    return next(rosbags(folder / "bag", StoragePlugin.SQLITE3, None).glob("*.db3"))


def database_without_metadata(folder: Path) -> Path:
    bag = rosbags(folder / "bag", StoragePlugin.SQLITE3, None)
    (bag / "metadata.yaml").unlink()
    return bag


def packed_database(folder: Path) -> Path:
    return pack(lone_database(folder))


def old_database(folder: Path) -> Path:
    """Write a recording as in Foxy: no definitions, no hashes, quality of service as text."""
    file = lone_database(folder)
    with sqlite3.connect(file) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute(
            "CREATE TABLE old AS SELECT id, name, type, serialization_format, offered_qos_profiles FROM topics"
        )
        database.execute("DROP TABLE topics")
        database.execute("ALTER TABLE old RENAME TO topics")
    return file


def database_of_packed_messages(folder: Path) -> Path:
    return next(rosbags(folder / "bag", StoragePlugin.SQLITE3, CompressionMode.MESSAGE).glob("*.db3"))


HANDED_ON: list[Callable[[Path], Path]] = [
    alone, alone_as_zst, without_metadata, packed_by_hand, unpacked_by_hand, unpacked_and_named, both_there,
    messages_without_metadata, messages_in_a_single_file, messages_said_to_be_plain,
    lone_database, database_without_metadata, packed_database, old_database, database_of_packed_messages,
]  # fmt: skip


@pytest.mark.parametrize("make", HANDED_ON)
def test_packed_unpacked_or_without_metadata(make: Callable[[Path], Path], tmp_path: Path) -> None:
    check(make(tmp_path))


def test_a_packed_recording_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "rec.mcap") as out:
        for k in range(0, 200_000, 10_000):
            out.write_floats("x", 1 + np.arange(k, k + 10_000), np.random.default_rng(k).normal(size=10_000))
    packed = pack(tmp_path / "rec.mcap")
    packed.write_bytes(packed.read_bytes()[: packed.stat().st_size // 2])
    opened = open_bag(packed)
    assert opened.truncated and 20_000 < opened.find_topic("x").count < 180_000


def test_a_packed_file_that_is_damaged_is_one_line(tmp_path: Path) -> None:
    packed = alone(tmp_path)
    spoilt = bytearray(packed.read_bytes())
    spoilt[4:40] = bytes(36)
    packed.write_bytes(spoilt)
    with pytest.raises(RecordingError, match="zstd cannot unpack it") as caught:
        open_bag(packed)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("encoding", ["json", "protobuf", "ros1", "flatbuffer", ""])
def test_messages_in_another_encoding_are_named(encoding: str, tmp_path: Path) -> None:
    with (tmp_path / "rec.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/JointState", "jsonschema", b"{}")
        channel = writer.register_channel("/main_shaft/angle", encoding, schema)
        for k in range(99):
            data = json.dumps({"name": ["main_shaft"], "position": [0.01 * k]}).encode()
            writer.add_message(channel, k + 1, data, k + 1)
        writer.finish()
    says = f"/main_shaft/angle holds {encoding or 'unknown'} messages, not CDR as ROS 2 writes them"
    with pytest.raises(RecordingError, match=says):
        open_bag(tmp_path / "rec.mcap").read_angles()


@pytest.mark.parametrize("finite", [0, 3])
@pytest.mark.parametrize("command", ["compare", "identify", "monitor"])
def test_a_torque_sensor_that_gives_no_numbers_is_named(
    command: str, finite: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoilt = np.where(np.arange(N) < finite, 1.0, np.nan)
    with BagWriter(tmp_path / "rec.mcap") as out:
        out.write_joint_states("main_shaft/angle", STAMPS, ["main_shaft"], ANGLE)
        out.write_wrenches("balancing_torque/measured", STAMPS, spoilt)
    code = main([command, str(tmp_path / "rec.mcap"), "--machine", "tufting"])
    said = capsys.readouterr().err
    assert code == 2
    share = "none finite" if not finite else f"only {finite} finite"
    assert f"{N} torque samples, {share}" in said


@pytest.mark.parametrize(
    "write_it",
    [
        lambda out, stamps: out.write_joint_states("a", stamps, ["main_shaft"], ANGLE),
        lambda out, stamps: out.write_wrenches("b", stamps, TORQUE),
        lambda out, stamps: out.write_floats("c", stamps, TORQUE),
        lambda out, stamps: out.write_events("d", stamps),
        lambda out, stamps: out.write_wrenches("e", stamps, TORQUE, log_times_ns=STAMPS),
    ],
)
def test_negative_stamps_are_refused_in_words(
    write_it: Callable[[BagWriter, np.ndarray], None], tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match=r"sample 1.*-2000000000 ns"), BagWriter(tmp_path / "bag") as out:
        write_it(out, 2_000_000 * np.arange(N) - 2_000_000_000)
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("name", ["log.csv", "Messung 3.TXT", "log.parquet", "log.mat", "log.tdms"])
@pytest.mark.parametrize("command", ["compare", "replay"])
def test_a_loggers_table_is_sent_to_import(
    command: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text("time,angle\n0,1\n")
    options = [] if command == "compare" else ["--out", str(tmp_path / "out")]
    assert main([command, str(tmp_path / name), "--machine", "tufting", *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "make a recording of a logger's table: textile-twin import" in said
