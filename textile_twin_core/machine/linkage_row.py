"""Linkages in a row along an elastic main shaft: where each stands, and what belongs to it is called."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine.declaration import Declaration


@dataclass(frozen=True)
class RowPlace:
    """Place of one linkage in the row.

    Attributes:
        number: of the linkage, from 0 on.
        station: number of its station; 0 on a rigid shaft.
        z_m: its distance along the shaft from the first linkage.
        suffix: what stands behind the names of its joints, links and outputs: nothing for the first linkage,
            `_at_S` for one at station S.
    """

    number: int
    station: int
    z_m: float
    suffix: str


def station_places_m(machine: Declaration) -> FloatArray:
    """(stations,) distances along the shaft from the station of the first linkage [m]; (1,) zero on a rigid shaft.

    A piece without a length is as long as the mean of the others; without any length the stations stand as far apart
    as the longest link is long.
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
    """The places of the linkages, in their order; on a rigid shaft that of the first alone."""
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
