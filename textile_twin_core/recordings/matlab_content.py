"""Variables of a .mat file, read in a process of its own: over a damaged file scipy's reader may crash."""

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
    told = loadmat(sys.argv[1], simplify_cells=True)
except Exception as error:
    told = str(error) or type(error).__name__
pickle.dump(told, sys.stdout.buffer, protocol=5)
"""


def matlab_variables(path: Path) -> dict[str, Any]:
    """Variables by name; structures as dictionaries, cells as lists.

    Raises RecordingError, one line, for a file that is damaged or no MATLAB file.
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
    """Whether a file is HDF5, as MATLAB writes it behind 512 bytes of its own, and other programs without these."""
    with path.open("rb") as file:
        head = file.read(520)
    return head.startswith(_HDF5) or head[512:].startswith(_HDF5)


def _crash(code: int) -> str:
    """How the reader ended, in words."""
    name = f"exit code {code}"
    with suppress(ValueError):
        name = signal.Signals(-code).name
    return f"its reader crashed, {name}; save it anew, or as CSV"
