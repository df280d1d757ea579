"""Recordings damaged at random or truncated anywhere: the original messages are read, or an error in one line is given.

`python -m tests.benchmarks.spoilt_recordings` repeats this ten thousand times.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.recordings import mutations
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings import open_bag


@pytest.mark.slow
def test_spoilt_recordings_are_read_or_refused(tmp_path: Path) -> None:
    judges = mutations.run(tmp_path, count=120, seed=20)
    for name, judge in judges.items():
        assert judge.outcomes.total() == 40
        assert min(judge.outcomes.values()) >= 2, (name, judge.outcomes)
        assert judge.salvaged >= judge.outcomes["refused in a line"] // 2, (name, judge.salvaged, judge.outcomes)


def test_a_recording_cut_anywhere_gives_all_that_stands_before(tmp_path: Path) -> None:
    assert mutations.cut_everywhere(tmp_path, offsets=100, seed=3) > 100


@pytest.mark.parametrize("length", [2**63 - 1, 2**63, 2**64 - 1, 2**31, 0])
def test_a_length_beyond_the_file(tmp_path: Path, length: int) -> None:
    """Damage a message in a chunk without checksum, so that its length exceeds any file."""
    whole = mutations.chunked(tmp_path / "whole.mcap")
    path = mutations.by_library(tmp_path / "bag.mcap", whole, crcs=False)
    data = bytearray(path.read_bytes())
    first_chunk = next(start for start in mutations.record_starts(bytes(data)) if data[start] == mutations.CHUNK)
    messages = data.index(b"\x05", first_chunk + 9 + 40)
    data[messages + 1 : messages + 9] = length.to_bytes(8, "little")
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"the chunk at byte \d+ is damaged: \d+ of its \d+ messages are found"):
        sum(1 for _ in open_bag(path).raw_messages())


def test_a_chunk_that_is_no_chunk_any_more_is_missed(tmp_path: Path) -> None:
    path = mutations.chunked(tmp_path / "bag.mcap")
    data = bytearray(path.read_bytes())
    chunks = [start for start in mutations.record_starts(bytes(data)) if data[start] == mutations.CHUNK]
    data[chunks[1]] = 0x99
    path.write_bytes(data)
    (notice,) = open_bag(path).notices
    assert notice == f"{path}: damaged: 700 of 800 messages are found"
    assert open_bag(path).read_angles().stamps.size == np.unique(open_bag(path).read_angles().stamps).size
