"""Kind of a log file by its first bytes: text in an encoding, or another kind, which is named."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from textile_twin_core.errors import RecordingError

_TO_CSV = "save its table as CSV"
_SIGNATURES = (
    (b"PK\x03\x04", "a ZIP archive, as Excel's workbooks are (.xlsx)", _TO_CSV),
    (b"\xd0\xcf\x11\xe0", "a workbook of an old Excel (.xls)", _TO_CSV),
    (b"\x1f\x8b", "compressed by gzip", "unpack it first"),
    (b"PAR1", "a Parquet file", "let its name end in .parquet"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file", "let its name end in .mat"),
    (b"\x89HDF", "an HDF5 file", "let its name end in .h5, or in .mat where MATLAB wrote it"),
    (b"TDSm", "a TDMS file of LabVIEW", "let its name end in .tdms"),
    (b"MDF ", "a measurement file (MDF)", "let its name end in .mf4"),
    (b"\x89MCAP0", "a recording already", "give it to compare, calibrate or the other commands as it is"),
    (b"SQLite format 3", "a database, as a recording's .db3 is", "give the recording's folder to the other commands"),
)
"""First bytes, kind of the file, and advice."""
_CHINESE = re.compile("时间|时刻|角度|转角|扭矩|转矩|力矩|转速|速度")
_MANY = 0.3
"""Share of zeros in one of the two bytes of each character above which text is UTF-16."""


def decoded(path: Path, begin: bytes) -> tuple[str, str]:
    """Return the text at the beginning of a file, and the encoding in which Python reads all of it.

    Args:
        path: of the file, for messages. begin: its first bytes.

    Raises RecordingError for a file that is no text.
    """
    for signature, what, then in _SIGNATURES:
        if begin.startswith(signature):
            raise RecordingError(f"{path}: is no text but {what}; {then}")
    encoding = _encoding(begin)
    text = begin.decode("cp1252" if encoding == "latin-1" else encoding, errors="replace").removeprefix("\ufeff")
    if "\0" in text:
        raise RecordingError(f"{path}: is no text (it has zero bytes); export the log as CSV, Parquet or MATLAB file")
    return text, encoding


def _encoding(begin: bytes) -> str:
    """Detect UTF-16 by its mark or its zeros, then valid UTF-8, then Chinese by its words."""
    if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros, others = begin[first::2].count(0), begin[1 - first :: 2].count(0)
        if zeros > _MANY * len(begin) / 2 and not others:
            return encoding
    if "\ufffd" not in begin.decode("utf-8", errors="replace").rstrip("\ufffd"):  # the last character may be cut
        return "utf-8"
    return "gb18030" if _CHINESE.search(begin.decode("gb18030", errors="replace")) else "latin-1"
