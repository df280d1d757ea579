"""Content of HDF5 files: data sets in groups, tables of several fields, and MATLAB files of version 7.3."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from textile_twin_core.errors import RecordingError, how_to_install

if TYPE_CHECKING:
    import h5py

_OF_MATLAB = "MATLAB_class"
_UNITS = ("units", "unit", "Units", "Unit")


def hdf5_content(path: Path) -> dict[str, Any]:
    """Read groups as dictionaries, data sets as arrays, texts as str, and MATLAB variables as MATLAB shows them.

    Raises:
        RecordingError: The file is damaged or not HDF5, or h5py is not installed.
    """
    try:
        import h5py
    except ImportError as error:
        raise RecordingError(f"{path}: an HDF5 file needs the package h5py; {how_to_install('h5py')}") from error
    try:
        with h5py.File(path, "r") as file:
            return _group(file, file)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise RecordingError(f"{path}: not an HDF5 file, or a damaged one ({' '.join(str(error).split())})") from error


def _group(group: h5py.Group, file: h5py.File) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for name, part in group.items():
        if name.startswith("#"):
            continue  # MATLAB stores the targets of cells and structures here
        value = _value(part, file)
        unit = next((_text(part.attrs[key]) for key in _UNITS if key in part.attrs), "")
        content[f"{name} [{unit}]" if unit and isinstance(value, np.ndarray) and "[" not in name else name] = value
    return content


def _value(part: Any, file: h5py.File) -> Any:
    import h5py

    if isinstance(part, h5py.Group):
        return _group(part, file)
    kind = part.attrs.get(_OF_MATLAB)
    if part.dtype.names:
        return {name: np.asarray(part[name]) for name in part.dtype.names}
    if part.dtype == h5py.ref_dtype:
        parts = [_value(file[each], file) for each in np.asarray(part).ravel()]
        return parts[0] if len(parts) == 1 else parts
    values = np.asarray(part[()])
    if kind is not None and _text(kind) == "char":
        return "".join(map(chr, values.ravel().tolist()))
    if values.dtype.kind in "SO" and values.ndim == 0:
        return _text(values[()])
    # MATLAB stores columns first, and a vector as a row or column of a matrix.
    return np.squeeze(values.T) if kind is not None or (values.ndim == 2 and 1 in values.shape) else values


def _text(value: Any) -> str:
    """Decode a text as stored by h5py and other writers."""
    value = value[0] if isinstance(value, np.ndarray) and value.size else value
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
