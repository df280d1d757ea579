"""Views: recordings for the rerun viewer, live views, plots for reports. Each part is imported when first used."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from textile_twin_core.lazy import listing_of, names_of

if TYPE_CHECKING:
    from textile_twin_core.views.campbell import plot_campbell
    from textile_twin_core.views.live import LiveElements, LiveView, write_element_recording
    from textile_twin_core.views.live_recording import LiveRecording
    from textile_twin_core.views.machine_picture import plot_machine
    from textile_twin_core.views.motion_recording import write_motion_recording
    from textile_twin_core.views.orders_picture import orders_figure, plot_orders
    from textile_twin_core.views.orders_recording import write_orders_recording
    from textile_twin_core.views.plot import plot_comparison, plot_quantity
    from textile_twin_core.views.recording import write_comparison_recording
    from textile_twin_core.views.report import write_report
    from textile_twin_core.views.rrd_file import write_picture
    from textile_twin_core.views.viewer import open_viewer, screenshot, screenshots

__all__ = [
    "LiveElements",
    "LiveRecording",
    "LiveView",
    "open_viewer",
    "orders_figure",
    "plot_campbell",
    "plot_comparison",
    "plot_machine",
    "plot_orders",
    "plot_quantity",
    "screenshot",
    "screenshots",
    "write_comparison_recording",
    "write_element_recording",
    "write_motion_recording",
    "write_orders_recording",
    "write_picture",
    "write_report",
]

# Matplotlib warns where it cannot store its settings, although it draws all the same.
logging.getLogger("matplotlib").setLevel(logging.ERROR)

__dir__ = listing_of(__all__)
__getattr__ = names_of(
    __name__,
    {
        "LiveElements": "live",
        "LiveRecording": "live_recording",
        "LiveView": "live",
        "open_viewer": "viewer",
        "orders_figure": "orders_picture",
        "plot_campbell": "campbell",
        "plot_comparison": "plot",
        "plot_machine": "machine_picture",
        "plot_orders": "orders_picture",
        "plot_quantity": "plot",
        "screenshot": "viewer",
        "screenshots": "viewer",
        "write_comparison_recording": "recording",
        "write_element_recording": "live",
        "write_motion_recording": "motion_recording",
        "write_orders_recording": "orders_recording",
        "write_picture": "rrd_file",
        "write_report": "report",
    },
)
