"""A picture as a recording that the viewer opens."""

from __future__ import annotations

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb


def write_picture(path: Path, picture: Path, *, title: str) -> Path:
    """Write an .rrd file that shows a .png file; the path written."""
    stream = rr.RecordingStream("textile-twin", recording_id=title)
    layout = rrb.Blueprint(rrb.Spatial2DView(origin="/", name=title), collapse_panels=True)
    stream.save(path, default_blueprint=layout)
    stream.log("picture", rr.EncodedImage(path=picture), static=True)
    stream.disconnect()
    return path
