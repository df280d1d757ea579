"""Counters of 16, 24 and 32 bits that pass their end: width found in a record, or known and undone sample by sample."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

BITS = (16, 24, 32)
DECIMALS = tuple(10.0**-k for k in range(10))
"""Value of one count in the unit of a logged column: counts, or a unit that is a decimal multiple of them."""
_NEIGHBOURS = 16
"""Moves before and after a wrap that show how far the shaft or the clock moves meanwhile."""
_CHANGE = 0.25
"""Change of the move across a wrap beyond the range of the neighbouring moves, as a share of the largest of them."""
_MOST = 0.25
"""Largest move between two samples as a share of the width, above which the number of wraps is ambiguous."""
_CONSISTENT = 0.7
"""Least share of the jumps that are wraps; the others are outliers or restarts."""
_WHOLE = 1e-3
"""Largest distance of a reading from a whole count, in counts; a logged decimal number is rounded."""

_ROUNDING = 1e-9
"""Least difference of two moves, over the largest move, that is no rounding of numbers."""

Values = TypeVar("Values", npt.NDArray[np.float64], npt.NDArray[np.int64])


@dataclass(frozen=True)
class Counter:
    """Counter that wraps within a record. width: of its range, in the record's unit. bits: of it. wraps: their number.

    signed: true if its range lies about 0.
    """

    width: float
    bits: int
    wraps: int
    signed: bool

    @property
    def text(self) -> str:
        """The counter for people: `a counter of 16 bits, signed, which wraps 9 times`."""
        times = f"{self.wraps} times" if self.wraps > 1 else "once"
        return f"a counter of {self.bits} bits{', signed,' if self.signed else ''} that passes its end {times}"


def unwrap_counter(values: Values, width: float) -> Values:
    """Undo the wraps of a counter of known width in readings (n,), of which none moves by half the width or more.

    Integers stay exact. NaN stay NaN.

    Examples:
        >>> unwrap_counter(np.array([65530, 65535, 4]), 65536)
        array([65530, 65535, 65540])
    """
    known = np.flatnonzero(np.isfinite(values))
    if known.size < 2:
        return values
    turns = np.cumsum(np.rint(np.diff(values[known]) / width)).astype(np.int64)
    out = values.copy()
    if out.dtype.kind == "i":
        out[known[1:]] -= turns * int(width)
    else:
        out[known[1:]] -= (turns * width).astype(out.dtype)
    return out


def find_counter(values: npt.NDArray[np.float64 | np.int64], counts: Sequence[float] = DECIMALS) -> Counter | None:
    """Find the counter whose end a record of whole counts passes; None without clear evidence.

    Evidence: the readings span less than the width, they are whole counts, and across each jump of about the width the
    reading moves on as between the neighbouring samples.

    Args:
        values: (n,) angles or times as logged, NaN where one is missing.
        counts: values of one count in the unit of the record.
    """
    finite = values[np.isfinite(values)]
    if finite.size < _NEIGHBOURS:
        return None
    moves = np.diff(finite)
    low, high = float(finite.min()), float(finite.max())
    largest = float(np.abs(moves).max(initial=0.0))
    for bits in BITS:
        for count in counts:
            width = 2.0**bits * count
            if not (0.5 * width < largest <= width and high - low < width):
                continue
            wraps = _wraps(moves, width, count)
            if wraps and _are_whole(finite - finite[0], count):
                return Counter(width, bits, wraps, low < 0.0 < high)
    return None


def find_angle_counter(angles_rad: npt.NDArray[np.float64], step_rad: float | None) -> Counter | None:
    """Find the counter of an encoder whose range is no multiple of a turn; None without clear evidence.

    Args:
        angles_rad: (n,) finite angles as measured.
        step_rad: step of the encoder; None to take the least difference of two moves.
    """
    step_rad = step_rad or least_step(angles_rad)
    if not step_rad or np.abs(np.diff(angles_rad)).max(initial=0.0) < 2.0**15 * step_rad:
        return None
    counter = find_counter(angles_rad, [step_rad])
    if counter is None or abs(math.remainder(counter.width, math.tau)) < 0.5 * step_rad:
        return None
    return counter


def least_step(values: npt.NDArray[np.float64]) -> float:
    """Return the step of an encoder behind readings (n,): the least difference of two moves; 0 without any."""
    moves = np.abs(np.diff(values[np.isfinite(values)]))
    different = np.diff(np.unique(np.append(moves, 0.0)))
    least = _ROUNDING * float(moves.max(initial=0.0))
    return float(np.min(different, where=different > least, initial=np.inf)) if np.any(different > least) else 0.0


def _wraps(moves: npt.NDArray[np.float64 | np.int64], width: float, count: float) -> int:
    """Count the jumps of about a width across which the moves continue; 0 if many others are among the jumps."""
    jumps = np.flatnonzero(np.abs(moves) > 0.5 * width)
    across = moves - width * np.rint(moves / width)
    usual = np.where(np.abs(moves) > 0.5 * width, np.nan, moves)
    good = 0
    for k in jumps.tolist():
        near = usual[max(0, k - _NEIGHBOURS) : k + _NEIGHBOURS + 1]
        good += _goes_on(float(across[k]), near[np.isfinite(near)], 2.0 * count)
    clear = np.abs(across).max() < _MOST * width and good >= _CONSISTENT * jumps.size
    return good if clear else 0


def _goes_on(move: float, near: npt.NDArray[np.float64], least: float) -> bool:
    """Return true if a move is like its neighbours, within twice their range and a change of speed."""
    if not near.size:
        return False
    low, high = float(near.min()), float(near.max())
    beyond = high - low + _CHANGE * max(-low, high) + least
    return low - beyond <= move <= high + beyond


def _are_whole(finite: npt.NDArray[np.float64 | np.int64], count: float) -> bool:
    scaled = finite / count
    return bool(np.all(np.abs(scaled - np.rint(scaled)) < _WHOLE + 1e-15 * np.abs(scaled)))


class CounterUnwrapper:
    """Undoes the wraps of a counter as its readings arrive.

    Integers give exact integers where the widths are whole. A reading that is not finite is returned as it is.

    Args:
        widths: of the range, in the unit of the readings: one that is known, or several that may be.
        known: true if the counter is known to have the (only) width, so that each move above half of it is a wrap.
            Otherwise a wrap is a jump of one of the widths, across which the reading moves on as before.

    Attributes:
        width: of the last wrap; None before the first.
        wraps: their number.

    Examples:
        >>> counter = CounterUnwrapper([65536], known=True)
        >>> [counter.step(value) for value in (65530, 65535, 4)]
        [65530, 65535, 65540]
    """

    def __init__(self, widths: Iterable[float], known: bool = False) -> None:
        self._widths: list[float] = sorted(widths)
        if not self._widths or min(self._widths) <= 0 or (known and len(self._widths) > 1):
            raise ValueError(f"widths of a counter: {self._widths}; give positive ones, and one if it is known")
        self._known = known
        self._offset: float = self._widths[0] - self._widths[0]
        self._last: float | None = None
        self._moves: deque[float] = deque(maxlen=_NEIGHBOURS)
        self._span: tuple[float, float] = (math.inf, -math.inf)
        self.width: float | None = None
        self.wraps = 0

    def step(self, value: float) -> float:
        """Return the reading with the wraps before it undone."""
        if not math.isfinite(value):
            return value
        self._span = (min(value, self._span[0]), max(value, self._span[1]))
        if self._last is not None:
            move = value - self._last
            width = self._passed(move)
            if width is not None:
                self._offset += width if move < 0 else -width
                self.width, self.wraps = width, self.wraps + 1
            else:
                self._moves.append(move)
        self._last = value
        return value + self._offset

    def _passed(self, move: float) -> float | None:
        """Return the width of the end that a move passes; None for an ordinary move."""
        if self._known:
            return self._widths[0] if 2 * abs(move) > self._widths[0] else None
        near = np.array(self._moves, dtype=np.float64)
        least = 1e-3 * float(np.abs(near).max(initial=0.0))
        for width in (each for each in self._widths if self._span[1] - self._span[0] < each):
            across = move + width if move < 0 else move - width
            if abs(move) > 0.5 * width and abs(across) < _MOST * width and _goes_on(float(across), near, least):
                return width
        return None
