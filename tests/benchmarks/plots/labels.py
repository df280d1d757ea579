"""Placement of names beside points, without covering each other, a point or a line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure

Place = tuple[float, float]

_DISTANCES = (11.0, 15.0, 22.0, 32.0, 44.0, 58.0, 74.0, 92.0, 112.0, 134.0, 158.0, 184.0)
_DIRECTIONS = 24
_SWEEPS = 3
_MARKER, _GAP, _LEADER_FROM, _CROWD = 14.0, 2.0, 16.0, 40.0
_COVERED, _CROSSED, _GRAZED = 1e4, 150.0, 40.0
"""Costs in pixels of distance: covering something, crossing the line of a name, touching a point."""


@dataclass(frozen=True)
class Annotation:
    """Name for the point (x, y), in data coordinates."""

    x: float
    y: float
    text: str
    colour: str
    bold: bool = False


@dataclass(frozen=True)
class Box:
    """Rectangle in pixels."""

    left: float
    bottom: float
    right: float
    top: float

    @classmethod
    def around(cls, x: float, y: float, width: float, height: float) -> Box:
        """Create the rectangle of this size about its centre."""
        return cls(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)

    def padded(self, by: float) -> Box:
        """Return the rectangle enlarged by `by` on every side."""
        return Box(self.left - by, self.bottom - by, self.right + by, self.top + by)

    def overlaps(self, other: Box) -> bool:
        """Return true if the two share an area."""
        return (
            self.left < other.right and other.left < self.right and self.bottom < other.top and other.bottom < self.top
        )

    def nearest(self, x: float, y: float) -> Place:
        """Return its point nearest to (x, y)."""
        return min(max(x, self.left), self.right), min(max(y, self.bottom), self.top)

    def meets(self, start: Place, end: Place) -> bool:
        """Return true if a straight line runs through it."""
        if max(start[0], end[0]) < self.left or min(start[0], end[0]) > self.right:
            return False
        if max(start[1], end[1]) < self.bottom or min(start[1], end[1]) > self.top:
            return False
        corners = [(x, y) for x in (self.left, self.right) for y in (self.bottom, self.top)]
        return len({_side(start, end, corner) for corner in corners}) == 2


@dataclass(frozen=True)
class _Spot:
    """Candidate place of a name: its box, and the line that leads to its point."""

    box: Box
    start: Place
    end: Place
    distance: float
    leads: bool


def place_labels(
    axes: Axes,
    labels: Sequence[Annotation],
    lines: Sequence[Sequence[Place]] = (),
    nameless: Sequence[Place] = (),
) -> list[Box]:
    """Write the labels and return their boxes in pixels. The limits of the axes must be final.

    `lines` are polylines and `nameless` further points, in data coordinates, that names should not cover.
    Distant names get
    a thin line to their point. The placement is deterministic and greedy: each name in turn takes the cheapest place.
    """
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()  # lays out the figure, so that pixels are final
    points = [_pixel(axes, (label.x, label.y)) for label in labels]
    more = [_pixel(axes, place) for place in nameless]
    tracks = [track for line in lines for track in pairwise([_pixel(axes, place) for place in line])]
    texts = [
        axes.text(0.0, 0.0, label.text, transform=None, fontsize=8.0, color=label.colour, va="center", ha="center",
                  fontweight="bold" if label.bold else "normal", zorder=6)
        for label in labels
    ]  # fmt: skip
    extents = [text.get_window_extent() for text in texts]
    frame = Box(*axes.bbox.extents)
    near = [sum(math.dist(p, q) < _CROWD for q in (*points, *more)) for p in points]
    spots: dict[int, _Spot] = {}
    for _ in range(_SWEEPS):
        for k in sorted(range(len(labels)), key=lambda k: (near[k], k)):
            others = [spot for j, spot in spots.items() if j != k]
            around = [point for j, point in enumerate(points) if j != k] + more
            places = _spots(points[k], extents[k].width, extents[k].height, near[k] > 1)
            spots[k] = _cheapest(places, others, around, tracks, frame)
    for k, (label, text) in enumerate(zip(labels, texts, strict=True)):
        box, start, end = spots[k].box, spots[k].start, spots[k].end
        text.set_position(((box.left + box.right) / 2.0, (box.bottom + box.top) / 2.0))
        if spots[k].leads:
            across, up = zip(start, end, strict=True)
            axes.plot(across, up, transform=None, color=label.colour, linewidth=0.7, alpha=0.7, zorder=2)
    return [spots[k].box for k in range(len(labels))]


def _pixel(axes: Axes, place: Place) -> Place:
    x, y = axes.transData.transform(place)
    return float(x), float(y)


def _cheapest(
    places: Iterable[_Spot],
    others: list[_Spot],
    around: list[Place],
    tracks: list[tuple[Place, Place]],
    frame: Box,
) -> _Spot:
    """Return the spot of least cost; costs are at least the distance, and spots are sorted by distance."""
    best, least = None, math.inf
    for spot in places:
        if spot.distance >= least:
            break
        cost = _cost(spot, others, around, tracks, frame)
        if cost < least:
            best, least = spot, cost
    assert best is not None
    return best


def _spots(point: Place, width: float, height: float, crowded: bool) -> Iterator[_Spot]:
    """Return boxes around the point, the nearest first and to the right first."""
    x, y = point
    for distance in _DISTANCES:
        for k in range(_DIRECTIONS):
            angle = math.pi / _DIRECTIONS * (k if k % 2 == 0 else -k - 1)
            along, up = math.cos(angle), math.sin(angle)
            box = Box.around(x + (distance + width / 2.0) * along, y + (distance + height / 2.0) * up, width, height)
            yield _Spot(box, point, box.nearest(x, y), distance, crowded or distance >= _LEADER_FROM)


def _cost(
    spot: _Spot, others: list[_Spot], around: list[Place], tracks: list[tuple[Place, Place]], frame: Box
) -> float:
    box, cost = spot.box, spot.distance
    if box.left < frame.left or box.right > frame.right or box.bottom < frame.bottom or box.top > frame.top:
        cost += _COVERED
    for other in others:
        cost += _COVERED * box.padded(_GAP).overlaps(other.box)
        cost += _CROSSED * (other.leads and box.meets(other.start, other.end))
        if spot.leads:
            cost += _CROSSED * other.box.meets(spot.start, spot.end)
            cost += _CROSSED * (other.leads and _cross(spot.start, spot.end, other.start, other.end))
    reach = math.dist(spot.start, spot.end)
    for x, y in around:
        cost += _GRAZED * (math.dist((x, y), box.nearest(x, y)) < reach)  # the name would seem to belong to that point
        cost += _COVERED * box.overlaps(Box.around(x, y, _MARKER, _MARKER))
        cost += _GRAZED * (spot.leads and Box.around(x, y, _MARKER / 2.0, _MARKER / 2.0).meets(spot.start, spot.end))
    for start, end in tracks:
        cost += _COVERED * box.padded(_GAP).meets(start, end)
        cost += _GRAZED * (spot.leads and spot.start not in (start, end) and _cross(spot.start, spot.end, start, end))
    return cost


def _cross(a: Place, b: Place, c: Place, d: Place) -> bool:
    """Return true if the segments a-b and c-d cross."""
    return _side(a, b, c) != _side(a, b, d) and _side(c, d, a) != _side(c, d, b)


def _side(a: Place, b: Place, c: Place) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0])
