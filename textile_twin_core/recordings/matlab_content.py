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

_READER = """
import pickle, sys
from scipy.io import loadmat
try:
    told = loadmat(sys.argv[1], simplify_cells=True)
except NotImplementedError:
    told = None
except Exception as error:
    told = str(error) or type(error).__name__
pickle.dump(told, sys.stdout.buffer, protocol=5)
"""


def matlab_variables(path: Path) -> dict[str, Any]:
    """Variables by name; structures as dictionaries, cells as lists.

    Raises RecordingError, one line, for a file of version 7.3, and one that is damaged or no MATLAB file.
    """
    command = [sys.executable, "-P", "-c", _READER, str(path)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    content = pickle.loads(done.stdout) if done.returncode == 0 else _crash(done.returncode)
    if content is None:
        raise RecordingError(f"{path}: a MATLAB file of version 7.3; save it with -v7")
    if isinstance(content, str):
        raise RecordingError(f"{path}: not a MATLAB file, or a damaged one ({' '.join(content.split())})")
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _crash(code: int) -> str:
    """How the reader ended, in words."""
    name = f"exit code {code}"
    with suppress(ValueError):
        name = signal.Signals(-code).name
    return f"its reader crashed, {name}; save it anew, or as CSV"
