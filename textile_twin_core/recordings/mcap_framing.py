"""Records of an MCAP file in sequence, resuming after ranges in which records cannot be separated."""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Container, Iterator

from mcap.opcode import Opcode

from textile_twin_core.recordings.mcap_parts import LEAST_MESSAGE

MAGIC = b"\x89MCAP0\r\n"
CHUNK_HEAD_BYTES = 40
"""Size of a chunk without the name of its compression and its records."""
_HEAD = struct.Struct("<BQ")
_COMPRESSIONS = (b"", b"zstd", b"lz4")
_KNOWN = frozenset(int(opcode) for opcode in Opcode)
_PRIVATE = 0x80
_FOOTER_LENGTH, _DATA_END_LENGTH = 20, 4
_CHAIN = 4
"""Number of consecutive valid messages outside chunks that confirm a position, since they have no marker."""

# Records shorter than 2**40 bytes; lookahead, since the true record may start within the checked bytes.
_ANY_CHUNK = re.compile(rb"(?s)\x06(?=.{5}\0\0\0)")
_STRUCTURE = re.compile(rb"(?s)[\x02\x06\x07\x0f](?=.{5}\0\0\0)")
_LOOSE = re.compile(rb"(?s)[\x02\x05\x0f](?=.{5}\0\0\0)")


def walk(buffer: mmap.mmap | bytes, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Iterate over records between start and end: (opcode, position, end), without an incomplete last one."""
    unpack = _HEAD.unpack_from
    while start + 9 <= end:
        opcode, length = unpack(buffer, start)
        after = start + 9 + length
        if after > end:
            return
        yield opcode, start, after
        start = after


class Framing:
    """Iterator over the records of a file, (opcode, position, end) each, without an incomplete last one.

    Where the head of a record is invalid, the next valid record is searched for. `lost` lists the ranges in between,
    start and end, up to the end of the file if no record follows.

    Args:
        file: The file.
        channels: Channels declared so far, which identify messages outside chunks.
    """

    def __init__(self, file: mmap.mmap, channels: Container[int]) -> None:
        self._file, self._size, self._channels = file, len(file), channels
        self._chunked: bool | None = None
        """True if the file has chunks; None until a chunk or a search decides it."""
        self._waiting = -1
        """Channel of a pending record that is not declared yet."""
        self.lost: list[tuple[int, int]] = []

    def __iter__(self) -> Iterator[tuple[int, int, int]]:
        at = len(MAGIC)
        pending: tuple[int, int, int] | None = None  # its length may be wrong: yield it once the next record is valid
        while at + 9 <= self._size:
            opcode, after = self._head(at)
            if after is not None:
                if pending is not None:
                    yield pending
                pending, at = (opcode, at, after), after
                if opcode == Opcode.CHUNK:
                    self._chunked = True
                if opcode == Opcode.FOOTER:
                    break
                continue
            if pending is not None and pending[0] == Opcode.CHANNEL and pending[2] - pending[1] >= 11:
                (self._waiting,) = struct.unpack_from("<H", self._file, pending[1] + 9)
            found = self._search(at if pending is None else pending[1] + 9)
            if pending is not None and (found is None or found >= at):
                yield pending
            elif pending is not None:
                at = pending[1]
            self.lost.append((at, self._size if found is None else found))
            if found is None:
                return
            pending, at = None, found
        if pending is not None:
            yield pending

    def _head(self, at: int) -> tuple[int, int | None]:
        """Return opcode and end of the record at a position; for an invalid record the end is None."""
        opcode, length = _HEAD.unpack_from(self._file, at)
        after: int = at + 9 + length
        if opcode == Opcode.CHUNK:
            return opcode, self._end_of_chunk(at, after)
        if after > self._size or (opcode not in _KNOWN and opcode < _PRIVATE):
            return opcode, None
        if opcode == Opcode.FOOTER:  # the last record
            last = self._size - after <= len(MAGIC) or self._file[after : after + len(MAGIC)] == MAGIC
            return opcode, after if length == _FOOTER_LENGTH and last else None
        return opcode, after

    def _end_of_chunk(self, at: int, after: int) -> int | None:
        """Return the end of a chunk, which states its length twice; if the two differ, the one followed by a
        record counts.
        """
        if at + 9 + CHUNK_HEAD_BYTES > self._size:
            return None
        by_records = self._end_by_records(at)
        ends = [end for end in (after, by_records) if at + 9 + CHUNK_HEAD_BYTES <= end <= self._size]
        if after == by_records or not ends:
            return ends[0] if ends else None
        return next((end for end in ends if self._follows(end)), None)

    def _end_by_records(self, at: int) -> int:
        """Return the end of the chunk by the length of its records; -1 if its compression is unknown."""
        (length,) = struct.unpack_from("<I", self._file, at + 37)
        name = self._file[at + 41 : at + 41 + min(length, 8)]
        if name not in _COMPRESSIONS or length != len(name) or at + 49 + length > self._size:
            return -1
        (records,) = struct.unpack_from("<Q", self._file, at + 41 + length)
        end: int = at + 49 + length + records
        return end

    def _follows(self, at: int) -> bool:
        """Return true if a known record may begin at a position."""
        if at + 9 > self._size:
            return False
        opcode, length = _HEAD.unpack_from(self._file, at)
        return opcode in _KNOWN and at + 9 + length <= self._size

    def _search(self, at: int) -> int | None:
        """Find the next certain record; None without one.

        Unchunked messages count as records only in files without chunks, since messages of a lost chunk are no longer
        protected by its checksum.
        """
        if self._chunked is None:
            self._chunked = self._find(_ANY_CHUNK, at) is not None
        return self._find(_STRUCTURE if self._chunked else _LOOSE, at)

    def _find(self, pattern: re.Pattern[bytes], at: int) -> int | None:
        return next((match.start() for match in pattern.finditer(self._file, at) if self._stands(match.start())), None)

    def _stands(self, at: int) -> bool:
        if at + 9 > self._size:
            return False
        opcode, length = _HEAD.unpack_from(self._file, at)
        after = at + 9 + length
        if after > self._size:
            return False
        if opcode == Opcode.CHUNK:
            return bool(length >= CHUNK_HEAD_BYTES and self._end_by_records(at) == after)
        if opcode == Opcode.MESSAGE_INDEX:
            if length < 6 or (length - 6) % 16:
                return False
            (stated,) = struct.unpack_from("<I", self._file, at + 11)
            return bool(stated == length - 6 and self._follows(after))
        if opcode == Opcode.MESSAGE:
            return self._chain(at)
        if opcode == Opcode.FOOTER:
            return bool(length == _FOOTER_LENGTH and self._file[after : after + len(MAGIC)] == MAGIC)
        return bool(length == _DATA_END_LENGTH and self._follows(after))

    def _chain(self, at: int) -> bool:
        """Return true if consecutive messages of declared channels start at a position."""
        for _ in range(_CHAIN):
            if at == self._size or (at + 9 <= self._size and self._file[at] in (Opcode.DATA_END, Opcode.FOOTER)):
                return True
            if at + 9 + LEAST_MESSAGE > self._size:
                return False
            opcode, length, channel = struct.unpack_from("<BQH", self._file, at)
            if opcode != Opcode.MESSAGE or length < LEAST_MESSAGE:
                return False
            if channel not in self._channels and channel != self._waiting:
                return False
            at += 9 + length
        return bool(at <= self._size)
