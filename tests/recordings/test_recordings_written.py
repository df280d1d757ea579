"""Recordings of BagWriter read back by the rosbags library, by rclpy and by ourselves."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from tests.full_disk import full_disk
from textile_twin_core.errors import OutputError, RecordingError
from textile_twin_core.recordings import LATCHED, BagWriter, open_bag
from textile_twin_core.recordings.cdr_encode import encode_string
from textile_twin_core.recordings.schemas import message_schema

N = 5_000
EPOCH = 1_700_000_000_000_000_000
NAMES = ["main_shaft", "coupler", "rocker", "rod", "needle_bar"]


@pytest.fixture(scope="module")
def truth() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(11)
    stamps = EPOCH + np.cumsum(rng.integers(1_900_000, 2_100_000, N))
    return {
        "stamps": stamps,
        "log": stamps + rng.integers(0, 300_000, N),
        "angle": rng.normal(size=N),
        "velocity": rng.normal(size=N),
        "torque": rng.normal(size=N),
        "points": rng.normal(size=(N, 3)),
        "joints": rng.normal(size=(N, len(NAMES))),
    }


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, truth: dict[str, np.ndarray]) -> Path:
    path = tmp_path_factory.mktemp("bags") / "written"
    with BagWriter(path, custom_data={"source": "made up"}) as out:
        out.add_topic("robot_description", "std_msgs/msg/String", LATCHED)
        out.write("robot_description", EPOCH, encode_string("<robot/>"))
        for part in np.array_split(np.arange(N), 7):
            stamps, log = truth["stamps"][part], truth["log"][part]
            out.write_joint_states(
                "main_shaft/angle", stamps, ["main_shaft"], truth["angle"][part], truth["velocity"][part],
                log_times_ns=log,
            )  # fmt: skip
            out.write_joint_states("joint_states", stamps, NAMES, truth["joints"][part], frame_id="base")
            out.write_wrenches("/balancing_torque/measured", stamps, truth["torque"][part], log_times_ns=log)
            out.write_points("needle/position", stamps, truth["points"][part], "base")
            out.write_floats("plain", log, truth["angle"][part])
    return path


def test_the_rosbags_library_reads_every_message(bag: Path, truth: dict[str, np.ndarray]) -> None:
    got: dict[str, list[tuple[float, ...]]] = {}
    with AnyReader([bag]) as reader:
        assert reader.message_count == 5 * N + 1
        for connection, log_time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            rows = got.setdefault(connection.topic, [])
            if connection.msgtype == "std_msgs/msg/Float64":
                rows.append((log_time, message.data))
            elif connection.msgtype == "std_msgs/msg/String":
                assert message.data == "<robot/>"
            else:
                stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                if connection.topic == "/main_shaft/angle":
                    assert message.name == ["main_shaft"]
                    assert len(message.effort) == 0
                    rows.append((log_time, stamp, message.position[0], message.velocity[0]))
                elif connection.topic == "/joint_states":
                    assert message.name == NAMES
                    assert message.header.frame_id == "base"
                    rows.append((stamp, *message.position))
                elif connection.topic == "/needle/position":
                    rows.append((stamp, message.point.x, message.point.y, message.point.z))
                else:
                    assert message.header.frame_id == "main_shaft"
                    assert (message.wrench.force.x, message.wrench.torque.y) == (0.0, 0.0)
                    rows.append((log_time, stamp, message.wrench.torque.z))
    by_log = np.argsort(truth["log"], kind="stable")

    def same(topic: str, *columns: np.ndarray, order: np.ndarray) -> None:
        expected = list(zip(*(column[order].tolist() for column in columns), strict=True))
        assert got[topic] == expected

    in_order = np.arange(N)
    same("/main_shaft/angle", *(truth[k] for k in ("log", "stamps", "angle", "velocity")), order=by_log)
    same("/balancing_torque/measured", truth["log"], truth["stamps"], truth["torque"], order=by_log)
    same("/plain", truth["log"], truth["angle"], order=by_log)
    same("/joint_states", truth["stamps"], *truth["joints"].T, order=in_order)
    same("/needle/position", truth["stamps"], *truth["points"].T, order=in_order)


def test_the_mcap_library_finds_index_and_checksums_right(bag: Path) -> None:
    with (bag / "written_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 5 * N + 1
        by_id = {channel.id: channel.topic for channel in summary.channels.values()}
        counts = {by_id[number]: count for number, count in summary.statistics.channel_message_counts.items()}
        assert counts == {name: topic.count for name, topic in open_bag(bag).topics.items()}
        last = 0
        for _, channel, message in reader.iter_messages(topics=["/main_shaft/angle", "/plain"]):
            assert message.log_time >= last
            last = message.log_time
            counts[channel.topic] -= 1
        assert counts["/main_shaft/angle"] == counts["/plain"] == 0


def test_our_reader_gives_the_same_numbers_bit_for_bit(bag: Path, truth: dict[str, np.ndarray]) -> None:
    opened = open_bag(bag)
    assert opened.metadata == {"source": "made up"}
    assert not opened.truncated
    assert opened.topics["/needle/position"].count == N
    assert opened.start_ns == EPOCH
    assert opened.end_ns == truth["log"].max()
    angles = opened.read_angles()
    for got, expected in (
        (angles.stamps, "stamps"),
        (angles.angles_rad, "angle"),
        (angles.velocities, "velocity"),
    ):
        np.testing.assert_array_equal(got, truth[expected])
    torques = opened.read_torques("balancing_torque/measured")
    np.testing.assert_array_equal(torques.torque_Nm, truth["torque"])
    np.testing.assert_array_equal(opened.read_points("/needle/position").points_m, truth["points"])
    stamps, joints = opened.read_joint_states()
    np.testing.assert_array_equal(stamps, truth["stamps"])
    np.testing.assert_array_equal(np.stack([joints[name] for name in NAMES], axis=1), truth["joints"])
    plain = opened.read_angles("plain")
    np.testing.assert_array_equal(plain.stamps, truth["log"])


def test_raw_messages_come_in_order_of_time_and_rclpy_understands_them(bag: Path, truth: dict[str, np.ndarray]) -> None:
    serialization = pytest.importorskip("rclpy.serialization")
    from geometry_msgs.msg import PointStamped, WrenchStamped
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64, String

    classes = {
        "/main_shaft/angle": JointState,
        "/joint_states": JointState,
        "/balancing_torque/measured": WrenchStamped,
        "/needle/position": PointStamped,
        "/plain": Float64,
        "/robot_description": String,
    }
    last = 0
    seen: dict[str, int] = {}
    by_log = np.argsort(truth["log"], kind="stable")
    for topic, log_time, cdr in open_bag(bag).raw_messages():
        assert log_time >= last
        last = log_time
        k = seen.get(topic, 0)
        seen[topic] = k + 1
        if k % 97:
            continue
        message = serialization.deserialize_message(cdr, classes[topic])
        if topic == "/joint_states":
            assert list(message.position) == truth["joints"][k].tolist()
            assert (list(message.name), len(message.velocity), len(message.effort)) == (NAMES, 0, 0)
        elif topic == "/main_shaft/angle":
            assert message.position[0] == truth["angle"][by_log[k]]
            assert message.velocity[0] == truth["velocity"][by_log[k]]
        elif topic == "/balancing_torque/measured":
            assert message.wrench.torque.z == truth["torque"][by_log[k]]
            stamp = message.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == truth["stamps"][by_log[k]]
        elif topic == "/needle/position":
            assert [message.point.x, message.point.y, message.point.z] == truth["points"][k].tolist()
    assert sum(seen.values()) == 5 * N + 1


def test_what_rclpy_serialises_is_decoded(tmp_path: Path) -> None:
    serialization = pytest.importorskip("rclpy.serialization")
    from sensor_msgs.msg import JointState

    with BagWriter(tmp_path / "b") as out:
        out.add_topic("main_shaft/angle", "sensor_msgs/msg/JointState")
        for k in range(50):
            message = JointState()
            message.header.stamp.sec, message.header.stamp.nanosec = 1000 + k, 5
            message.header.frame_id = "x" * (k % 6)
            message.name = ["other", "main_shaft"][k % 2 :]
            message.position = [float(k), 2.5 * k][k % 2 :]
            message.velocity = [0.0, 3.5] if k % 4 == 0 else []
            cdr = serialization.serialize_message(message)
            out.write("main_shaft/angle", k + 1, cdr)
    angles = open_bag(tmp_path / "b").read_angles()
    np.testing.assert_array_equal(angles.angles_rad, 2.5 * np.arange(50))
    np.testing.assert_array_equal(angles.stamps, (1000 + np.arange(50)) * 10**9 + 5)
    assert angles.velocities is not None
    np.testing.assert_array_equal(angles.velocities, np.where(np.arange(50) % 4 == 0, 3.5, np.nan))


def test_metadata_says_what_rosbag2_of_jazzy_says(bag: Path) -> None:
    info = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["version"] == 9
    assert info["storage_identifier"] == "mcap"
    assert info["relative_file_paths"] == ["written_0.mcap"]
    assert info["custom_data"] == {"source": "made up"}
    assert info["files"][0]["message_count"] == info["message_count"] == 5 * N + 1
    topics = {entry["topic_metadata"]["name"]: entry["topic_metadata"] for entry in info["topics_with_message_count"]}
    assert topics["/robot_description"]["offered_qos_profiles"][0]["durability"] == "transient_local"
    store = get_typestore(Stores.ROS2_JAZZY)
    for topic in topics.values():
        assert topic["type_description_hash"] == store.hash_rihs01(topic["type"])
    with Reader(bag) as reader:
        assert reader.duration == info["duration"]["nanoseconds"] + 1
        qos = {connection.topic: connection.ext.offered_qos_profiles[0] for connection in reader.connections}
    assert qos["/robot_description"].durability.name == "TRANSIENT_LOCAL"


@pytest.mark.parametrize("msgtype", ["lifecycle_msgs/msg/TransitionEvent", "sensor_msgs/msg/JointState"])
def test_installed_definitions_agree_with_the_rosbags_library(msgtype: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Apply the fall-back for unknown types to known ones: same hash, same fields of every nested type."""
    from rosbags.typesys import get_types_from_msg

    from textile_twin_core.recordings import schemas

    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    if not (Path(sys.prefix) / "share" / "lifecycle_msgs").exists():
        pytest.skip("no ROS message packages beside this Python")
    installed, known = schemas.installed_schema(msgtype), message_schema(msgtype)
    assert installed.type_hash == known.type_hash
    assert get_types_from_msg(installed.text, msgtype).keys() == get_types_from_msg(known.text, msgtype).keys()


def test_a_type_that_is_known_nowhere_is_an_error(tmp_path: Path) -> None:
    with (
        pytest.raises(RecordingError, match=r"mill_msgs/msg/Loom.*AMENT_PREFIX_PATH"),
        BagWriter(tmp_path / "b") as out,
    ):
        out.add_topic("loom", "mill_msgs/msg/Loom")
    assert list(tmp_path.iterdir()) == []


def test_a_single_file_carries_its_custom_data(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "one.mcap", custom_data={"seed": "7"}) as out:
        out.write_floats("x", np.array([1, 2]), np.array([0.5, 1.5]))
    opened = open_bag(tmp_path / "one.mcap")
    assert opened.metadata == {"seed": "7"}
    np.testing.assert_array_equal(opened.read_angles("x").angles_rad, [0.5, 1.5])


def test_nothing_is_left_of_a_recording_that_fails(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), BagWriter(tmp_path / "b") as out:
        out.write_floats("x", np.array([1]), np.array([0.5]))
        assert not (tmp_path / "b").exists()
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_replaced_only_when_asked(tmp_path: Path) -> None:
    for value in (1.0, 2.0):
        with BagWriter(tmp_path / "b", overwrite=value > 1) as out:
            out.write_floats("x", np.array([1]), np.array([value]))
    with pytest.raises(OutputError, match="is there already"):
        BagWriter(tmp_path / "b")
    assert open_bag(tmp_path / "b").read_angles("x").angles_rad.tolist() == [2.0]
    assert [entry.name for entry in tmp_path.iterdir()] == ["b"]


@pytest.mark.parametrize("place", ["file/deeper/b", "file/b"])
def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(OutputError) as caught:
        BagWriter(tmp_path / place)
    assert "\n" not in str(caught.value)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file"]


_KILLED = """
import os, signal, sys
from types import SimpleNamespace
import numpy as np
from textile_twin_core.recordings import BagWriter, bag_write
now = 0.0
bag_write.time = SimpleNamespace(monotonic=lambda: now)
with BagWriter(sys.argv[1], live=True) as out:
    out.add_topic("x", "std_msgs/msg/Float64")
    for k in range(2010):
        now = 1e-3 * k
        out.write("x", 1_000_000 * k, b"\\0\\1\\0\\0" + np.float64(k).tobytes())
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_live_recording_loses_a_second_at_most(tmp_path: Path) -> None:
    """Use a simulated clock with a millisecond per message, and kill the process after the second flush."""
    killed = subprocess.run([sys.executable, "-c", _KILLED, str(tmp_path / "b")], env=os.environ)
    assert killed.returncode == -signal.SIGKILL
    opened = open_bag(tmp_path / "b")
    assert opened.truncated
    assert any("cut off" in notice for notice in opened.notices)
    samples = opened.read_angles("x")
    np.testing.assert_array_equal(samples.angles_rad, np.arange(len(samples)))
    assert len(samples) > 2000


def test_a_live_recording_is_completed_after_an_exception(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), BagWriter(tmp_path / "b", live=True) as out:
        out.write_floats("x", np.array([1]), np.array([0.5]))
        raise ZeroDivisionError
    opened = open_bag(tmp_path / "b")
    assert not opened.truncated
    assert opened.topics["/x"].count == 1


@pytest.mark.parametrize("noticed", ["flush", "split", "close"])
def test_a_live_recording_that_another_overwrites_says_so_and_leaves_it_alone(tmp_path: Path, noticed: str) -> None:
    path = tmp_path / "bag"
    first = BagWriter(path, live=True)
    first.add_topic("t", "std_msgs/msg/Float64")
    first.write("t", 1, bytes(12))
    first.flush()
    with BagWriter(path, live=True, overwrite=True) as second:
        second.add_topic("t", "std_msgs/msg/Float64")
        for stamp in (2, 3):
            second.write("t", stamp, bytes(12))
        first.write("t", 4, bytes(12))
        with pytest.raises(FileNotFoundError, match="overwritten by another recording while it was recorded"):
            getattr(first, noticed)()
        second.flush()
        with pytest.raises(OutputError), first:
            pass
        assert [file.name for file in path.iterdir()] == ["bag_0.mcap"]
    assert open_bag(path).message_count == 2


def test_a_split_recording_is_one_recording(tmp_path: Path) -> None:
    """Split by size and by time: we and another reader get the same messages, with none lost between files."""
    count, words = 3000, np.random.default_rng(5).bytes(3000 * 40)
    with BagWriter(tmp_path / "b", live=True, split_bytes=20_000, split_s=2.0) as out:
        out.add_topic("words", "std_msgs/msg/String")
        out.add_topic("x", "std_msgs/msg/Float64")
        for k in range(count):
            text = words[40 * k : 40 * k + 40].hex().encode()
            raw = b"\x00\x01\x00\x00" + (len(text) + 1).to_bytes(4, "little") + text + b"\x00"
            out.write("words", EPOCH + k * 2_000_000, raw)
            if k % 100 == 0:
                out.flush()
        assert out.counts == {"/words": count, "/x": 0}
    files = sorted((tmp_path / "b").glob("*.mcap"))
    assert len(files) > 5
    bag = open_bag(tmp_path / "b")
    times = [time for _, time, _ in bag.raw_messages()]
    assert times == [EPOCH + k * 2_000_000 for k in range(count)]
    assert not bag.notices and bag.topics["/x"].count == 0
    with AnyReader([tmp_path / "b"]) as reader:
        assert reader.message_count == count
        assert [time for _, time, _ in reader.messages()] == times
    for file in files:
        assert open_bag(file).topics["/words"].msgtype == "std_msgs/msg/String"
    (tmp_path / "b" / "metadata.yaml").unlink()  # as after a kill, with so many files that names do not sort by number
    assert [time for _, time, _ in open_bag(tmp_path / "b").raw_messages()] == times


def test_a_recording_splits_by_time_and_forgets_its_oldest_file(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b", live=True, split_s=1.0) as out:
        out.add_topic("x", "std_msgs/msg/Float64")
        for k in range(35):
            out.write("x", EPOCH + k * 100_000_000, b"\x00\x01\x00\x00" + bytes(8))
        before = out.bytes_kept
        assert out.drop_oldest_file() and out.drop_oldest_file()
        assert out.bytes_kept < before and out.counts == {"/x": 15}
    bag = open_bag(tmp_path / "b")
    assert (bag.message_count, bag.start_ns) == (15, EPOCH + 2_000_000_000)
    assert sorted(path.name for path in (tmp_path / "b").iterdir()) == ["b_2.mcap", "b_3.mcap", "metadata.yaml"]


def test_a_disk_that_is_full_at_the_end_leaves_no_half_metadata(tmp_path: Path) -> None:
    """Leave room for each file but not for their list: the recording is read without it."""
    path, count = tmp_path / "bag", 60
    with ExitStack() as stack, pytest.raises(OutputError), BagWriter(path, live=True, split_bytes=1) as out:
        out.add_topic("words", "std_msgs/msg/String")
        for number in range(count):
            out.write("words", EPOCH + number, encode_string("so"))
            out.flush()
        room = max(file.stat().st_size for file in path.iterdir()) + 1000
        stack.enter_context(full_disk(room))
    assert not [file for file in path.iterdir() if file.suffix != ".mcap"]
    assert open_bag(path).topics["/words"].count == count


def test_a_single_file_cannot_be_split(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b.mcap") as out, pytest.raises(RecordingError, match="a single file cannot be split"):
        out.split()


def test_a_single_file_grows_beyond_where_a_folder_begins_the_next_file(tmp_path: Path) -> None:
    """As record_node sets both limits whatever it writes."""
    with BagWriter(tmp_path / "b.mcap", live=True, split_bytes=1000, split_s=60.0) as out:
        out.add_topic("words", "std_msgs/msg/String")
        for minute in range(100):
            out.write("words", minute * 60_000_000_000, b"\x00\x01\x00\x00\x01\x00\x00\x00\x00")
            out.flush()
    assert open_bag(tmp_path / "b.mcap").message_count == 100
