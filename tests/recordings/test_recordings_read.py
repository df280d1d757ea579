"""open_bag on recordings by other writers: complete, truncated, damaged and invalid ones."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.prediction import far_apart
from textile_twin_core.recordings.schemas import message_schema

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
EPOCH = 1_700_000_000_000_000_000


def _header(stamp: int, frame: str) -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def _joint_state(stamp: int, names: list[str], positions: list[float], frame: str = "") -> bytes:
    message = STORE.types[JOINT_STATE](
        header=_header(stamp, frame),
        name=names,
        position=np.array(positions),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )
    return bytes(STORE.serialize_cdr(message, JOINT_STATE))


def _wrench(stamp: int, torque: float) -> bytes:
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    wrench = STORE.types["geometry_msgs/msg/Wrench"](force=vector(1.0, 2.0, 3.0), torque=vector(4.0, 5.0, torque))
    return bytes(STORE.serialize_cdr(STORE.types[WRENCH](header=_header(stamp, "shaft"), wrench=wrench), WRENCH))


def _messages(count: int, mixed: bool) -> list[tuple[str, int, bytes]]:
    """Return angles and torques alternately; `mixed` changes the layout of the JointStates all the time."""
    out = []
    for k in range(count):
        stamp = EPOCH + k * 2_000_000
        names, positions = ["main_shaft"], [k * 0.03]
        if mixed:
            extra = [f"joint_{j}" for j in range(k % 23)]
            names, positions = extra + names, [9.0] * len(extra) + positions
        out.append(
            (
                "/main_shaft/angle",
                stamp,
                _joint_state(stamp, names, positions, "f" * (k % 3) if mixed else ""),
            )
        )
        out.append(("/balancing_torque/measured", stamp, _wrench(stamp, np.sin(k * 0.03))))
    return out


def _check(path: Path, count: int) -> None:
    opened = open_bag(path)
    angles = opened.read_angles()
    np.testing.assert_array_equal(angles.stamps, EPOCH + np.arange(count) * 2_000_000)
    np.testing.assert_array_equal(angles.angles_rad, np.arange(count) * 0.03)
    assert angles.velocities is None
    np.testing.assert_array_equal(opened.read_torques().torque_Nm, [np.sin(k * 0.03) for k in range(count)])
    assert opened.message_count == 2 * count == sum(1 for _ in opened.raw_messages())


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize(
    ("plugin", "compression"),
    [
        (StoragePlugin.MCAP, None),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, None),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_bags_of_the_rosbags_library(
    tmp_path: Path, plugin: StoragePlugin, compression: CompressionMode | None, mixed: bool
) -> None:
    writer = RosbagsWriter(tmp_path / "b", version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        topics = {
            "/main_shaft/angle": writer.add_connection("/main_shaft/angle", JOINT_STATE, typestore=STORE),
            "/balancing_torque/measured": writer.add_connection("/balancing_torque/measured", WRENCH, typestore=STORE),
        }
        for topic, time, cdr in _messages(2000, mixed):
            writer.write(topics[topic], time, cdr)
    _check(tmp_path / "b", 2000)


_MCAP_FORMS: dict[str, dict[str, Any]] = {
    "zstd": {"chunk_size": 20_000},
    "lz4": {"compression": CompressionType.LZ4},
    "unchunked": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE, "chunk_size": 20_000},
    "no summary": {
        "repeat_channels": False, "repeat_schemas": False, "use_statistics": False,
        "use_summary_offsets": False, "index_types": IndexType.NONE,
    },
    "indexed, channels in the chunks alone": {"repeat_channels": False, "repeat_schemas": False},
}  # fmt: skip


def _mcap(path: Path, form: str, count: int, finish: bool = True) -> None:
    with path.open("wb") as file:
        writer = Writer(file, **_MCAP_FORMS[form])
        writer.start("ros2", "test")
        channels = {}
        for topic, msgtype in (("/main_shaft/angle", JOINT_STATE), ("/balancing_torque/measured", WRENCH)):
            # The schema twice, as written by recorders that split files.
            for _ in range(2):
                schema = writer.register_schema(msgtype, "ros2msg", message_schema(msgtype).text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, time, cdr in _messages(count, mixed=False):
            writer.add_message(channels[topic], time, cdr, time)
        if finish:
            writer.finish()


@pytest.mark.parametrize("form", _MCAP_FORMS)
def test_single_files_of_the_mcap_library(tmp_path: Path, form: str) -> None:
    _mcap(tmp_path / "one.mcap", form, 1500)
    _check(tmp_path / "one.mcap", 1500)
    assert not open_bag(tmp_path / "one.mcap").truncated


def test_a_bag_of_several_files_is_one_recording(tmp_path: Path) -> None:
    folder = tmp_path / "b"
    folder.mkdir()
    _mcap(folder / "b_0.mcap", "zstd", 100)
    _mcap(folder / "b_1.mcap", "unchunked", 200)
    opened = open_bag(folder)
    assert len(opened.read_angles()) == 300
    assert opened.topics["/main_shaft/angle"].count == 300


@pytest.mark.parametrize("form", ["zstd", "unchunked", "no summary"])
def test_every_cut_leaves_the_messages_before_it(tmp_path: Path, form: str) -> None:
    _mcap(tmp_path / "whole.mcap", form, 400)
    data = (tmp_path / "whole.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    lengths = []
    rng = np.random.default_rng(3)
    for size in [*sorted(rng.integers(3000, len(data), 40)), len(data) - 1]:
        cut.write_bytes(data[:size])
        opened = open_bag(cut)
        assert opened.truncated
        if not opened.has_topic("main_shaft/angle"):
            continue
        angles = opened.read_angles()
        np.testing.assert_array_equal(angles.angles_rad, np.arange(len(angles)) * 0.03)
        lengths.append(len(angles))
    assert lengths == sorted(lengths)
    assert lengths[-1] == 400


def test_a_damaged_chunk_is_named(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    with BagWriter(path) as out:
        out.write_floats("x", np.arange(1, 5001), np.random.default_rng(0).normal(size=5000))
    data = bytearray(path.read_bytes())
    data[20_000:20_050] = bytes(50)
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="damaged"):
        open_bag(path).read_angles("x")


def test_topics_are_found_by_the_end_of_their_name(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b") as out:
        for topic in ("/mill/loom_1/angle", "/mill/loom_2/angle", "/mill/loom_2/torque"):
            out.write_floats(topic, np.array([1]), np.array([1.0]))
    opened = open_bag(tmp_path / "b")
    assert opened.find_topic("torque").name == "/mill/loom_2/torque"
    assert opened.find_topic("loom_1/angle").name == "/mill/loom_1/angle"
    with pytest.raises(RecordingError, match=r"more than once: /mill/loom_1/angle, /mill/loom_2/angle"):
        opened.find_topic("angle")
    with pytest.raises(RecordingError, match=r"topics there: /mill/loom_1/angle \(std_msgs/msg/Float64, 1\)"):
        opened.find_topic("gle")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"theta_rad,omega_rad_s\n1,2\n", "not a bag"),
        (b"#ROSBAG V2.0\n", "ROS 1"),
        (b"SQLite format 3\0", "damaged, or no SQLite file of rosbag2"),
        (b"\x89MCAP0\r\n", "the bag is empty"),
    ],
)
def test_what_is_no_bag_is_said_in_one_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "f.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=says) as caught:
        open_bag(path).read_angles()
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_folders_that_are_no_bag(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        open_bag(tmp_path / "nowhere")
    with pytest.raises(RecordingError, match="not a bag"):
        open_bag(tmp_path)
    (tmp_path / "metadata.yaml").write_text("something: else\n")
    with pytest.raises(RecordingError, match="no metadata of rosbag2"):
        open_bag(tmp_path)


def test_wrong_type_and_missing_joint_list_the_available_ones(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b") as out:
        out.write_wrenches("main_shaft/angle", np.array([5]), np.array([1.0]))
        out.write_joint_states("shaft", np.array([5]), ["axis", "motor"], np.array([[1.0, 2.0]]))
        out.add_topic("silent", "std_msgs/msg/Float64")
    opened = open_bag(tmp_path / "b")
    with pytest.raises(RecordingError, match=r"/main_shaft/angle is geometry_msgs/msg/WrenchStamped"):
        opened.read_angles()
    with pytest.raises(RecordingError, match=r"joint 'main_shaft'; joints there: axis, motor"):
        opened.read_angles("shaft")
    with pytest.raises(RecordingError, match=r"/silent has no message"):
        opened.read_angles("silent")
    assert opened.read_angles("shaft", joint="motor").angles_rad.tolist() == [2.0]
    with pytest.raises(RecordingError, match="no effort of joint 'motor'"):
        opened.read_torques("shaft", joint="motor")


def test_raw_messages_of_overlapping_chunks_come_in_order_of_time(tmp_path: Path) -> None:
    """Write two chunks of one topic with different recording delays, and another topic between them."""
    with BagWriter(tmp_path / "b") as out:
        times = np.arange(1, 40_001)
        out.write_floats("x", times + np.random.default_rng(1).integers(0, 500, len(times)), times * 1.0)
        out.write_floats("y", times, times * 1.0)
    opened = open_bag(tmp_path / "b")
    assert len(list(opened.blocks("x"))) > 1
    seen = [(time, topic) for topic, time, _ in opened.raw_messages()]
    assert len(seen) == 80_000
    assert [time for time, _ in seen] == sorted(time for time, _ in seen)


def test_nan_is_preserved(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b") as out:
        out.write_joint_states("main_shaft/angle", np.arange(1, 4), ["main_shaft"], np.array([1.0, np.nan, np.inf]))
    np.testing.assert_array_equal(open_bag(tmp_path / "b").read_angles().angles_rad, [1.0, np.nan, np.inf])


def test_an_infinite_speed_is_discarded(tmp_path: Path) -> None:
    speeds = np.array([2.0, np.inf, -np.inf, 3.0])
    with BagWriter(tmp_path / "b") as out:
        out.write_joint_states("main_shaft/angle", np.arange(1, 5), ["main_shaft"], np.arange(4.0), speeds)
    np.testing.assert_array_equal(open_bag(tmp_path / "b").read_angles().velocities, [2.0, np.nan, np.nan, 3.0])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("custom_data", [1]),
        ("custom_data", "mine"),
        ("relative_file_paths", 5),
        ("relative_file_paths", "b.mcap"),
        ("files", "b.db3"),
        ("message_count", None),
        ("duration", {"nanoseconds": "long"}),
    ],
)
@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_metadata_of_other_shape(tmp_path: Path, plugin: StoragePlugin, key: str, value: object) -> None:
    """Check that it is read anyway, or refused in one line."""
    metadata = _bag_of_rosbags(tmp_path / "b", plugin) / "metadata.yaml"
    information = yaml.safe_load(metadata.read_text())
    information["rosbag2_bagfile_information"][key] = value
    metadata.write_text(yaml.dump(information))
    try:
        count = sum(1 for _ in open_bag(tmp_path / "b").raw_messages())
        assert count == 20
    except RecordingError as error:
        assert str(tmp_path / "b") in str(error) and "\n" not in str(error)


def test_metadata_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "b" / "metadata.yaml").mkdir(parents=True)
    with pytest.raises(RecordingError, match=r"metadata.yaml: cannot be read \(Is a directory\)"):
        open_bag(tmp_path / "b")


@pytest.mark.parametrize(
    ("plugin", "compression"),
    [
        (StoragePlugin.SQLITE3, None),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    ],
)
def test_damage_in_other_storage_is_one_line(
    tmp_path: Path, plugin: StoragePlugin, compression: CompressionMode | None
) -> None:
    (file,) = _bag_of_rosbags(tmp_path / "b", plugin, compression, count=200).glob("b.*")
    whole, random = file.read_bytes(), np.random.default_rng(7)
    refused = 0
    for _ in range(30):
        spoilt = bytearray(whole)
        for place in random.integers(0, len(whole), 20):
            spoilt[place] = random.integers(0, 256)
        file.write_bytes(spoilt)
        try:
            assert sum(1 for _ in open_bag(tmp_path / "b").raw_messages()) <= 400
        except RecordingError as error:
            refused += 1
            assert str(error).startswith(f"{tmp_path / 'b'}")
    assert refused


def test_an_sqlite_recording_whose_path_means_something_in_a_uri(tmp_path: Path) -> None:
    _bag_of_rosbags(tmp_path / "b", StoragePlugin.SQLITE3)
    folder = (tmp_path / "b").rename(tmp_path / "loom #3?%20")
    assert len(open_bag(folder).read_angles()) == 10


def _bag_of_rosbags(
    path: Path, plugin: StoragePlugin, compression: CompressionMode | None = None, count: int = 10
) -> Path:
    writer = RosbagsWriter(path, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        types = {"/main_shaft/angle": JOINT_STATE, "/balancing_torque/measured": WRENCH}
        topics = {topic: writer.add_connection(topic, name, typestore=STORE) for topic, name in types.items()}
        for topic, stamp, raw in _messages(count, mixed=False):
            writer.write(topics[topic], stamp, raw)
    return path


@pytest.mark.parametrize(
    ("recorded", "settled", "warned"),
    [
        ([1.0, 2.0, 3.0], [True] * 3, False),
        ([1.0, 2.0, 9.0], [True] * 3, False),  # a step of the load
        ([2.0, 3.0, 4.0], [True] * 3, True),
        ([2.0, 3.0, 4.0], [False] * 3, False),
        ([math.nan] * 3, [True] * 3, False),
    ],
)
def test_predictions_of_another_machine_differ_in_most_samples(
    recorded: list[float], settled: list[bool], warned: bool
) -> None:
    assert bool(far_apart(np.array(recorded), np.array([1.0, 2.0, 3.0]), np.array(settled))) == warned
