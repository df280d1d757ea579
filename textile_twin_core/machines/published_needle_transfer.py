"""What the paper prints of the needle transfer, beside what its model gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.contact.mode import derivative
from textile_twin_core.contact.polynomials import first_crossing, value
from textile_twin_core.machines.needle_transfer import (
    COLLETS,
    DESIGNS,
    PAD,
    NeedleTransferMachine,
    needle_transfer,
)
from textile_twin_core.machines.published import PublishedRow

PAPER = "Pejchar and Beran 2011"

OTHER_READING = {
    "pad_position_m": 0.0989,
    "motion_law": "cycloidal",
    "stroke_m": 0.03484,
    "forward_duration_s": 0.02338,
}
"""The pad where Eq. 17 and 18 put it: stroke and duration of the forward motion fitted to the printed times."""


@dataclass(frozen=True)
class ForwardStroke:
    """What the paper tells of the forward motion: times [s] from its start, and how far element 2 leaves the pin."""

    pad_s: float
    deceleration_s: float
    contact_s: float
    leaves_pin_m: float


def forward_stroke(machine: NeedleTransferMachine) -> ForwardStroke:
    """The forward motion from the published start to a little after its end.

    Times are roots of the motion's own power series, not samples: pad reached, acceleration of element 2 largest on it
    (its derivative vanishes), first contact of elements 2 and 3; the gap at the pin is that before the pad is reached.
    """
    run = machine.simulate(end_s=1.5 * machine.parameters["forward_duration_s"])
    pad_s = run.happened("touch", PAD)[0].time_s
    contact_s = run.happened("impact", COLLETS)[0].time_s
    leaves = 0.0
    deceleration_s = pad_s
    for segment in run.segments:
        if segment.end_s <= pad_s:
            gap = segment.positions[2] - segment.positions[0]
            gap[0] += machine.start_m[0]
            turn = first_crossing(derivative(gap), 1e-15)
            leaves = max(leaves, value(gap, 1.0), 0.0 if turn is None else value(gap, turn))
        elif deceleration_s == pad_s:
            jerk = derivative(derivative(derivative(segment.positions[0])))
            turn = first_crossing(-jerk, 1e-12 * float(np.abs(jerk).max()))
            if turn is not None:
                deceleration_s = segment.start_s + turn * segment.span_s
    return ForwardStroke(pad_s, deceleration_s, contact_s, leaves)


def needle_transfer_rows() -> tuple[PublishedRow, ...]:
    """The printed times of both designs, with both readings of where the pad begins."""
    default = {design: forward_stroke(needle_transfer(design=design)) for design in DESIGNS}
    other = {design: forward_stroke(needle_transfer(design=design, **OTHER_READING)) for design in DESIGNS}
    reading = needle_transfer().parameters["forward_duration_s"] * 1e3
    fitted = f"law and duration are not printed: modified sine, {reading:.3f} ms (fitted)"
    printed = {
        "original": (15.75, 16.10, 19.23),
        "optimised": (17.96, 18.15, 19.23),
    }
    rows = [
        PublishedRow(PAPER, "stroke of element 1", "mm", 32.6, _stroke_mm(), "printed; the default law ends there"),
    ]
    for design in DESIGNS:
        names = ("pad reached", "largest acceleration of element 2", "contact of elements 2 and 3")
        for k, name in enumerate(names):
            times = [_times(part)[k] for part in (default[design], other[design])]
            rows.append(
                PublishedRow(
                    PAPER,
                    f"{design}: {name}",
                    "ms",
                    printed[design][k],
                    times[0],
                    _reason(design, k, fitted, times[1]),
                )
            )
        rows.append(
            PublishedRow(
                PAPER,
                f"{design}: element 2 leaves the pin by",
                "mm",
                "leaves" if design == "original" else "does not leave",
                default[design].leaves_pin_m * 1e3,
                f"only said in words; pad at 0.0989 m: {other[design].leaves_pin_m * 1e3:.2f} mm",
            )
        )
    return tuple(rows)


def _times(stroke: ForwardStroke) -> tuple[float, float, float]:
    return stroke.pad_s * 1e3, stroke.deceleration_s * 1e3, stroke.contact_s * 1e3


def _reason(design: str, row: int, fitted: str, other: float) -> str:
    second = f"pad at 0.0989 m, cycloidal 34.84 mm in 23.38 ms (both fitted): {other:.2f} ms"
    if design == "optimised" and row == 1:
        return f"17.96 and 18.15 cannot both be: from touch to largest deceleration takes 0.31 to 0.40 ms; {second}"
    if row == 2:
        return f"one time is printed for both designs; {second}"
    return f"{fitted}; {second}"


def _stroke_mm() -> float:
    machine = needle_transfer()
    return machine.law.evaluate(machine.parameters["return_start_rad"]) * 1e3
