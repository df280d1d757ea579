"""Diameter and stations of an elastic main shaft as parameters of a design."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from textile_twin_core.machine import AnyMachine, EvenShaft, Machine, MainShaft, ShaftPlace

DIAMETER, STATIONS = "shaft_diameter_m", "shaft_stations"
SHAFT_PARAMETERS = (DIAMETER, STATIONS)
MOST_STATIONS = 64


def shaft_values(machine: AnyMachine) -> dict[str, float]:
    """Return the diameter [m] if all pieces are bars of one diameter, and the stations of an even shaft."""
    shaft = machine.shaft if isinstance(machine, Machine) else None
    if shaft is None or len({piece.diameter_m for piece in shaft.pieces}) > 1 or shaft.pieces[0].diameter_m is None:
        return {}
    even = _even_form(shaft)
    return {DIAMETER: shaft.pieces[0].diameter_m} | ({} if even is None else {STATIONS: float(even.stations)})


def with_shaft(machine: AnyMachine, values: Mapping[str, float]) -> AnyMachine:
    """Return the machine with these values of `SHAFT_PARAMETERS`; stations are rounded.

    A different number of stations preserves length, damping and drive of an even shaft. Each station carries a linkage,
    whose phases repeat the declared ones. Raises MachineError for an impossible shaft.
    """
    shaft = machine.shaft if isinstance(machine, Machine) else None
    if shaft is None or not isinstance(machine, Machine):
        return machine
    if DIAMETER in values:
        shaft = replace(shaft, pieces=tuple(replace(piece, diameter_m=values[DIAMETER]) for piece in shaft.pieces))
    even, linkages = _even_form(shaft), machine.linkages
    if even is not None and STATIONS in values and round(values[STATIONS]) != even.stations:
        count = round(values[STATIONS])
        ends = {f"s{even.stations}": f"s{count}"}
        even = replace(
            even,
            stations=count,
            encoder_at=ends.get(even.encoder_at or "", even.encoder_at),
            second_encoder_at=ends.get(even.second_encoder_at or "", even.second_encoder_at),
        )
        phases = [place.phase_rad for place in machine.linkages]
        shaft = even.main_shaft()
        linkages = even.places([ShaftPlace(phases[k % len(phases)]) for k in range(count)])
    if shaft == machine.shaft and linkages == machine.linkages:
        return machine
    return replace(machine, shaft=shaft, linkages=linkages)


def _even_form(shaft: MainShaft) -> EvenShaft | None:
    """Return the short form of a shaft, or None."""
    piece, count = shaft.pieces[0], len(shaft.pieces)
    if piece.diameter_m is None or piece.length_m is None:
        return None
    even = EvenShaft(
        piece.diameter_m,
        piece.length_m * count,
        count,
        piece.shear_modulus_Pa,
        piece.density_kg_m3,
        piece.damping_Nms_rad / count,
        shaft.encoder_at,
        shaft.second_encoder_at,
        shaft.torque_sensor,
        shaft.drive,
    )
    if even.main_shaft().stations != shaft.stations:
        return None
    alike = all(
        math.isclose(each.length_m or 0.0, piece.length_m, rel_tol=1e-12)
        and replace(each, from_station="", to_station="", length_m=1.0)
        == replace(piece, from_station="", to_station="", length_m=1.0)
        for each in shaft.pieces
    )
    return even if alike else None
