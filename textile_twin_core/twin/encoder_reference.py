"""Reference of the shaft angle from events: edges of a toothed wheel counted from its gap, angles from an index
pulse.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable
from itertools import pairwise
from typing import Protocol, TypeAlias

from textile_twin_core.errors import SceneError
from textile_twin_core.machine.sensors import Encoder

#: Stamp [ns], measured angle of the encoder [rad], speed [rad/s] or NaN.
Reading: TypeAlias = tuple[int, float, float]
TURN = 2.0 * math.pi
CAPACITY = 4096
"""Capacity for readings that precede a late pulse from another topic."""
SET_BACK_AFTER = 10
"""Number of consecutive stamps before the newest one that mean that time was set back."""
GAP_FROM, GAP_TO = 0.75, 1.35
"""Range of the duration of a gap over its expected duration, from the mean of the intervals beside it."""
EVEN = 1.5
"""Largest ratio of the intervals beside a gap."""
SLIP_RAD = 0.02
"""Distance of an index pulse from its expected angle that counts as a slip and shifts the angle."""
_NAN = math.nan


class Reference(Protocol):
    """Converter of readings and index pulses, each in the order of their stamps, into referenced readings.

    Attributes:
        counts: `unreferenced` readings before the first reference, `miscounts` where a gap or a pulse was not at its
            expected place, `older` readings whose stamps were not newer than the last.
    """

    counts: Counter[str]

    def take(self, readings: Iterable[Reading]) -> list[Reading]:
        """Add readings, and return those whose angle is known by now."""

    def index(self, stamp_ns: int) -> list[Reading]:
        """Add an index pulse, and return the readings that waited for it; none is older than the first pulse."""


def check_reference(encoder: Encoder, edges: bool, index: bool) -> None:
    """Check that the angle of an encoder has a reference; arguments and errors as in `reference_of`."""
    if not edges:
        return
    if not encoder.teeth:
        raise SceneError("edges are counted only when the number of teeth is known: set teeth of the encoder")
    if not encoder.missing_teeth and not index:
        raise SceneError("nothing marks tooth 0 of the wheel: set missing_teeth of the encoder, or give index pulses")


def reference_of(encoder: Encoder, edges: bool, index: bool) -> Reference | None:
    """Create the reference that an encoder needs; None if its readings are angles already.

    Args:
        encoder: Encoder of the machine.
        edges: True if readings are edges of a toothed wheel, with a stamp alone.
        index: True if there are index pulses, one per turn.

    Raises:
        SceneError: The wheel has no teeth, or neither a gap nor an index pulse marks tooth 0.
    """
    check_reference(encoder, edges, index)
    if edges:
        return EdgeCounter(encoder.teeth, encoder.missing_teeth, index)
    return IndexedAngle() if index else None


class _InOrder:
    """Filter that drops readings that are not newer than the last, and restarts where time was set back."""

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
            if self._behind < SET_BACK_AFTER:
                return False
            self._begin()
        self._newest_ns, self._behind = stamp_ns, 0
        return True


class EdgeCounter(_InOrder):
    """Counter of the edges of a toothed wheel: edge k of the wheel is the angle k * pitch.

    Tooth 0 is the first after the gap of missing teeth or, with an index pulse, the first after the pulse. A gap
    lasts as
    long as its missing teeth imply, between two similar intervals. An edge was lost or added if a gap is at
    another place
    than counted twice, or a pulse once; the count is then corrected. One wheel does not show the direction of rotation.

    Args:
        teeth: Teeth per turn, missing ones included.
        missing: Missing teeth in the gap.
        index: True if pulses mark tooth 0.
    """

    def __init__(self, teeth: int, missing: int, index: bool) -> None:
        self._teeth, self._missing, self._by_gap = teeth, missing, not index
        super().__init__()

    def _begin(self) -> None:
        super()._begin()
        self._number: int | None = None
        """Number of the latest edge, counted over turns."""
        self._edges: deque[tuple[int, int]] = deque(maxlen=CAPACITY)
        """Stamps and numbers in order; numbers are 0 before the first reference."""
        self._pulse_ns: int | None = None
        self._suspected_offset = 0

    def take(self, readings: Iterable[Reading]) -> list[Reading]:
        """Add edges; only their stamps are used."""
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
        """Return the number of the edge after this one, across the gap where it follows."""
        return number + 1 + self._missing * (number % self._teeth == self._teeth - self._missing - 1)

    def index(self, stamp_ns: int) -> list[Reading]:
        """Add an index pulse."""
        if self._newest_ns is None or stamp_ns >= self._newest_ns:
            self._pulse_ns = stamp_ns
            return []
        after = sum(1 for stamp, _ in self._edges if stamp > stamp_ns)
        if after == len(self._edges):  # the pulse precedes the first stored edge
            return []
        was_known = self._number is not None
        known = self._zero_at(after, sure=True)
        return [] if was_known else known

    def _gap_before_last(self) -> bool:
        """Return true if the gap precedes the last edge but one; one further edge confirms the end of the gap."""
        if len(self._edges) < 4:
            return False
        before, gap, after = (b[0] - a[0] for a, b in pairwise(self._edges[k] for k in range(-4, 0)))
        even = max(before, after) < EVEN * min(before, after)
        share = gap / (0.5 * (before + after) * (self._missing + 1))
        return even and GAP_FROM < share < GAP_TO

    def _zero_at(self, place: int, sure: bool) -> list[Reading]:
        """Identify the last edge but `place` - 1 as tooth 0 of some turn, and return the edges from there on.

        The count is corrected at once if `sure`, otherwise at the second identical observation.
        """
        number, known = self._edges[-place][1], self._number is not None
        off = number % self._teeth
        off -= self._teeth * (2 * off > self._teeth)
        if not known:
            self.counts["unreferenced"] += len(self._edges) - place
            self._count_on(place, 0)
        elif off and (sure or off == self._suspected_offset):
            self.counts["miscounts"] += 1
            self._count_on(place, number - off)
            off = 0
        self._suspected_offset = off
        return self._latest(1 if known else place)

    def _count_on(self, place: int, number: int) -> None:
        """Number the last edge but `place` - 1, and the edges after it in sequence."""
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
    """Reference for angles that count from power-on of the encoder: zero is the angle of its index pulse.

    The angle at a pulse is interpolated between the readings around it.
    """

    def _begin(self) -> None:
        super()._begin()
        self._shift: float | None = None
        self._readings: deque[Reading] = deque(maxlen=CAPACITY)
        self._pulse_ns: int | None = None

    def take(self, readings: Iterable[Reading]) -> list[Reading]:
        """Add angles."""
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
        """Add an index pulse."""
        if self._newest_ns is None or stamp_ns >= self._newest_ns:
            self._pulse_ns = stamp_ns
            return []
        after = sum(1 for stamp, _, _ in self._readings if stamp > stamp_ns)
        was_known = self._shift is not None
        known = self._refer(stamp_ns, after)
        return [] if was_known else known

    def _refer(self, pulse_ns: int, after: int) -> list[Reading]:
        """Set zero at the pulse, which precedes the last `after` readings, and return those readings."""
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
