"""Recording of the viewer that shows a picture."""

from __future__ import annotations

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from textile_twin_core.views.rrd_file import written


def write_picture(path: Path, picture: Path, *, title: str) -> Path:
    """Write an .rrd file that shows a .png file, and return its path.

    Raises:
        RecordingError: The file cannot be written there.
    """
    stream = rr.RecordingStream("textile-twin", recording_id=title)
    layout = rrb.Blueprint(rrb.Spatial2DView(origin="/", name=title), collapse_panels=True)
    with written(stream, path, layout):
        stream.log("picture", rr.EncodedImage(path=picture), static=True)
    return path
