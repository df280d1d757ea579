"""Data of a design on the page: curves over one turn, moving linkage, marks and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from textile_twin_core.arrays import FloatArray
from textile_twin_core.explore.interference import Clash


@dataclass(frozen=True)
class Chart:
    """Curves over the shaft angle that share an axis: (n,) values by label, in the display unit."""

    title: str
    unit: str
    curves: dict[str, FloatArray]


@dataclass(frozen=True)
class Mark:
    """Shaft angle [rad] of an event."""

    name: str
    angle_rad: float


@dataclass(frozen=True)
class Span:
    """Range of the shaft angle [rad]; the end is smaller than the begin if the range includes 0."""

    name: str
    begin_rad: float
    end_rad: float


@dataclass(frozen=True)
class Bar:
    """Drawn link from point to point; an elliptic gear has half axes [m] and is drawn about its middle.

    Each round gear drawn with the link has a centre, by the name of its point, and a pitch radius [m].
    """

    name: str
    start: str
    end: str
    half_axes_m: tuple[float, float] | None = None
    gears: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Analysis:
    """Analysis of one design over one turn of (n,) angles; `positions_m` by name of the measure."""

    theta_rad: FloatArray
    points: dict[str, tuple[FloatArray, FloatArray]]
    fixed: tuple[str, ...]
    bars: tuple[Bar, ...]
    charts: tuple[Chart, ...]
    numbers: dict[str, float]
    marks: tuple[Mark, ...] = ()
    dwells: tuple[Span, ...] = ()
    clashes: tuple[Clash, ...] = ()
    guides: tuple[tuple[float, float, float, float], ...] = ()
    notes: tuple[str, ...] = field(default=())
    positions_m: Mapping[str, FloatArray] = field(default_factory=dict)
