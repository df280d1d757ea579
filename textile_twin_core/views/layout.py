"""Layout of the viewer: place and content of each view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn
from rerun.blueprint.encodings import TextLogColumnKind as _Kind

from textile_twin_core.views import palette
from textile_twin_core.views.angle_canvas import AngleCanvas
from textile_twin_core.views.scene import MachineScene
from textile_twin_core.views.whole_width import WholeWidth

TIMELINE = "time"

Overrides: TypeAlias = dict[Any, Any]  # short for the viewer's own type


@dataclass(frozen=True, slots=True)
class Layout:
    """Inputs of the layout.

    Attributes:
        machine: Machine name, for the title.
        scene: Linkage, for the camera.
        travel: Canvas of the measures over the shaft angle; None for a machine without measures.
        measures: Names of the measures.
        phase_rows: Number of rows of phases.
        torque: Canvas of the torque over the shaft angle; None for a machine without masses.
        residual: Canvas of the residual over the shaft angle; None while no torque was measured.
        window_s: Time shown before and after the cursor in the plots over time [s].
        turn_s: Duration of the last turn, which is drawn bold over the shaft angle [s].
        history_s: Time that earlier turns stay visible there [s].
        history: The same as text.
        residual_title: Title of the residual plot.
        width: All linkages of a machine with an elastic shaft.
        force_law: Title and canvas of the force over a measure; None without a force law.
    """

    machine: str
    scene: MachineScene
    travel: AngleCanvas | None
    measures: tuple[str, ...]
    phase_rows: int
    torque: AngleCanvas | None
    residual: AngleCanvas | None
    window_s: tuple[float, float]
    turn_s: float
    history_s: float
    history: str
    residual_title: str
    width: WholeWidth | None = None
    force_law: tuple[str, AngleCanvas] | None = None

    def blueprint(self) -> rrb.Blueprint:
        """Return the layout as a blueprint of the viewer."""
        plots = self._motion_plots() if self.torque is None or self.residual is None else self._torque_plots()
        if self.width is not None:
            above = rrb.Horizontal(self._whole_width(self.width), self._log(), column_shares=[4.0, 1.0])
            return page(rrb.Vertical(above, plots, row_shares=[1.0, 1.7]))
        machine = rrb.Vertical(self._linkage(), self._log(), row_shares=[3.2, 1.0])
        return page(rrb.Horizontal(machine, plots, column_shares=[1.0, 2.9]))

    def _torque_plots(self) -> rrb.Vertical:
        """Arrange measured beside predicted torque."""
        assert self.torque is not None and self.residual is not None
        law = (
            [] if self.force_law is None else [self._angle_view(self.force_law[0], "force_law", self.force_law[1], {})]
        )
        over_angle = rrb.Horizontal(
            self._angle_view(
                f"Torque over shaft angle, {self.history} [N m]", "angle", self.torque, self._visible_turns()
            ),
            self._angle_view("Residual by shaft angle: mean, spread, extremes [N m]", "by_angle", self.residual, {}),
            *law,
            self._summary(),
            column_shares=[1.25, 1.0, *(1.0 for _ in law), 0.92],
        )
        return rrb.Vertical(
            self._series("Torque on the main shaft, predicted as its sensor shows it [N m]", "torque", legend=True),
            self._series(self.residual_title, "residual"),
            self._phases(),
            over_angle,
            row_shares=[3.2, 1.9, 1.4, 3.9],
        )

    def _motion_plots(self) -> rrb.Vertical:
        """Arrange the plots that need the shaft angle only."""
        of = f"{self.measures[0].capitalize()} position" if len(self.measures) == 1 else "Positions"
        rows: list[tuple[rrb.View | rrb.Container, float]] = []
        beside: list[rrb.View | rrb.Container] = []
        if self.travel is not None:
            rows.append((self._series(f"{of} [mm]", "travel", legend=len(self.measures) > 1), 2.6))
            beside.append(self._angle_view(f"{of} over shaft angle [mm]", "travel_angle", self.travel, {}))
        if self.torque is not None:
            rows.append((self._series("Torque on the main shaft, predicted [N m]", "torque"), 2.6))
            title = f"Torque over shaft angle, {self.history} [N m]"
            beside.append(self._angle_view(title, "angle", self.torque, self._visible_turns()))
        rows += [
            (self._series("Speed of the shaft [rpm]", "speed"), 1.5),
            (self._phases(), 0.7 + 0.5 * self.phase_rows),
        ]
        rows.append((rrb.Horizontal(*beside, self._summary(), column_shares=[1.0] * len(beside) + [0.8]), 3.9))
        views, shares = zip(*rows, strict=True)
        return rrb.Vertical(*views, row_shares=list(shares))

    def _phases(self) -> rrb.StateTimelineView:
        return rrb.StateTimelineView(name="Phase of the cycle", origin="phase", time_view=self._window())

    def _summary(self) -> rrb.TextDocumentView:
        return rrb.TextDocumentView(name="Run summary", origin="summary")

    def _window(self) -> rrb.TimeAxis:
        return time_axis(*self.window_s)

    def _visible_turns(self) -> Overrides:
        earlier, last = _last(self.history_s), _last(self.turn_s)
        return {"angle/measured": earlier, "angle/predicted": last, "angle/last": last}

    def _series(self, name: str, origin: str, *, legend: bool = False) -> rrb.TimeSeriesView:
        return over_time(name, origin, self._window(), legend=legend)

    def _angle_view(self, name: str, origin: str, canvas: AngleCanvas, ranges: Overrides) -> rrb.Spatial2DView:
        return rrb.Spatial2DView(
            name=name,
            origin=origin,
            background=palette.BACKGROUND,
            visual_bounds=rrb.VisualBounds2D(
                x_range=(-0.095 * canvas.width, 1.035 * canvas.width),
                y_range=(-0.11 * canvas.height, 1.14 * canvas.height),
            ),
            overrides=ranges,
        )

    def _linkage(self) -> rrb.Spatial3DView:
        low, high = self.scene.lower, self.scene.upper
        x, y = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
        # This distance fits a view that is higher than wide.
        away = 1.24 * max(high[1] - low[1], (high[0] - low[0]) / 0.72)
        return rrb.Spatial3DView(
            name=f"Machine: {self.machine}",
            origin="world",
            background=palette.BACKGROUND,
            line_grid=False,
            eye_controls=rrb.EyeControls3D(
                kind=rrb.Eye3DKind.Orbital,
                position=(x + 0.34 * away, -0.98 * away, y + 0.22 * away),
                look_target=(x, 0.0, y),
                eye_up=(0.0, 0.0, 1.0),
            ),
            spatial_information=rrb.SpatialInformation(target_frame="tf#/world", show_axes=False),
        )

    def _whole_width(self, width: WholeWidth) -> rrb.Spatial3DView:
        """Show all linkages from the side and slightly from the front, so that the row spans the view."""
        low, high = self.scene.lower, self.scene.upper
        x, z = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
        near, far = -float(width.places_m[-1]), -float(width.places_m[0])
        y = 0.5 * (near + far)
        away = 0.26 * (far - near) + 0.7 * (high[1] - low[1])
        return rrb.Spatial3DView(
            name=f"Machine: {self.machine}, {width.text}",
            origin="world",
            background=palette.BACKGROUND,
            line_grid=False,
            eye_controls=rrb.EyeControls3D(
                kind=rrb.Eye3DKind.Orbital,
                position=(x + away, y - 0.35 * away, z + 0.28 * away),
                look_target=(x, y - 0.1 * (far - near), z),
                eye_up=(0.0, 0.0, 1.0),
            ),
            spatial_information=rrb.SpatialInformation(target_frame="tf#/world", show_axes=False),
        )

    def _log(self) -> rrb.TextLogView:
        columns = rrb.TextLogColumns(
            timeline_columns=[TimelineColumn(timeline=TIMELINE, visible=False)],
            text_log_columns=[TextLogColumn(kind) for kind in (_Kind.LogLevel, _Kind.Body)],
        )
        return rrb.TextLogView(name="Events", origin="events", columns=columns)


def page(views: rrb.Container) -> rrb.Blueprint:
    """Build a blueprint of these views alone, which follows new data."""
    return rrb.Blueprint(
        views,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def time_axis(before_s: float, after_s: float) -> rrb.TimeAxis:
    """Return the axis of time around the cursor."""
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=_from_cursor(-before_s), end=_from_cursor(after_s)))


def over_time(name: str, origin: str, axis: rrb.TimeAxis, *, legend: bool) -> rrb.TimeSeriesView:
    """Create a plot over time of the entities below `origin`."""
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        axis_x=axis,
        background=rrb.archetypes.PlotBackground(color=palette.BACKGROUND, show_grid=True),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
    )


def _from_cursor(seconds: float) -> rrb.TimeRangeBoundary:
    return rrb.TimeRangeBoundary.cursor_relative(seconds=seconds)


def _last(seconds: float) -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(timeline=TIMELINE, start=_from_cursor(-seconds), end=_from_cursor(0.0))
