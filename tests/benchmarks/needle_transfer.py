"""Error against cost on the needle transfer: event-driven, solve_ivp with events, penalty contact.

One run is the forward stroke of the original design from rest to the first contact of elements 2 and 3; the error is
the larger one of the times at which the pad and that contact are reached, against a calculation with 30 digits.

Run from the root of the repository: python -m tests.benchmarks.needle_transfer [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import mpmath as mp
import numpy as np
from scipy.integrate import solve_ivp

from tests.contact.needle_reference import Stroke
from textile_twin_core.machines.needle_transfer import COLLETS, PAD, needle_transfer

MACHINE = needle_transfer()
LAW, SPEED = MACHINE.law, MACHINE.speed_rad_s
DURATION = MACHINE.parameters["forward_duration_s"]
END = 0.0195
START = [0.0719, 0.0, 0.0929, 0.0]
PAD_AT, PIN_AT, CONE_AT, MEET_AT = 0.0949, 0.0719, 0.0929, 0.0547 - 0.0268
M2, M3 = 0.0426, 0.0051

Times = tuple[float, float]


@dataclass(frozen=True)
class Row:
    """One method at one setting."""

    method: str
    setting: str
    error_s: float
    ms_per_run: float


def jacket(t: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration of element 1."""
    angle = SPEED * min(t, DURATION)
    return LAW.evaluate(angle), LAW.evaluate(angle, 1) * SPEED, LAW.evaluate(angle, 2) * SPEED**2


def forces(x1: float, v1: float, y: np.ndarray, on_pad: bool) -> tuple[float, float]:
    """Force on elements 2 and 3 by Eq. 13 and 14."""
    x2, v2, x3, v3 = y
    pull = 690.0 * (x3 - x2 - 0.0373) + 3.32 * (v3 - v2)
    on_2 = -900.0 * (x2 - x1 - 0.089) - 13.16 * (v2 - v1) + pull
    if on_pad:
        mm = (x2 - PAD_AT) * 1e3
        on_2 -= 1573.9 * mm**3 - 2e-10 * mm**2 + 445.17 * mm + 28.5 * v2
    return on_2, -pull


def event_driven(tolerance: float) -> Times:
    """This package."""
    run = MACHINE.simulate(end_s=END, tolerance=tolerance)
    return run.happened("touch", PAD)[0].time_s, run.happened("impact", COLLETS)[0].time_s


def solver_with_events(method: str, tolerance: float) -> Times:
    """scipy's solve_ivp, one call per mode, ended by its terminal events."""
    t, y = 0.0, np.array(START)
    pin, cone, pad = True, True, False
    touched = 0.0
    while t < END:

        def right_side(t: float, y: np.ndarray, pin: bool = pin, cone: bool = cone, pad: bool = pad) -> list[float]:
            x1, v1, a1 = jacket(t)
            on_2, on_3 = forces(x1, v1, y, pad)
            return [v1 if pin else y[1], a1 if pin else on_2 / M2, v1 if cone else y[3], a1 if cone else on_3 / M3]

        watch: dict[str, Callable[[float, np.ndarray], float]] = {
            "pad": (lambda t, y: y[0] - PAD_AT) if pad else (lambda t, y: PAD_AT - y[0]),
            "meet": lambda t, y: y[0] + MEET_AT - y[2],
            "pin": (lambda t, y, pad=pad: forces(*jacket(t)[:2], y, pad)[0] - M2 * jacket(t)[2])
            if pin
            else (lambda t, y: jacket(t)[0] + PIN_AT - y[0]),
            "cone": (lambda t, y, pad=pad: forces(*jacket(t)[:2], y, pad)[1] - M3 * jacket(t)[2])
            if cone
            else (lambda t, y: jacket(t)[0] + CONE_AT - y[2]),
        }
        for function in watch.values():
            function.terminal = True  # type: ignore[attr-defined]
            function.direction = -1.0  # type: ignore[attr-defined]
        part = solve_ivp(
            right_side, (t, END), y, method, rtol=tolerance, atol=tolerance * 1e-3, events=list(watch.values())
        )
        t, y = float(part.t[-1]), part.y[:, -1]
        hit = next((name for name, at in zip(watch, part.t_events, strict=True) if at.size), "")
        if hit == "meet":
            return touched, t
        if hit == "pad":
            touched = touched or t
            pad, pin = not pad, pin and pad
        elif hit == "pin":
            pin = not pin
            y[1] = jacket(t)[1] if pin else y[1]
        elif hit == "cone":
            cone = not cone
            y[3] = jacket(t)[1] if cone else y[3]
    return touched, float("inf")


def penalty(stiffness: float, tolerance: float) -> Times:
    """Stops as stiff springs, damped after Hunt and Crossley; the whole stroke in one call of solve_ivp (LSODA)."""

    def stop(depth: float, rate: float) -> float:
        return max(stiffness * depth * (1.0 + 10.0 * rate), 0.0) if depth > 0.0 else 0.0

    def right_side(t: float, y: np.ndarray) -> list[float]:
        x1, v1, _ = jacket(t)
        on_2, on_3 = forces(x1, v1, y, bool(y[0] > PAD_AT))
        on_2 -= stop(y[0] - x1 - PIN_AT, y[1] - v1)
        on_3 -= stop(y[2] - x1 - CONE_AT, y[3] - v1)
        return [y[1], on_2 / M2, y[3], on_3 / M3]

    def pad(t: float, y: np.ndarray) -> float:
        return PAD_AT - float(y[0])

    def meet(t: float, y: np.ndarray) -> float:
        return float(y[0] + MEET_AT - y[2])

    pad.direction = meet.direction = -1.0  # type: ignore[attr-defined]
    meet.terminal = True  # type: ignore[attr-defined]
    part = solve_ivp(right_side, (0.0, END), START, "LSODA", rtol=tolerance, atol=tolerance * 1e-4, events=(pad, meet))
    touched, met = part.t_events
    return float(touched[0]) if touched.size else float("inf"), float(met[0]) if met.size else float("inf")


def rows(repeats: int = 5) -> list[Row]:
    """The table: methods interleaved, medians of the processor time of `repeats` runs."""
    with mp.workdps(30):
        stroke = Stroke("0.0719", "0.0949", "modified_sine", "0.0326", str(DURATION), contacts=1).run(str(END))
    reference = tuple(
        float(next(at for at, name in stroke.events if name == wanted)) for wanted in ("pad touched", "F-G")
    )
    cases: list[tuple[str, str, Callable[[], Times]]] = []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-13):
        cases.append(("event-driven", f"tolerance {tolerance:g}", lambda a=tolerance: event_driven(a)))
    tolerances = {"RK45": (1e-4, 1e-7, 1e-10), "DOP853": (1e-4, 1e-7, 1e-10, 1e-13), "Radau": (1e-4, 1e-7)}
    for method in tolerances:
        for tolerance in tolerances[method]:
            cases.append(
                (
                    f"solve_ivp {method} with events",
                    f"rtol {tolerance:g}",
                    lambda a=method, b=tolerance: solver_with_events(a, b),
                )
            )
    for stiffness in (1e5, 1e6, 1e7, 1e8):
        cases.append(("penalty contact, LSODA", f"{stiffness:g} N/m", lambda a=stiffness: penalty(a, 1e-9)))
    spent: dict[tuple[str, str], list[float]] = {case[:2]: [] for case in cases}
    errors: dict[tuple[str, str], float] = {}
    for _ in range(repeats):
        for method, setting, work in cases:
            began = time.process_time()
            found = work()
            spent[method, setting].append(time.process_time() - began)
            errors[method, setting] = max(abs(a - b) for a, b in zip(found, reference, strict=True))
    return [Row(*key, errors[key], 1e3 * statistics.median(spent[key])) for key in spent]


def main() -> None:
    """Print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    table = rows(arguments.repeats)
    print(f"{'method':32s} {'setting':18s} {'error [s]':>10s} {'ms per run':>11s}")
    for row in table:
        print(f"{row.method:32s} {row.setting:18s} {row.error_s:10.1e} {row.ms_per_run:11.1f}")
    if arguments.json:
        arguments.json.write_text(json.dumps({"rows": [asdict(row) for row in table]}, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
