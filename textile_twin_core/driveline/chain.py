"""An elastic shaft with its linkages as arrays for compiled loops.

All angles of the arrays are reduced to the main shaft: the angle of a station divided by its gear ratio, so that a
rigid shaft has the same reduced angle everywhere. Torques, stiffnesses and inertias are reduced with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import by_reference
from textile_twin_core.driveline.profile import TURN, AngleProfile, linkage_profile, main_shaft_profile, tabulate
from textile_twin_core.errors import MachineError
from textile_twin_core.machine import Machine, MainShaft
from textile_twin_core.machine.main_shaft import ShaftDrive

_TABLE_TOLERANCE = 1e-11
_SLOW = 1e-4
"""Share of the nominal speed below which dry friction is proportional to the speed."""


@by_reference
class ShaftChain(NamedTuple):
    """Arrays of one chain, reduced to the main shaft.

    Hangers are the linkages, and what acts once on the main shaft.
    """

    inertia: FloatArray
    """(stations,) constant inertia: discs, bars, drive [kg m^2]"""
    viscous: FloatArray
    """(stations,) viscous friction against the ground, and the drive's slip [N m s]"""
    stiffness: FloatArray
    """(stations - 1,) [N m/rad]"""
    damping: FloatArray
    """(stations - 1,) [N m s/rad]"""
    half_play: FloatArray
    """(stations - 1,) half of the backlash [rad]"""
    lead: FloatArray
    """(stations - 1,) share of stiffness times squared substep that the mass matrix gives up: 0 for the midpoint rule,
    1/6 for natural frequencies right to fourth order"""
    first: IntArray
    """(stations + 1,): station i carries the hangers first[i] to first[i + 1] - 1"""
    phase: FloatArray
    """(hangers,) [rad]"""
    profile: IntArray
    """(hangers,) number of the profile"""
    node_begin: IntArray
    """(profiles + 1,): the rows of each profile in `table`"""
    table: FloatArray
    """(rows, functions, 4): J, J'/2, V' and load functions, powers of the place behind each node"""
    powers: IntArray
    """(profiles, loads): power of the speed in each load function"""
    next_start: IntArray
    """(2, rows): first entry of `starts` at or behind each node, forward and backward"""
    start_begin: IntArray
    """(2, profiles + 1): the entries of each profile in `starts`"""
    starts: FloatArray
    """(entries,): angles in [0, 2 pi) at which loads step, rising in each profile and direction [rad]"""
    coefficients: FloatArray
    """(entries, loads): coefficients of the load functions behind each start"""
    slow_rad_s: float
    """speed below which dry friction is proportional to the speed"""
    friction_Nm: float
    """bound on the change of one hanger's load torque at a reversal of the speed"""


@dataclass(frozen=True)
class ElasticShaft:
    """A main shaft with its linkages, ready for computation.

    `ratios` (stations,) turn a reduced angle into the station's own; a reduced piece torque divided by that of the
    piece's far station is the torque in the piece. `drive_inertia_kgm2` and `slip_Nms_rad` are 0 where the machine file
    leaves them out.
    """

    shaft: MainShaft
    chain: ShaftChain
    ratios: FloatArray
    hanger_stations: tuple[int, ...]
    profiles: tuple[AngleProfile, ...]

    @property
    def stations(self) -> int:
        """Number of stations."""
        return len(self.shaft.stations)

    @cached_property
    def mean_inertia_kgm2(self) -> FloatArray:
        """(stations,) constant inertia and the mean over the turn of the linkages', reduced to the main shaft."""
        found = self.chain.inertia.copy()
        for station, number in zip(self.hanger_stations, self.chain.profile.tolist(), strict=True):
            found[station] += self.profiles[number].mean_inertia_kgm2
        return found

    @cached_property
    def least_inertia_kgm2(self) -> FloatArray:
        """(stations,) constant inertia and the least over the turn of the linkages', reduced to the main shaft."""
        found = self.chain.inertia.copy()
        for station, number in zip(self.hanger_stations, self.chain.profile.tolist(), strict=True):
            found[station] += float(self.profiles[number].sampled[0].min())
        return found

    def rescaled(self, stiffness: float, damping: float, drive: ShaftDrive) -> ElasticShaft:
        """The shaft with all stiffnesses and dampings times a factor, and with another drive at the same station."""
        now, chain = self.shaft.drive, self.chain
        gear, station = self.ratios[self.shaft.drive_station] ** 2, self.shaft.drive_station
        inertia, viscous = chain.inertia.copy(), chain.viscous.copy()
        inertia[station] += gear * ((drive.inertia_kgm2 or 0.0) - (now.inertia_kgm2 or 0.0))
        viscous[station] += gear * ((drive.slip_Nms_rad or 0.0) - (now.slip_Nms_rad or 0.0))
        changed = chain._replace(
            inertia=inertia, viscous=viscous, stiffness=stiffness * chain.stiffness, damping=damping * chain.damping
        )
        return replace(self, shaft=replace(self.shaft, drive=replace(drive, at=now.at)), chain=changed)

    def piece_torques(self, reduced: FloatArray) -> FloatArray:
        """(.., pieces) torques in the pieces from those reduced to the main shaft [N m]."""
        return reduced / self.ratios[1:]


def elastic_shaft(machine: Machine, tolerance: float = _TABLE_TOLERANCE) -> ElasticShaft:
    """Build the elastic shaft of a machine, with tables of its linkages.

    Args:
        machine: a machine with a `shaft` and masses.
        tolerance: error of a table over each function's peak.

    Returns:
        The shaft.

    Raises:
        MachineError: a machine without a shaft or without masses, or a station without any inertia.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.driveline.chain import elastic_shaft
        >>> len(elastic_shaft(ttc.load_machine("examples/wide_tufting.yaml")).shaft.names)
        17
    """
    shaft = machine.shaft
    if shaft is None:
        raise MachineError(f"machine '{machine.name}' has a rigid shaft; give it a `shaft` with stations and pieces")
    if machine.missing_for_torque:
        raise MachineError(
            f"machine '{machine.name}' lacks masses for an elastic shaft; give {', '.join(machine.missing_for_torque)}"
        )
    if not machine.linkage.solved.turns_fully:
        raise MachineError(f"machine '{machine.name}': an elastic shaft needs linkages that close over the whole turn")
    places = [(shaft.station(place.at, "at"), 0, place.phase_rad) for place in machine.linkages]
    profiles = [linkage_profile(machine)]
    once = main_shaft_profile(machine)
    if once is not None:
        profiles.append(once)
        places.append((places[0][0], 1, 0.0))
    places.sort(key=lambda place: place[0])
    ratios = np.array(shaft.speed_ratios) / shaft.speed_ratios[places[0][0]]
    chain = _arrays(shaft, ratios, places, profiles, tolerance, _SLOW * machine.nominal_speed_rad_s)
    built = ElasticShaft(shaft, chain, ratios, tuple(place[0] for place in places), tuple(profiles))
    _check_inertia(built)
    return built


def bare_shaft(shaft: MainShaft) -> ElasticShaft:
    """The elastic shaft without linkages, reduced to its first station. Raises MachineError as `elastic_shaft`."""
    ratios = np.array(shaft.speed_ratios)
    chain = _arrays(shaft, ratios, [], [], _TABLE_TOLERANCE, _SLOW)
    built = ElasticShaft(shaft, chain, ratios, (), ())
    _check_inertia(built)
    return built


def _check_inertia(built: ElasticShaft) -> None:
    for k, name in enumerate(built.shaft.names):
        if not built.least_inertia_kgm2[k] > 0.0:
            raise MachineError(
                f"shaft: station '{name}' has no inertia; give it `inertia_kgm2`, a linkage or bars beside it"
            )


def _arrays(
    shaft: MainShaft,
    ratios: FloatArray,
    places: Sequence[tuple[int, int, float]],
    profiles: Sequence[AngleProfile],
    tolerance: float,
    slow_rad_s: float,
) -> ShaftChain:
    far = ratios[1:]
    bars = np.array([piece.bar_inertia_kgm2 for piece in shaft.pieces]) * far**2
    inertia = np.array([station.inertia_kgm2 for station in shaft.stations]) * ratios**2
    inertia[:-1] += 0.5 * bars
    inertia[1:] += 0.5 * bars
    viscous = np.array([station.viscous_Nms for station in shaft.stations]) * ratios**2
    drive = shaft.drive_station
    inertia[drive] += (shaft.drive.inertia_kgm2 or 0.0) * ratios[drive] ** 2
    viscous[drive] += (shaft.drive.slip_Nms_rad or 0.0) * ratios[drive] ** 2
    tables = [tabulate(p.functions, tolerance) for p in profiles]
    loads = max((p.powers.size for p in profiles), default=0)
    rows = [table.shape[0] for table in tables]
    table = np.zeros((sum(rows), 3 + loads, 4))
    powers = np.zeros((len(profiles), loads), dtype=np.int64)
    node_begin = np.concatenate([[0], np.cumsum(rows)]).astype(np.int64)
    next_start = np.zeros((2, sum(rows)), dtype=np.int64)
    start_begin = np.zeros((2, len(profiles) + 1), dtype=np.int64)
    starts: list[float] = []
    coefficients: list[FloatArray] = []
    for number, (profile, own) in enumerate(zip(profiles, tables, strict=True)):
        span = slice(node_begin[number], node_begin[number + 1])
        table[span, : own.shape[1]] = own
        powers[number, : profile.powers.size] = profile.powers
    for direction in (0, 1):
        for number, profile in enumerate(profiles):
            stretches = (profile.forward, profile.backward)[direction]
            start_begin[direction, number] = len(starts)
            span = slice(node_begin[number], node_begin[number + 1])
            nodes = np.arange(rows[number]) * TURN / rows[number]
            next_start[direction, span] = len(starts) + np.searchsorted(stretches.starts_rad, nodes)
            starts += stretches.starts_rad.tolist()
            for row in stretches.coefficients:
                coefficients.append(np.pad(row, (0, loads - row.size)))
        start_begin[direction, len(profiles)] = len(starts)
    carried = np.array([place[0] for place in places], dtype=np.int64)
    return ShaftChain(
        inertia=inertia,
        viscous=viscous,
        stiffness=np.array([piece.stiffness for piece in shaft.pieces]) * far**2,
        damping=np.array([piece.damping_Nms_rad for piece in shaft.pieces]) * far**2,
        lead=np.zeros(far.size),
        half_play=0.5 * np.array([piece.backlash_rad for piece in shaft.pieces]) / np.abs(far),
        first=np.searchsorted(carried, np.arange(ratios.size + 1)).astype(np.int64),
        phase=np.array([place[2] for place in places], dtype=float),
        profile=np.array([place[1] for place in places], dtype=np.int64),
        node_begin=node_begin,
        table=table,
        powers=powers,
        next_start=next_start,
        start_begin=start_begin,
        starts=np.array(starts, dtype=float),
        coefficients=np.array(coefficients, dtype=float).reshape(len(starts), loads),
        slow_rad_s=slow_rad_s,
        friction_Nm=max((_friction_bound(profile) for profile in profiles), default=0.0),
    )


def _friction_bound(profile: AngleProfile) -> float:
    """Bound on the difference of the load torques between the two directions, at speed 0 [N m]."""
    steady = profile.powers == 0
    peaks = np.abs(profile.sampled[3:]).max(axis=1)[steady]
    forward, backward = (s.coefficients[:, steady] for s in (profile.forward, profile.backward))
    apart = np.abs(forward[:, None, :] - backward[None, :, :]).max(axis=(0, 1))
    return float(apart @ peaks)
