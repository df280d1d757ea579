"""Four-bar linkages with a coupler point, many at once, and one of them as a machine."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import Crank, RigidArm, RRRDyad
from textile_twin_core.mechanism.rrr_dyad import Branch
from textile_twin_core.synthesis.bars import CAST_IRON, BarSection

ComplexArray = npt.NDArray[np.complex128]

PARAMETERS = ("O_x", "O_y", "C_x", "C_y", "crank", "coupler", "rocker", "along", "across")
"""Columns of a design: fixed pivots [m], three lengths [m], and the coupler point in the coupler's frame [m]."""


def coupler_points(designs: FloatArray, side: FloatArray, theta: FloatArray) -> ComplexArray:
    """Compute coupler points [m] as complex numbers (n, m) of designs (n, 9) at crank angles (m,) or (n, m) [rad].

    `side` (n,) is +1 if the joint of coupler and rocker lies left of the line from crank to rocker pivot, -1 if right.
    NaN where a linkage cannot close.
    """
    ox, oy, cx, cy, a, b, c, u, v = (designs[:, k, None] for k in range(9))
    pin = ox + 1j * oy + a * np.exp(1j * theta)
    line = cx + 1j * cy - pin
    squared = line.real**2 + line.imag**2
    with np.errstate(invalid="ignore", divide="ignore"):
        along = (squared + (b - c) * (b + c)) / (2.0 * squared)
        across = np.sqrt(b * b / squared - along * along)
        coupler = line * (along + 1j * side[:, None] * across) / b
    points: ComplexArray = pin + (u + 1j * v) * coupler
    return points


def ground_lengths(designs: FloatArray) -> FloatArray:
    """Compute the (n,) distance of the fixed pivots [m]."""
    return np.hypot(designs[:, 2] - designs[:, 0], designs[:, 3] - designs[:, 1])


def are_crank_rockers(designs: FloatArray) -> BoolArray:
    """Return (n,) whether the crank is the shortest link and turns fully (Grashof)."""
    ordered = _ordered(designs)
    fits = (ordered > 0.0).all(axis=1) & (ordered[:, 0] + ordered[:, 3] < ordered[:, 1] + ordered[:, 2])
    return np.asarray(fits & (designs[:, 4] <= ordered[:, 0]))


def lack_of_turning(designs: FloatArray) -> FloatArray:
    """Measure the (n,) excess of the lengths over those of a linkage whose crank is the shortest and turns fully."""
    ordered = _ordered(designs)
    surplus = ordered[:, 0] + ordered[:, 3] - ordered[:, 1] - ordered[:, 2]
    return np.asarray(np.maximum(0.0, surplus) + (designs[:, 4] - ordered[:, 0]))


def _ordered(designs: FloatArray) -> FloatArray:
    """Sort the (n, 4) lengths of the links, the shortest first."""
    return np.sort(np.column_stack([designs[:, 4:7], ground_lengths(designs)]), axis=1)


def worst_transmission(designs: FloatArray) -> FloatArray:
    """Compute the (n,) smallest transmission angle of crank-rockers over the turn [rad], folded to 0..90 deg."""
    a, b, c, g = designs[:, 4], designs[:, 5], designs[:, 6], ground_lengths(designs)
    cosines = [np.abs((b**2 + c**2 - (g + sign * a) ** 2) / (2.0 * b * c)) for sign in (-1.0, 1.0)]
    return np.asarray(np.arccos(np.minimum(1.0, np.maximum(*cosines))))


@dataclass(frozen=True)
class FourBarDesign:
    """One four-bar: pivots and lengths [m], the coupler point along and across the coupler [m], and the branch."""

    crank_pivot_m: tuple[float, float]
    rocker_pivot_m: tuple[float, float]
    crank_m: float
    coupler_m: float
    rocker_m: float
    point_m: tuple[float, float]
    branch: Branch

    @classmethod
    def of_row(cls, row: FloatArray, side: float, centre: complex, size: float) -> FourBarDesign:
        """Build a design from a row of a table of designs about `centre` [m], in units of `size` [m]."""
        scaled = row * size
        scaled[[0, 2]] += centre.real
        scaled[[1, 3]] += centre.imag
        ox, oy, cx, cy, a, b, c, u, v = scaled.tolist()
        return cls((ox, oy), (cx, cy), a, b, c, (u, v), "left" if side > 0.0 else "right")

    @property
    def row(self) -> tuple[FloatArray, FloatArray]:
        """Return the design (1, 9) and its side (1,) as rows of tables."""
        lengths = (self.crank_m, self.coupler_m, self.rocker_m)
        table = np.array([[*self.crank_pivot_m, *self.rocker_pivot_m, *lengths, *self.point_m]])
        return table, np.array([1.0 if self.branch == "left" else -1.0])

    @property
    def mu_min_rad(self) -> float:
        """Worst transmission angle over the turn [rad]."""
        return float(worst_transmission(self.row[0])[0])

    def points(self, theta: FloatArray) -> ComplexArray:
        """Compute the coupler point (m,) at crank angles (m,)."""
        return np.asarray(coupler_points(*self.row, theta)[0])

    def machine(self, section: BarSection = CAST_IRON, name: str = "four_bar") -> Machine:
        """Build the machine: links are bars of the section, the coupler point P is the end of a massless arm."""
        u, v = self.point_m
        return Machine(
            name=name,
            description="four-bar linkage with a coupler point",
            points={"O": self.crank_pivot_m, "C": self.rocker_pivot_m},
            groups=(
                Crank("l1", at="O", end="A", length_m=self.crank_m),
                RRRDyad(
                    "l2",
                    "l3",
                    from_point="A",
                    ground="C",
                    end="B",
                    lengths_m=(self.coupler_m, self.rocker_m),
                    branch=self.branch,
                ),
                RigidArm("l4", on="l2", end="P", length_m=math.hypot(u, v), angle_rad=math.atan2(v, u)),
            ),
            bodies=tuple(
                section.bar(link, length)
                for link, length in (("l1", self.crank_m), ("l2", self.coupler_m), ("l3", self.rocker_m))
            ),
            joint_names={"l1": "main_shaft", "l2": "coupler", "l3": "rocker"},
        )
