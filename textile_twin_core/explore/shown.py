"""What the page shows of a design: curves over one turn, the moving linkage, marks and numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

from textile_twin_core.arrays import FloatArray
from textile_twin_core.explore.interference import Clash


@dataclass(frozen=True)
class Chart:
    """Curves over the shaft angle that share an axis: (n,) values by label, in the unit that people read."""

    title: str
    unit: str
    curves: dict[str, FloatArray]


@dataclass(frozen=True)
class Mark:
    """A shaft angle [rad] at which something happens."""

    name: str
    angle_rad: float


@dataclass(frozen=True)
class Span:
    """A range of the shaft angle [rad] over which something holds; its end lies before its begin past 0."""

    name: str
    begin_rad: float
    end_rad: float


@dataclass(frozen=True)
class Bar:
    """A link as it is drawn, from point to point; an elliptic gear has half axes [m] and is drawn about its middle.

    Round gears that are drawn with the link have a centre, by its point's name, and a pitch radius [m] each.
    """

    name: str
    start: str
    end: str
    half_axes_m: tuple[float, float] | None = None
    gears: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Analysis:
    """One design over one turn of (n,) angles."""

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
