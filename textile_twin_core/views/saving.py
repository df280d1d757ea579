"""A figure as a .png file."""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from textile_twin_core.errors import RecordingError


def save_png(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Draw the figure into this file; its path. Raises RecordingError when it cannot be written there."""
    target = Path(path)
    FigureCanvasAgg(figure)
    try:
        figure.savefig(target, format="png")
    except OSError as error:
        raise RecordingError(f"cannot write {target}: {error.strerror or error}") from error
    return target
