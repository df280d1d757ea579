"""Folders of recordings, and the removal of the oldest."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter
from textile_twin_ros.recording_path import RecordingPath


def write(path: Path, count: int = 1000) -> BagWriter:
    writer = BagWriter(path, live=True, split_bytes=2_000)
    writer.add_topic("x", "std_msgs/msg/Float64")
    for k in range(count):
        writer.write("x", 10**18 + k, b"\x00\x01\x00\x00" + k.to_bytes(8, "little"))
        if k % 50 == 0:
            writer.flush()
    return writer


def test_names_by_number_and_by_time(tmp_path: Path) -> None:
    place = RecordingPath(str(tmp_path / "run"), "", "/")
    assert [place.take_next().name for _ in range(3)] == ["run", "run_2", "run_3"]
    places = [RecordingPath("", str(tmp_path / "all"), "/mill/m7") for _ in range(20)]
    names = [place.take_next().name for place in places]
    assert len(set(names)) == 20 and all("_mill_m7" in name for name in names)
    with pytest.raises(RecordingError, match="'bag' is not set"):
        RecordingPath("", "", "/")
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(RecordingError, match="cannot be made"):
        RecordingPath("", str(tmp_path / "file"), "/").take_next()


def test_the_oldest_go_first(tmp_path: Path) -> None:
    """Three of this machine, one of another, one without metadata.yaml, and a folder that is no recording."""
    for name in ("2026-01-01_00-00-00_m3", "2026-01-02_00-00-00_m3", "2026-01-03_00-00-00_m3_2", "2026-01-01_00-00-00"):
        write(tmp_path / name).close()
    (tmp_path / "2026-01-01_00-00-01_m3").mkdir()
    (tmp_path / "2026-01-01_00-00-02_m3 notes").mkdir()
    place = RecordingPath("", str(tmp_path), "/m3")
    current = write(place.take_next())
    size = current.bytes_kept
    place.retain(current, most_bytes=int(2.6 * size))
    left = {path.name for path in tmp_path.iterdir()} - {current.path.name}
    assert left == {
        "2026-01-03_00-00-00_m3_2",
        "2026-01-01_00-00-00",
        "2026-01-01_00-00-01_m3",
        "2026-01-01_00-00-02_m3 notes",
    }
    place.retain(current, most_bytes=size // 2)
    assert "2026-01-03_00-00-00_m3_2" not in {path.name for path in tmp_path.iterdir()}
    assert 0 < current.bytes_kept <= size // 2
    current.close()


def test_what_cannot_be_removed_is_reported_and_the_others_go(tmp_path: Path) -> None:
    for day in (1, 2):
        write(tmp_path / f"2026-01-0{day}_00-00-00").close()
    stuck = tmp_path / "2026-01-02_00-00-00"
    (stuck / "somebody's.mcap").mkdir()  # a folder is not removed as a file is
    place = RecordingPath("", str(tmp_path), "/")
    current = write(place.take_next())
    (report,) = place.retain(current, most_bytes=1)
    assert report.startswith(f"{stuck}: cannot be removed")
    assert {path for path in tmp_path.iterdir()} == {stuck, current.path}
    current.close()
