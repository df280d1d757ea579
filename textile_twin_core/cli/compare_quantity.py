"""textile-twin compare --quantity: comparison of a measured displacement, angle or speed with the machine's."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from textile_twin_core import views
from textile_twin_core.cli.mistakes import UsageError, nearest
from textile_twin_core.cli.outputs import print_rows, save, write_json
from textile_twin_core.cli.progress import stages
from textile_twin_core.cli.readings import read_angles, read_samples, readings_of, tell_unit
from textile_twin_core.comparison.driven_speed import driven_rows, driven_speed
from textile_twin_core.comparison.quantity import QuantityComparison, Trace, compare_quantity, shown_unit
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.log_apply import MEASURED

SPEED = "speed"


def run(arguments: argparse.Namespace, machine: Machine, limits: Iterable[str] = ()) -> None:
    """Compare, print and write; `limits` are options that apply to torques only."""
    for form in ("rrd", "html"):
        if getattr(arguments, form) is not None:
            raise UsageError(f"--{form} shows torques; with --quantity give --json or --png")
    for limit in limits:
        if getattr(arguments, limit.replace("-", "_")) is not None:
            raise UsageError(f"--{limit} is a limit of torques; with --quantity use the numbers of --json")
    if arguments.predicted == "recorded":
        raise UsageError("--predicted recorded applies to torques; --quantity is computed from the angles")
    if arguments.quantity == SPEED:
        if arguments.png is not None:
            raise UsageError("--png shows a quantity over the shaft angle; with --quantity speed give --json")
        _, angles, measured = read_samples(arguments, machine)
        tell_unit(angles)
        with _bar(len(angles)):
            driven = driven_speed(readings_of(angles, measured), machine)
        rows, numbers = driven_rows(driven), driven.to_json()
    else:
        found = _compared(arguments, machine)
        rows, numbers = _rows(found), found.to_json()
        save(arguments.png, lambda path: views.plot_quantity(path, found, machine.name))
    print_rows(rows)
    write_json(arguments, machine, numbers)


def _compared(arguments: argparse.Namespace, machine: Machine) -> QuantityComparison:
    if arguments.quantity not in machine.outputs:
        known = nearest(arguments.quantity, machine.outputs)
        raise UsageError(f"--quantity {arguments.quantity}: no such output; {known}")
    trace = _trace(arguments, machine)
    with _bar(trace.angle_rad.size):
        return compare_quantity(trace, machine, arguments.quantity)


@contextmanager
def _bar(samples: int) -> Iterator[None]:
    with stages(samples) as stage:
        stage("comparing", 1.0, 1)
        yield


def _trace(arguments: argparse.Namespace, machine: Machine) -> Trace:
    bag, angles = read_angles(arguments, machine)
    tell_unit(angles)
    seen = bag.read_angles(f"{MEASURED}/{arguments.quantity}", arguments.quantity)
    return Trace(seen.stamps, seen.angles_rad, angles.stamps, angles.angles_rad, angles.velocities)


def _rows(found: QuantityComparison) -> list[tuple[str, str]]:
    unit, factor = shown_unit(found.name)
    rows = [
        ("quantity", found.name),
        ("samples", f"{found.time_s.size}"),
        ("scale", _estimate_text(found.scale, 1.0, "")),
        ("offset", _estimate_text(found.offset, factor, unit)),
        ("delay", _estimate_text(found.delay_s, 1e3, "ms")),
        ("encoder zero, beside the machine file's", _estimate_text(found.zero_rad, 180.0 / math.pi, "deg")),
        ("shaft speed, usual", f"{found.speed_rad_s * 30.0 / math.pi:.1f} rpm"),
        ("range over a turn, measured", f"{found.measured_range * factor:.3f} {unit}".rstrip()),
        ("range over a turn, machine", f"{found.machine_range * factor:.3f} {unit}".rstrip()),
        ("RMS error as configured", f"{found.rms_configured * factor:.4g} {unit}".rstrip()),
        ("RMS error after fit", f"{found.rms * factor:.4g} {unit}".rstrip()),
        ("explained", f"{found.explained:.4%}"),
    ]
    if found.at_rest:
        note = f"{found.at_rest} samples at standstill are skipped: dry friction is undetermined there"
        rows.append(("note", note))
    if found.one_speed:
        rows.append(
            (
                "note",
                "at one speed a delay equals an encoder zero; all of it is taken as delay",
            )
        )
    return rows


def _estimate_text(each: Estimate, factor: float, unit: str) -> str:
    if not math.isfinite(each.sigma):
        return f"{each.value * factor:.5g} {unit}".rstrip() + ", not fitted"
    return f"{each.value * factor:.5g} +- {each.sigma * factor:.2g} {unit}".rstrip()
