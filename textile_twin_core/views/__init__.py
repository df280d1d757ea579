"""Views: recordings for the rerun viewer, live views, and plots for reports."""

from __future__ import annotations

from textile_twin_core.views.element_views import LiveElements, write_element_recording
from textile_twin_core.views.live import LiveView
from textile_twin_core.views.live_recording import LiveRecording
from textile_twin_core.views.machine_picture import plot_machine
from textile_twin_core.views.motion_recording import write_motion_recording
from textile_twin_core.views.picture_recording import write_picture
from textile_twin_core.views.plot import plot_comparison
from textile_twin_core.views.recording import write_comparison_recording
from textile_twin_core.views.report import write_report
from textile_twin_core.views.viewer import open_viewer, screenshot, screenshots

__all__ = [
    "LiveElements",
    "LiveRecording",
    "LiveView",
    "open_viewer",
    "plot_comparison",
    "plot_machine",
    "screenshot",
    "screenshots",
    "write_comparison_recording",
    "write_element_recording",
    "write_motion_recording",
    "write_picture",
    "write_report",
]
