"""Jobs whose process is really killed, as by a kernel that is out of memory."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from textile_twin_core.errors import RecordingError


def marked(job: tuple[Path, str, int]) -> int:
    """Return the number of a job (folder, what, number); `once` and `always` kill the process by SIGKILL."""
    folder, what, number = job
    ran = folder / f"ran_{number}"
    first = not ran.exists()
    ran.write_text("ran")
    if what == "always" or (what == "once" and first):
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "mistake":
        raise RecordingError(f"recording {number} is empty")
    if what == "fault":
        raise ZeroDivisionError("division by zero")
    return number
