"""Variables of a .mat file, read in a separate process, since scipy's reader may crash on a damaged file."""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.hdf5_content import hdf5_content

_HDF5 = b"\x89HDF"
_READER = """
import pickle, sys
from scipy.io import loadmat
try:
    result = loadmat(sys.argv[1], simplify_cells=True)
except Exception as error:
    result = str(error) or type(error).__name__
pickle.dump(result, sys.stdout.buffer, protocol=5)
"""


def matlab_variables(path: Path) -> dict[str, Any]:
    """Read variables by name; structures become dictionaries, cells become lists.

    Raises:
        RecordingError: The file is damaged or not a MATLAB file.
    """
    if _is_hdf5(path):
        return hdf5_content(path)
    command = [sys.executable, "-P", "-c", _READER, str(path)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    content = pickle.loads(done.stdout) if done.returncode == 0 else _crash(done.returncode)
    if isinstance(content, str):
        raise RecordingError(f"{path}: not a MATLAB file, or a damaged one ({' '.join(content.split())})")
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _is_hdf5(path: Path) -> bool:
    """Return true for an HDF5 file, with or without the 512 bytes that MATLAB writes before it."""
    with path.open("rb") as file:
        head = file.read(520)
    return head.startswith(_HDF5) or head[512:].startswith(_HDF5)


def _crash(code: int) -> str:
    """Describe how the reader ended."""
    name = f"exit code {code}"
    with suppress(ValueError):
        name = signal.Signals(-code).name
    return f"its reader crashed, {name}; save it again, or as CSV"
