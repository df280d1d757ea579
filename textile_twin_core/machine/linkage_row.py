"""Linkages in a row along an elastic main shaft: their positions and name suffixes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine.declaration import Declaration


@dataclass(frozen=True)
class RowPlace:
    """Position of one linkage in the row.

    Attributes:
        number: number of the linkage, from 0.
        station: number of its station; 0 on a rigid shaft.
        z_m: distance along the shaft from the first linkage [m].
        suffix: suffix of the names of its joints, links and outputs: empty for the first linkage, `_at_S` for one at
            station S.
    """

    number: int
    station: int
    z_m: float
    suffix: str


def station_places_m(machine: Declaration) -> FloatArray:
    """Compute the (stations,) distances along the shaft from the first linkage's station [m]; (1,) zero if rigid.

    A piece without a length gets the mean length of the others. Without any length the spacing is the longest link.
    """
    shaft = machine.shaft
    if shaft is None:
        return np.zeros(1)
    known = [piece.length_m for piece in shaft.pieces if piece.length_m is not None]
    usual = float(np.mean(known)) if known else max(link.length for link in machine.linkage.solved.links.values())
    lengths = [usual if piece.length_m is None else piece.length_m for piece in shaft.pieces]
    places = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.asarray(places - places[shaft.station(machine.linkages[0].at, "at")])


def linkage_row(machine: Declaration) -> tuple[RowPlace, ...]:
    """Return the linkages' positions in order; on a rigid shaft that of the first alone."""
    shaft = machine.shaft
    if shaft is None:
        return (RowPlace(0, 0, 0.0, ""),)
    along, taken, found = station_places_m(machine), dict[str, int](), []
    for number, place in enumerate(machine.linkages):
        name = place.at or ""
        taken[name] = taken.get(name, 0) + 1
        again = f"_{taken[name]}" if taken[name] > 1 else ""
        station = shaft.station(name, "at")
        found.append(RowPlace(number, station, float(along[station]), f"_at_{name}{again}" if number else ""))
    return tuple(found)
