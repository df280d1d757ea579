"""A paper's numbers beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.expression.blocks import BlockProgram
from textile_twin_core.machines.machine import Machine


@dataclass(frozen=True)
class PublishedRow:
    """A printed value, what this package computes for it, and why they differ where they do.

    `printed` is text where the paper gives no plain number, as "over 60", and None where it gives nothing;
    `computed` is text where several values share a row.
    """

    paper: str
    quantity: str
    unit: str
    printed: float | str | None
    computed: float | str
    reason: str = ""

    @property
    def deviation(self) -> float | None:
        """Computed minus printed, in the row's unit; None where no plain number is printed."""
        if isinstance(self.printed, str) or isinstance(self.computed, str) or self.printed is None:
            return None
        return self.computed - self.printed


def over_a_turn(machine: Machine, names: Sequence[str], omega_rad_s: float, samples: int) -> dict[str, FloatArray]:
    """Outputs by name over one turn at constant speed, at theta = 2 pi k/samples."""
    theta = np.linspace(0.0, 2.0 * np.pi, samples, endpoint=False)
    found = {name: np.empty_like(theta) for name in names}
    program = BlockProgram([machine.model.output(name) for name in names], INPUTS)
    program([theta, np.full_like(theta, omega_rad_s), np.zeros_like(theta)], list(found.values()))
    return found
