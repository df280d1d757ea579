"""Order analysis as a recording of the rerun viewer: map as an image, spectrum, and the largest orders over time."""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import cycle

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from textile_twin_core.comparison.orders import OrderMap
from textile_twin_core.views import palette
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.layout import page
from textile_twin_core.views.rrd_file import written

_ORDERS = 5
_DECADES = 3.0


def write_orders_recording(path: str | os.PathLike[str], maps: Mapping[str, OrderMap], *, title: str) -> None:
    """Write the order maps of signals as an .rrd file.

    Args:
        path: The .rrd file to write.
        maps: Order map by signal name with unit.
        title: Name of the analysed recording.

    Raises:
        RecordingError: The file cannot be written there.
    """
    stream = rr.RecordingStream("textile-twin", recording_id=f"orders-{drawable(title)}")
    rows: list[rrb.View | rrb.Container] = [
        _row(f"signal_{k}", name, found) for k, (name, found) in enumerate(maps.items())
    ]
    rows.append(
        rrb.TimeSeriesView(
            name="Speed of the shaft [rpm]",
            origin="speed",
            background=rrb.archetypes.PlotBackground(color=palette.BACKGROUND, show_grid=True),
            plot_legend=rrb.PlotLegend(visible=False),
        )
    )
    with written(stream, path, page(rrb.Vertical(*rows, row_shares=[3.0] * len(maps) + [1.2]))):
        stream.send_recording_name(drawable(title))
        for k, found in enumerate(maps.values()):
            _log(stream, f"signal_{k}", found)
        first = next(iter(maps.values()))
        stream.log("speed/shaft", rr.SeriesLines(colors=[palette.STEEL], names=["shaft"]), static=True)
        _column(stream, "speed/shaft", first, first.speed_rad_s * (30.0 / np.pi))


def _row(origin: str, name: str, found: OrderMap) -> rrb.Horizontal:
    """Arrange map, spectrum and largest orders of one signal side by side."""
    times = f"{found.time_s[0]:.1f} to {found.time_s[-1]:.1f} s"
    return rrb.Horizontal(
        rrb.TensorView(
            name=f"{name}: order 0 to {found.order[-1]:g} upwards, {times} [log10 of the amplitude]",
            origin=f"{origin}/map",
            scalar_mapping=rrb.TensorScalarMapping(colormap="inferno", mag_filter="nearest"),
            view_fit="fill",
        ),
        rrb.BarChartView(name="Order spectrum", origin=f"{origin}/spectrum"),
        rrb.TimeSeriesView(
            name="Largest orders [amplitude]",
            origin=f"{origin}/orders",
            background=rrb.archetypes.PlotBackground(color=palette.BACKGROUND, show_grid=True),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        ),
        column_shares=[1.3, 1.0, 1.0],
    )


def _log(stream: rr.RecordingStream, origin: str, found: OrderMap) -> None:
    top = float(np.nanmax(found.amplitude[1:]))
    floor = max(top * 10.0**-_DECADES, 1e-300)
    levels = np.log10(np.maximum(np.nan_to_num(found.amplitude), floor))[::-1]  # rows of the picture go downwards
    stream.log(
        f"{origin}/map",
        rr.Tensor(
            levels.astype(np.float32),
            dim_names=["order", "window"],
            value_range=(np.log10(floor), np.log10(max(top, floor))),
        ),
        static=True,
    )
    shown = found.spectrum.copy()
    shown[0] = 0.0  # the mean would dwarf the other orders
    stream.log(
        f"{origin}/spectrum",
        rr.BarChart(shown, abscissa=found.order, widths=np.full(shown.size, found.order[1]), color=palette.PREDICTED),
        static=True,
    )
    for peak, colour in zip(found.peaks()[:_ORDERS], cycle(palette.LINKS)):
        entity = f"{origin}/orders/{peak.order:g}".replace(".", "_")
        stream.log(
            entity,
            rr.SeriesLines(colors=[colour], names=[f"order {round(peak.order, 2):g}"], widths=[1.8]),
            static=True,
        )
        _column(stream, entity, found, found.amplitude[round(peak.order * found.turns)])


def _column(stream: rr.RecordingStream, entity: str, found: OrderMap, values: np.ndarray) -> None:
    stream.send_columns(
        entity,
        indexes=[rr.TimeColumn("time", duration=found.time_s)],
        columns=rr.Scalars.columns(scalars=values),
    )
