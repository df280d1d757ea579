"""Rows that compare a paper's numbers with computed ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.expression.loop import Loop
from textile_twin_core.machine.machine import Machine


@dataclass(frozen=True)
class PublishedRow:
    """A printed value, the computed value, and the reason for a difference.

    Attributes:
        printed: text where digits or words matter, such as "0.90" or "over 60"; None if the paper gives nothing.
            Several numbers separated by blanks correspond to a tuple of computed ones.
        computed: number, tuple, or text where no single number applies.
        section: heading of a group of rows of one paper.
    """

    paper: str
    quantity: str
    unit: str
    printed: float | str | None
    computed: float | tuple[float, ...] | str
    reason: str = ""
    section: str = ""

    @property
    def deviation(self) -> float | None:
        """Computed minus printed, in the row's unit; None if no plain number is printed."""
        numbers = printed_numbers(self.printed)
        if not isinstance(self.computed, (int, float)) or len(numbers) != 1:
            return None
        return self.computed - float(numbers[0])

    @property
    def last_places(self) -> float | None:
        """Largest deviation of the row's numbers in units of their last printed digit; None for words."""
        printed = printed_numbers(self.printed)
        if isinstance(self.computed, str):
            return None
        computed = self.computed if isinstance(self.computed, tuple) else (self.computed,)
        if len(printed) != len(computed):
            return None
        return max(
            abs(ours - float(theirs)) * 10.0 ** decimals(theirs) for theirs, ours in zip(printed, computed, strict=True)
        )

    @property
    def agrees(self) -> bool | None:
        """True if print and computation differ by less than a unit of the last printed digit; None without numbers."""
        return None if self.last_places is None else self.last_places < 1.0


PrintedAndOurs = tuple[str, str, float | str | None, float | str, str]
"""Quantity, unit, printed value, computed value, and reason for a difference."""


def in_sections(paper: str, sections: Mapping[str, Iterable[PrintedAndOurs]]) -> tuple[PublishedRow, ...]:
    """Build the rows of a paper by section."""
    return tuple(PublishedRow(paper, *row, section) for section, rows in sections.items() for row in rows)


def printed_numbers(printed: float | str | None) -> list[Decimal]:
    """Parse the numbers of a printed value with their digits; an empty list if it contains words."""
    if printed is None:
        return []
    text = printed if isinstance(printed, str) else f"{printed:.12g}"
    try:
        return [Decimal(word) for word in text.split()]
    except InvalidOperation:
        return []


def decimals(number: Decimal) -> int:
    """Count the digits after the point of a printed number, those of its power of ten included."""
    return -int(number.as_tuple().exponent)


def span(values: FloatArray, places: int) -> str:
    """Format the smallest and largest value with a number of decimals."""
    return f"{values.min():.{places}f} .. {values.max():.{places}f}"


def over_a_turn(machine: Machine, names: Sequence[str], omega_rad_s: float, samples: int) -> dict[str, FloatArray]:
    """Evaluate outputs by name over one turn at constant speed, at theta = 2 pi k/samples."""
    theta = np.linspace(0.0, 2.0 * np.pi, samples, endpoint=False)
    return at_angles(machine, names, omega_rad_s, theta)


def at_angles(machine: Machine, names: Sequence[str], omega_rad_s: float, theta: FloatArray) -> dict[str, FloatArray]:
    """Evaluate outputs by name at shaft angles [rad] and constant speed."""
    found = {name: np.empty_like(theta) for name in names}
    program = Loop([machine.model.output(name) for name in names], INPUTS)
    program([theta, np.full_like(theta, omega_rad_s), np.zeros_like(theta)], list(found.values()))
    return found
