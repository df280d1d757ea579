"""Motion of a machine, with its predicted torque, as a recording of the rerun viewer in the style of the live view."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.live_drawing import LiveDrawing
from textile_twin_core.views.recording_writer import gap_times, turn_s
from textile_twin_core.views.rrd_file import written
from textile_twin_core.views.whole_width import largest_twist

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_FRAMES_HZ = 125.0
_BLOCK = 512
_TURNS_BEFORE, _TURNS_AFTER = 4.0, 0.3


def write_motion_recording(
    path: str | os.PathLike[str],
    machine: Machine,
    stamps_ns: IntArray,
    theta_rad: FloatArray,
    torque_Nm: FloatArray | None = None,
    sigma_Nm: FloatArray | None = None,
    *,
    title: str,
    stations_rad: FloatArray | None = None,
) -> None:
    """Write the motion of a machine, and its torque where its masses are known.

    Args:
        path: The .rrd file to write.
        machine: Machine to show.
        stamps_ns: Stamps (n,) [ns].
        theta_rad: Unwrapped shaft angles (n,) [rad].
        torque_Nm: Predicted torques (n,) [N m], or None.
        sigma_Nm: Their standard deviations (n,) [N m], or None.
        title: Name of the recording.
        stations_rad: Angles (n, stations) [rad] of the stations of an elastic shaft, or None.

    Raises:
        RecordingError: The file cannot be written there.
    """
    stream = rr.RecordingStream("textile-twin", recording_id=f"{drawable(machine.name)}-{int(stamps_ns[0])}")
    time = np.asarray((stamps_ns - stamps_ns[0]) * 1e-9)
    turn = turn_s(time, theta_rad)
    window = (_TURNS_BEFORE * turn, _TURNS_AFTER * turn)
    twist = None if stations_rad is None else largest_twist(machine, stations_rad)
    drawing = LiveDrawing(
        machine, stream, None, _FRAMES_HZ, title=title, window_s=window, turn_s=turn, unwrapped=True, twist_rad=twist
    )
    with written(stream, path, drawing.layout.blueprint()):
        stream.send_recording_name(drawable(title))
        drawing.prepare()
        for first in range(0, time.size, _BLOCK):
            part = slice(first, first + _BLOCK)
            if stations_rad is not None:
                drawing.stations(time[part], stations_rad[part])
            if torque_Nm is None:
                drawing.motion(time[part], theta_rad[part])
            else:
                sigma = np.full(time[part].size, np.nan) if sigma_Nm is None else sigma_Nm[part]
                drawing.predicted(time[part], theta_rad[part], torque_Nm[part], sigma)
        drawing.break_lines(gap_times(time))
