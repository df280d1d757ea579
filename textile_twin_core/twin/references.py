"""Where the shaft stands, from events: edges of a wheel counted from its gap, angles from an index pulse."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable
from itertools import pairwise
from typing import Protocol, TypeAlias

from textile_twin_core.errors import SceneError
from textile_twin_core.machine.sensors import Encoder

#: Stamp [ns], angle as the encoder measures it [rad], speed [rad/s] or NaN.
Reading: TypeAlias = tuple[int, float, float]
TURN = 2.0 * math.pi
HELD = 4096
"""Readings that are remembered for a pulse that comes late, by another topic."""
ANEW = 10
"""So many stamps in a row before the newest: time was set back."""
GAP_FROM, GAP_TO = 0.75, 1.35
"""An interval of this many times what the missing teeth make of its neighbours' mean is the gap."""
EVEN = 1.5
"""The intervals beside a gap differ less than by this factor."""
SLIP_RAD = 0.02
"""An index pulse this far from where it has been is told, and the angle follows it."""
_NAN = math.nan


class Reference(Protocol):
    """Readings and index pulses in, each in the order of their stamps; readings of the encoder's own angle out.

    counts: `unreferenced` readings before the place of the shaft was known, `miscounts`: times that a gap or a pulse
    was elsewhere than counted, `older` readings whose stamps were not newer than the last.
    """

    counts: Counter[str]

    def take(self, readings: Iterable[Reading]) -> list[Reading]:
        """Take readings; those that are known by now."""

    def index(self, stamp_ns: int) -> list[Reading]:
        """Take an index pulse; the readings that have waited for it. None of them is older than the first pulse."""


def reference_of(encoder: Encoder, edges: bool, index: bool) -> Reference | None:
    """What the readings of an encoder need before they are angles; None where they need nothing.

    Args:
        encoder: as the machine says.
        edges: readings are edges of a toothed wheel, with a stamp alone.
        index: there are index pulses, one in a turn.

    Raises:
        SceneError: edges of a wheel that has no teeth, or whose tooth 0 nothing tells.
    """
    if edges:
        if not encoder.teeth:
            raise SceneError("edges are counted only when the number of teeth is known: set teeth of the encoder")
        if not encoder.missing_teeth and not index:
            raise SceneError(
                "nothing tells which tooth comes by: set missing_teeth of the encoder, or give index pulses"
            )
        return EdgeCounter(encoder.teeth, encoder.missing_teeth, index)
    return IndexedAngle() if index else None


class _InOrder:
    """Leaves out readings that are not newer than the last, and begins anew where time was set back."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter(unreferenced=0, miscounts=0, older=0)
        self._begin()

    def _begin(self) -> None:
        self._newest_ns: int | None = None
        self._behind = 0

    def _is_newer(self, stamp_ns: int) -> bool:
        if self._newest_ns is not None and stamp_ns <= self._newest_ns:
            self.counts["older"] += 1
            self._behind += 1
            if self._behind < ANEW:
                return False
            self._begin()
        self._newest_ns, self._behind = stamp_ns, 0
        return True


class EdgeCounter(_InOrder):
    """Counts the edges of a toothed wheel: edge k of the wheel is the angle k * pitch.

    Tooth 0 is the first after the gap of missing teeth; with an index pulse it is the first after the pulse. A gap is
    known by its intervals: it lasts as long as its missing teeth say, between two even ones. Where gaps are found twice
    at another place than counted, or a pulse once, an edge was lost or too much, and the count follows. One wheel does
    not tell the direction in which it turns.

    Args:
        teeth: in a turn, missing ones counted.
        missing: teeth that the gap lacks.
        index: tooth 0 is told by pulses.
    """

    def __init__(self, teeth: int, missing: int, index: bool) -> None:
        self._teeth, self._missing, self._by_gap = teeth, missing, not index
        super().__init__()

    def _begin(self) -> None:
        super()._begin()
        self._number: int | None = None
        """Of the latest edge, counting on over turns."""
        self._edges: deque[tuple[int, int]] = deque(maxlen=HELD)
        """Stamps and numbers, in their order; while the place is not known numbers are 0."""
        self._pulse_ns: int | None = None
        self._doubt = 0

    def take(self, readings: Iterable[Reading]) -> list[Reading]:
        """Take edges, of which the stamps alone count."""
        known: list[Reading] = []
        for stamp, _, _ in readings:
            if self._is_newer(stamp):
                known += self._take_one(stamp)
        return known

    def _take_one(self, stamp_ns: int) -> list[Reading]:
        if self._number is not None:
            self._number = self._next(self._number)
        self._edges.append((stamp_ns, self._number or 0))
        if self._pulse_ns is not None and stamp_ns > self._pulse_ns:
            self._pulse_ns = None
            return self._zero_at(1, sure=True)
        if self._by_gap and self._gap_before_last():
            return self._zero_at(2, sure=False)
        return self._latest(1)

    def _next(self, number: int) -> int:
        """The number of the edge after this one, over the gap where it is next."""
        return number + 1 + self._missing * (number % self._teeth == self._teeth - self._missing - 1)

    def index(self, stamp_ns: int) -> list[Reading]:
        """Take an index pulse."""
        if self._newest_ns is None or stamp_ns >= self._newest_ns:
            self._pulse_ns = stamp_ns
            return []
        after = sum(1 for stamp, _ in self._edges if stamp > stamp_ns)
        if after == len(self._edges):  # a pulse from before the first edge that is remembered
            return []
        was_known = self._number is not None
        known = self._zero_at(after, sure=True)
        return [] if was_known else known

    def _gap_before_last(self) -> bool:
        """Whether the gap lies before the last edge but one: one edge more shows that it has ended."""
        if len(self._edges) < 4:
            return False
        before, gap, after = (b[0] - a[0] for a, b in pairwise(self._edges[k] for k in range(-4, 0)))
        even = max(before, after) < EVEN * min(before, after)
        share = gap / (0.5 * (before + after) * (self._missing + 1))
        return even and GAP_FROM < share < GAP_TO

    def _zero_at(self, place: int, sure: bool) -> list[Reading]:
        """The last edge but `place` - 1 is tooth 0 of some turn; the edges from there on.

        sure: the count follows at once, otherwise when it is told so for the second time.
        """
        number, known = self._edges[-place][1], self._number is not None
        off = number % self._teeth
        off -= self._teeth * (2 * off > self._teeth)
        if not known:
            self.counts["unreferenced"] += len(self._edges) - place
            self._count_on(place, 0)
        elif off and (sure or off == self._doubt):
            self.counts["miscounts"] += 1
            self._count_on(place, number - off)
            off = 0
        self._doubt = off
        return self._latest(1 if known else place)

    def _count_on(self, place: int, number: int) -> None:
        """The last edge but `place` - 1 has this number, and those after it follow."""
        stamps = [stamp for stamp, _ in self._edges][-place:]
        for _ in stamps:
            self._edges.pop()
        for stamp in stamps:
            self._edges.append((stamp, number))
            self._number, number = number, self._next(number)

    def _latest(self, count: int) -> list[Reading]:
        if self._number is None:
            return []
        pitch = TURN / self._teeth
        return [(self._edges[k][0], self._edges[k][1] * pitch, _NAN) for k in range(-count, 0)]


class IndexedAngle(_InOrder):
    """Angles that count from where the encoder was switched on: zero is where its index pulse comes.

    The angle at a pulse is interpolated between the readings around it.
    """

    def _begin(self) -> None:
        super()._begin()
        self._shift: float | None = None
        self._readings: deque[Reading] = deque(maxlen=HELD)
        self._pulse_ns: int | None = None

    def take(self, readings: Iterable[Reading]) -> list[Reading]:
        """Take angles."""
        known: list[Reading] = []
        for reading in readings:
            if not self._is_newer(reading[0]):
                continue
            self._readings.append(reading)
            if self._pulse_ns is not None and reading[0] > self._pulse_ns:
                pulse, self._pulse_ns = self._pulse_ns, None
                known += self._refer(pulse, 1)
            elif self._shift is not None:
                known.append(self._shifted(reading))
        return known

    def index(self, stamp_ns: int) -> list[Reading]:
        """Take an index pulse."""
        if self._newest_ns is None or stamp_ns >= self._newest_ns:
            self._pulse_ns = stamp_ns
            return []
        after = sum(1 for stamp, _, _ in self._readings if stamp > stamp_ns)
        was_known = self._shift is not None
        known = self._refer(stamp_ns, after)
        return [] if was_known else known

    def _refer(self, pulse_ns: int, after: int) -> list[Reading]:
        """Zero lies at the pulse, which comes before so many of the readings; those after it."""
        if after < len(self._readings):
            (t0, a0, _), (t1, a1, _) = self._readings[-after - 1], self._readings[-after]
            at_pulse = a0 + math.remainder(a1 - a0, TURN) * (pulse_ns - t0) / (t1 - t0)
            if self._shift is None:
                self.counts["unreferenced"] += len(self._readings) - after
                self._shift = -at_pulse
            else:
                off = math.remainder(at_pulse + self._shift, TURN)
                if abs(off) > SLIP_RAD:
                    self.counts["miscounts"] += 1
                    self._shift -= off
        if self._shift is None:
            return []
        return [self._shifted(self._readings[k]) for k in range(-after, 0)]

    def _shifted(self, reading: Reading) -> Reading:
        assert self._shift is not None
        stamp, angle, speed = reading
        return stamp, angle + self._shift, speed
