"""Recordings with damaged chunks: the intact messages are recovered, and one line reports the loss."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path
from random import Random

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType

from tests.campaign import more
from tests.recordings import mutations
from textile_twin_core.cli.main import main
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import BagWriter, open_bag

_Message = tuple[str, int, bytes]
_FORMS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}


def _library_file(path: Path, form: str, crcs: bool = True, indices: bool = True) -> Path:
    """Write 800 messages of two topics in about twelve chunks, by the mcap library."""
    whole = mutations.chunked(path.with_name("source.mcap"))
    return mutations.by_library(path, whole, _FORMS[form], 4096, crcs, indices)


def _chunks(data: bytes) -> list[tuple[int, int]]:
    """Return start and end of each chunk."""
    starts = [start for start in mutations.record_starts(data) if data[start] == mutations.CHUNK]
    return [(start, start + 9 + int(struct.unpack_from("<Q", data, start + 1)[0])) for start in starts]


def _by_library(path: Path) -> list[_Message]:
    """Read all messages by the mcap library, with checksums verified."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]


def _of_chunk(path: Path, data: bytes, chunk: tuple[int, int]) -> Counter[_Message]:
    """Return the messages of one chunk, by its time span; chunks of the library's files do not overlap."""
    first, last = struct.unpack_from("<QQ", data, chunk[0] + 9)
    return Counter(message for message in _by_library(path) if first <= message[1] <= last)


def _recover(bag: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> tuple[list[_Message], list[str]]:
    """Return the messages of the recovered file as read by the library, and the output of recover."""
    assert main(["recover", str(bag), "--out", str(out), "--force"]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("textile-twin:")]
    return _by_library(out), lines


@pytest.mark.parametrize("form", list(_FORMS))
@pytest.mark.parametrize("which", [0, 3, -1])
def test_recover_leaves_out_the_damaged_chunk_alone(
    tmp_path: Path, form: str, which: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = _library_file(tmp_path / "bag.mcap", form)
    data = bytearray(path.read_bytes())
    chunk = _chunks(bytes(data))[which]
    expected = Counter(_by_library(path)) - _of_chunk(path, bytes(data), chunk)
    data[(chunk[0] + chunk[1]) // 2] ^= 0x10
    path.write_bytes(data)
    found, (line,) = _recover(path, tmp_path / "out.mcap", capsys)
    assert Counter(found) == expected and 500 < len(found) < 800
    assert f"{path}: damaged: a chunk at byte {chunk[0]} ({chunk[1] - chunk[0]} bytes" in line
    assert "s after the first message" in line and line.endswith(f"{len(found)} of 800 messages are found")


def test_every_chunk_but_one_is_damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = _library_file(tmp_path / "bag.mcap", "zstd")
    data = bytearray(path.read_bytes())
    chunks = _chunks(bytes(data))
    expected = _of_chunk(path, bytes(data), chunks[5])
    for start, end in (chunk for number, chunk in enumerate(chunks) if number != 5):
        data[(start + end) // 2 : (start + end) // 2 + 20] = bytes(20)
    path.write_bytes(data)
    found, (line,) = _recover(path, tmp_path / "out.mcap", capsys)
    assert Counter(found) == expected
    assert f"{len(chunks) - 1} chunks at byte {chunks[0][0]} and after it" in line


@pytest.mark.parametrize("form", ["zstd", "none"])
@pytest.mark.parametrize("length", [0, 20, 10**6, 2**40, 2**64 - 1, None])
def test_of_a_record_whose_length_is_wrong_all_before_it_is_recovered(
    tmp_path: Path, form: str, length: int | None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Damage the length of a chunk, or (None) overwrite its head by nine zeros."""
    path = _library_file(tmp_path / "bag.mcap", form)
    data = bytearray(path.read_bytes())
    chunks, whole = _chunks(bytes(data)), Counter(_by_library(path))
    before = sum((_of_chunk(path, bytes(data), chunk) for chunk in chunks[:4]), Counter[_Message]())
    at = chunks[4][0]
    data[at : at + 9] = bytes(9) if length is None else b"\x06" + length.to_bytes(8, "little")
    path.write_bytes(data)
    found, (line,) = _recover(path, tmp_path / "out.mcap", capsys)
    assert not before - Counter(found) and not Counter(found) - whole
    assert "are no records" in line


def test_without_checksums_the_other_messages_of_the_chunk_are_recovered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = _library_file(tmp_path / "bag.mcap", "none", crcs=False)
    whole, data = Counter(_by_library(path)), bytearray(path.read_bytes())
    start, end = _chunks(bytes(data))[3]
    message = data.index(b"\x05", (start + end) // 2)
    while int.from_bytes(data[message + 1 : message + 9], "little") > 200:
        message = data.index(b"\x05", message + 1)
    data[message + 1 : message + 9] = b"\xff" * 8
    path.write_bytes(data)
    found, (line,) = _recover(path, tmp_path / "out.mcap", capsys)
    assert not Counter(found) - whole and len(found) == 799
    assert "its" in line and line.endswith("799 of 800 messages are found")


def test_other_commands_refuse_and_say_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "of a mill"
    with BagWriter(bag) as out:
        stamps = mutations.START_NS + np.arange(20_000) * 2_000_000
        out.write_joint_states(mutations.ANGLE, stamps, ["main_shaft"], np.arange(20_000) * 0.03)
        out.write_wrenches(mutations.TORQUE, stamps, np.sin(np.arange(20_000) * 0.03))
    file = next(bag.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    start, end = _chunks(bytes(data))[0]
    data[(start + end) // 2] ^= 1
    file.write_bytes(data)
    for command in (["compare"], ["replay", "--out", str(tmp_path / "out")]):
        assert main([command[0], str(bag), "--machine", "tufting", *command[1:]]) == 2
        said = capsys.readouterr().err.strip().splitlines()[-1]
        assert f"the chunk at byte {start} is damaged" in said
        assert said.endswith(f"textile-twin recover '{bag}' --out DIR recovers the intact part")
    assert main(["recover", str(bag), "--out", str(tmp_path / "whole")]) == 0
    recovered = open_bag(tmp_path / "whole")
    assert not recovered.notices and 0 < recovered.message_count < 40_000


@pytest.mark.parametrize("kind", ["chunk", "magic", "zeros", "empty"])
def test_one_bad_file_of_several_costs_no_other(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    bag, stamps = tmp_path / "bag", mutations.START_NS + np.arange(300) * 2_000_000
    with BagWriter(bag) as out:
        for part in np.array_split(np.arange(300), 3):
            out.write_joint_states(mutations.ANGLE, stamps[part], ["main_shaft"], part * 0.03)
            out.split()
    files = sorted(bag.glob("*.mcap"))
    bad = bytearray(files[1].read_bytes())
    start, end = _chunks(bytes(bad))[0]
    if kind == "chunk":
        bad[(start + end) // 2] ^= 1
    elif kind == "magic":
        bad[0] ^= 1
    else:
        bad = bytearray(len(bad) if kind == "zeros" else 0)
    files[1].write_bytes(bad)
    with pytest.raises(RecordingError, match=f"{files[1].name}: .*textile-twin recover {bag} --out DIR"):
        open_bag(bag).read_angles()
    assert main(["recover", str(bag), "--out", str(tmp_path / "whole")]) == 0
    said = capsys.readouterr().err
    times = [time for _, time, _ in open_bag(tmp_path / "whole").raw_messages()]
    if kind == "magic":
        assert times == stamps.tolist()
    else:
        assert times == stamps[:100].tolist() + stamps[200:].tolist()
        assert files[1].name in said
    (made,) = (tmp_path / "whole").glob("*.mcap")
    assert len(_by_library(made)) == len(times)


def test_the_metadata_of_a_bag_may_be_damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag) as out:
        out.write_floats("x", np.arange(1, 101), np.arange(100) * 1.0)
    (bag / "metadata.yaml").write_bytes(b"\0\xff: [")
    assert main(["recover", str(bag), "--out", str(tmp_path / "whole")]) == 0
    assert f"left out: {bag / 'metadata.yaml'}" in capsys.readouterr().err
    assert open_bag(tmp_path / "whole").message_count == 100


def test_a_split_recording_without_one_of_its_files_is_recovered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, stamps = tmp_path / "bag", np.arange(1, 301)
    with BagWriter(bag) as out:
        for part in np.array_split(stamps, 3):
            out.write_floats("x", part, part * 1.0)
            out.split()
    (bag / "bag_1.mcap").unlink()
    with pytest.raises(RecordingError, match="textile-twin recover"):
        open_bag(bag)
    assert main(["recover", str(bag), "--out", str(tmp_path / "whole")]) == 0
    assert "bag_1.mcap, which is not in the folder" in capsys.readouterr().err
    times = [time for _, time, _ in open_bag(tmp_path / "whole").raw_messages()]
    assert times == [*range(1, 101), *range(201, 301)]


def test_what_is_no_recording_is_not_recovered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bag.mcap"
    for data in (b"", b"theta_rad\n" * 1000, Random(1).randbytes(100_000), bytes(100_000)):
        path.write_bytes(data)
        assert main(["recover", str(path), "--out", str(tmp_path / "out")]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert str(path) in line
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("form", ["none", *more("zstd")])
def test_one_flipped_byte_anywhere_costs_its_chunk_or_what_follows_a_length(
    tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path, random = _library_file(tmp_path / "bag.mcap", form), Random(7)
    data, whole = path.read_bytes(), Counter(_by_library(path))
    chunks = _chunks(data)
    most = max(_of_chunk(path, data, chunk).total() for chunk in chunks)
    spoilt, first, last = tmp_path / "spoilt.mcap", chunks[0][0], chunks[-1][1]
    heads = [start + offset for start, _ in chunks for offset in range(0, 50, 11)]
    for at in heads + [random.randrange(first, last) for _ in range(12)]:
        spoilt.write_bytes(data[:at] + bytes([data[at] ^ 1 << random.randrange(8)]) + data[at + 1 :])
        found, lines = _recover(spoilt, tmp_path / "out.mcap", capsys)
        assert not Counter(found) - whole, at
        missing = (whole - Counter(found)).total()
        in_head = not any(start + 9 <= at < end for start, end in chunks)
        assert (missing <= most or in_head) and (missing == 0 or lines), (at, missing, lines)
