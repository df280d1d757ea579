"""One number of a paper beside ours."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PublishedRow:
    """A printed value, what this package computes for it, and why they differ where they do.

    `printed` is text where the paper gives no plain number, as "over 60"; None where it gives none.
    """

    paper: str
    quantity: str
    unit: str
    printed: float | str | None
    computed: float
    reason: str = ""

    @property
    def deviation(self) -> float | None:
        """Computed minus printed, in the row's unit; None where no plain number is printed."""
        return self.computed - self.printed if isinstance(self.printed, (int, float)) else None
