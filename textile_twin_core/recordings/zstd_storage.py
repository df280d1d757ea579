"""Recordings compressed by zstd, as whole files or message by message, recognised by their first bytes."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from textile_twin_core.errors import RecordingError, how_to_install
from textile_twin_core.recordings.cdr_decode import MessageBlock

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
SUFFIXES = (".zstd", ".zst")
"""File suffixes of rosbag2 compression and of the command `zstd`."""


def opened(path: Path) -> tuple[BinaryIO, bytes]:
    """Open a file, or a temporary file with the content of a zstd file; return it with its first bytes.

    A truncated file gives the content before the cut.

    Raises:
        RecordingError: The file is damaged.
    """
    file = path.open("rb")
    head = file.read(16)
    file.seek(0)
    if not head.startswith(ZSTD_MAGIC):
        return file, head
    unpacked = tempfile.TemporaryFile()  # noqa: SIM115
    try:
        import zstandard
    except ImportError as error:
        raise RecordingError(
            f"{path}: compressed by zstd; {how_to_install('zstandard')}, or unpack it: zstd -d"
        ) from error
    try:
        with file:
            zstandard.ZstdDecompressor().copy_stream(file, unpacked)
    except zstandard.ZstdError as error:
        unpacked.close()
        raise RecordingError(
            f"{path}: damaged: zstd cannot unpack it ({error}); copy it again from where it was recorded"
        ) from error
    unpacked.seek(0)
    head = unpacked.read(16)
    unpacked.seek(0)
    return unpacked, head


def plain_messages(block: MessageBlock, path: Path) -> MessageBlock:
    """Decompress messages that were compressed one by one, and return others unchanged; CDR never starts like zstd.

    Raises:
        RecordingError: A message cannot be decompressed.
    """
    if not len(block) or not block.message(0).startswith(ZSTD_MAGIC):
        return block
    try:
        import zstandard
    except ImportError as error:
        raise RecordingError(f"{path}: messages are compressed by zstd; {how_to_install('zstandard')}") from error
    unpack = zstandard.ZstdDecompressor()
    try:
        data = [unpack.decompress(block.message(k), max_output_size=_MOST_BYTES) for k in range(len(block))]
    except zstandard.ZstdError as error:
        raise RecordingError(f"{path}: messages are compressed with zstd, and one is damaged ({error})") from error
    return replace(packed(block.log_times_ns.tolist(), data), publish_times_ns=block.publish_times_ns)


_MOST_BYTES = 1 << 26
"""Size limit of a message that does not state its size."""


def packed(times_ns: list[int], data: list[bytes]) -> MessageBlock:
    """Build a block of single messages from log times and CDR bytes."""
    sizes = np.array([len(cdr) for cdr in data], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    return MessageBlock(np.frombuffer(b"".join(data), np.uint8), starts, sizes, np.array(times_ns, np.int64))
