"""Printed numbers of the needle transfer and results of its model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from textile_twin_core.contact.polynomials import derivative, first_crossing, value
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machines.needle_transfer import (
    COLLETS,
    DESIGNS,
    PAD,
    needle_transfer,
)
from textile_twin_core.papers.rows import PrintedAndOurs, PublishedRow, in_sections

NEEDLE_TRANSFER = "Pejchar and Beran 2011"

PAD_REACHED_MS = {"original": 15.75, "optimised": 17.96}
LARGEST_DECELERATION_MS = {"original": 16.1, "optimised": 18.15}
COLLETS_MEET_MS = 19.23
"""Printed times; the last one for both designs."""

OTHER_READING: Mapping[str, Any] = {
    "pad_position_m": 0.0989,
    "motion_law": "cycloidal",
    "stroke_m": 0.03484,
    "forward_duration_s": 0.02338,
}
"""Parameters for the pad at the place of Eq. 17 and 18, with the forward motion fitted to the printed times."""


@dataclass(frozen=True)
class ForwardStroke:
    """Printed properties of the forward motion: times [s] from its start, and the gap of element 2 from the pin."""

    pad_s: float
    deceleration_s: float
    contact_s: float
    leaves_pin_m: float


def forward_stroke(machine: ContactMachine) -> ForwardStroke:
    """Simulate the forward motion from the published start to a little after its end.

    Times are roots of the motion's own power series, not samples: pad reached, largest acceleration of element 2 on it
    (its derivative vanishes), first contact of elements 2 and 3. The gap at the pin is that before the pad is reached.
    """
    run = machine.simulate(end_s=1.5 * machine.parameters["forward_duration_s"])
    pad_s = run.happened("touch", PAD)[0].time_s
    contact_s = run.happened("impact", COLLETS)[0].time_s
    leaves = 0.0
    deceleration_s = pad_s
    for segment in run.segments:
        if segment.end_s <= pad_s:
            gap = segment.positions[2] - segment.positions[0]
            gap[0] += machine.start[0]
            turn = first_crossing(derivative(gap), 1e-15)
            leaves = max(leaves, value(gap, 1.0), value(gap, turn) if turn <= 1.0 else 0.0)
        elif deceleration_s == pad_s:
            jerk = derivative(derivative(derivative(segment.positions[0])))
            turn = first_crossing(-jerk, 1e-12 * float(np.abs(jerk).max()))
            if turn <= 1.0:
                deceleration_s = segment.start_s + turn * segment.span_s
    return ForwardStroke(pad_s, deceleration_s, contact_s, leaves)


def needle_transfer_rows() -> tuple[PublishedRow, ...]:
    """Compare times of both designs for both positions of the pad, and interpret the printed conditions."""
    default = {design: needle_transfer(design=design) for design in DESIGNS}
    other = {design: needle_transfer(design=design, **OTHER_READING) for design in DESIGNS}
    return in_sections(
        NEEDLE_TRANSFER,
        {
            "Pad at 94.9 mm (Eq. 13); modified sine, 32.6 mm in 24.62 ms": _reading(default, "its duration is fitted"),
            "Pad at 98.9 mm (Eq. 17); cycloidal, 34.84 mm in 23.38 ms": _reading(
                other, "its stroke and duration are fitted"
            ),
            "Start and conditions": _conditions(default),
        },
    )


def _reading(machines: dict[str, ContactMachine], fitted: str) -> list[PrintedAndOurs]:
    picture = f"the paper gives the law of motion only as a picture; {fitted} to all printed times"
    stroke = machines["original"].parameters["stroke_m"] * 1e3
    rows: list[PrintedAndOurs] = [
        ("end of the motion of element 1", "mm", 32.6, stroke, "" if abs(stroke - 32.6) < _CLOSE_MM else picture)
    ]
    for design, machine in machines.items():
        ours = forward_stroke(machine)
        takes_ms = (ours.deceleration_s - ours.pad_s) * 1e3
        both = f"17.96 and 18.15 ms exclude each other: touch to largest deceleration takes {takes_ms:.2f} ms, not 0.19"
        why = both if design == "optimised" else ""
        rows.append((f"{design}: pad reached", "ms", PAD_REACHED_MS[design], ours.pad_s * 1e3, picture))
        printed = LARGEST_DECELERATION_MS[design]
        rows.append((f"{design}: largest acceleration of 2", "ms", printed, ours.deceleration_s * 1e3, why))
        once = "printed once for both designs"
        rows.append((f"{design}: elements 2 and 3 meet", "ms", COLLETS_MEET_MS, ours.contact_s * 1e3, once))
        stated = "leaves" if design == "original" else "does not leave"
        leaves = ours.leaves_pin_m * 1e3
        against = "against print: why the pad begins at 94.9 mm by default"
        odd = against if design == "optimised" and leaves > _CLOSE_MM else ""
        rows.append((f"{design}: element 2 leaves its pin by", "mm", stated, leaves, odd))
    return rows


_CLOSE_MM = 0.1


def _conditions(machines: dict[str, ContactMachine]) -> list[PrintedAndOurs]:
    rows: list[PrintedAndOurs] = []
    for design, printed in (("original", 71.8), ("optimised", 66.8)):
        start = machines[design].start[0] * 1e3
        why = "Tab. 2 starts element 2 against its pin, 0.1 mm further than lp1 of Tab. 3"
        rows.append((f"{design}: element 2 over 1 at its pin", "mm", printed, start, why))
    for design, machine in machines.items():
        p = machine.parameters
        gap = (machine.start[0] + p["value_d_m"] - machine.start[1] - p["value_a_m"]) * 1e3
        rows.append((f"{design}: gap between F and G at the start", "mm", None, gap, ""))
    return [
        *rows,
        ("Eq. 1: pad's compression counts in", "", "m", "mm", "in metres the pad would be softer than the springs"),
        ("Eq. 13: pad's force acts", "", "always", "in contact", "as Eq. 18 and the text say"),
        ("Eq. 16: cone, position of 3 over that of", "", "element 2", "element 1", "else F and G could never meet"),
        ("pad begins at", "mm", "94.9, 98.9", "94.9", "printed twice: Eq. 5, 9, 13 and Eq. 17, 18; a parameter here"),
    ]
