"""textile-twin identify: forces, friction, inertia, event angles and sensors of a machine from a recording."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import add_outputs, check_out, print_rows, write_json
from textile_twin_core.cli.progress import Stage, stages
from textile_twin_core.cli.readings import read_samples, read_second, readings_of
from textile_twin_core.cli.recording_batch import BatchJob, add_batch, one_recording, quietly, run_batch
from textile_twin_core.cli.sensor_options import add_sensors, with_sensors
from textile_twin_core.comparison import Identification, identify, with_table
from textile_twin_core.comparison.curve_identification import CurveIdentification, identify_curve
from textile_twin_core.comparison.elastic_readings import without_elasticity
from textile_twin_core.comparison.file_numbers import FileNumbers, identify_numbers
from textile_twin_core.comparison.shaft_identification import ShaftIdentification, identify_shaft
from textile_twin_core.files import save_machine_file
from textile_twin_core.inference.curved_torque import place_of
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.prediction import recompute

_SHOWN = {
    "_Nm_rad": ("N m/rad", 1.0),
    "_Nms_rad": ("N m s/rad", 1.0),
    "_rad": ("deg", 180.0 / math.pi),
    "_s": ("ms", 1e3),
    "_N": ("N", 1.0),
    "_Nm": ("N m", 1.0),
}
"""Unit and factor by the end of a name; the first that fits counts."""
_SHARES = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0)
"""Places of a force law that are printed, as shares of its range."""
_PREDICTED = 0.3
"""Share of a pass at which the torque of an elastic shaft is predicted."""
_PASSES = 3
"""Passes on an elastic shaft: each predicts the effect of the twist with the estimates of the pass before."""


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "identify",
        "Fits what the recording determines: force in the backing and above it, friction of the shaft,\n"
        "angles of entry and exit, inertia, and the torque sensor; each with the interval that holds it in 95 of 100\n"
        "recordings. What it does not determine is named before anything is solved. Calibrate the sensors first with\n"
        "textile-twin calibrate.",
        "textile-twin identify bags/tufting_160rpm_synthetic --machine my_machine.yaml --json identified.json",
    )
    add_recording(parser, several=True)
    add_machine(parser, option=True)
    add_sensors(parser)
    add_outputs(parser, machine_required=False)
    parser.add_argument(
        "--free",
        metavar="PATHS",
        help="estimate these numbers of the machine file instead, such as bodies.l3.mass_kg,groups.l2.length_m",
    )
    parser.add_argument(
        "--curve",
        metavar="LOAD|MEASURE",
        help="learn the force over a measure: of a load, as backing, or on a measure, as sley_position_m",
    )
    parser.add_argument(
        "--table",
        action="store_true",
        help="with --out: also write the unmodelled torque by shaft angle, as a load",
    )
    add_batch(parser)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Identify, write the outputs and print the estimates."""
    machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)

    if not one_recording(arguments):
        for option in ("out", "table", "free", "curve"):
            if getattr(arguments, option):
                raise UsageError(f"--{option} is for one recording; of several give --parquet or --json")
        run_batch(arguments, machine, identifying, _line)
        return
    if arguments.table and arguments.out is None:
        raise UsageError("--table writes into the machine file: give --out too")
    if arguments.table and machine.sensors.encoder.cycle_turns > 1:
        raise UsageError("--table writes a load over one turn: leave it out, --json has the table over the whole cycle")
    if arguments.free is not None and arguments.table:
        raise UsageError("--free goes without --table")
    if arguments.curve is not None and (arguments.free is not None or arguments.table):
        raise UsageError("--curve goes without --free and --table")
    check_out(arguments)
    if arguments.free is not None:
        numbers = _numbers_of(arguments, machine)
        write_json(arguments, machine, numbers.to_json())
        if arguments.out is not None:
            save_machine_file(numbers.machine, arguments.out)
        print_rows(_number_rows(numbers))
        return
    found: Identification | ShaftIdentification
    found = _curve_of(arguments, machine) if arguments.curve is not None else identify_recording(arguments, machine)
    write_json(arguments, machine, found.to_json())
    if isinstance(found, ShaftIdentification):
        if arguments.out is not None:
            save_machine_file(found.machine, arguments.out)
        print_rows(_rows(found))
        return
    if arguments.out is not None:
        written = with_table(found.machine, found.unmodelled) if arguments.table else found.machine
        save_machine_file(written, arguments.out)
    _print(found)


def identify_recording(arguments: argparse.Namespace, machine: Machine) -> Identification | ShaftIdentification:
    """Identify parameters of the machine, or of its elastic shaft, from the recording `bag` of the arguments."""
    bag, angles, measured = read_samples(arguments, machine)
    fit = identify if machine.shaft is None else identify_shaft
    readings = readings_of(angles, measured, read_second(arguments, machine, bag))
    with stages(len(angles)) as stage:
        return fit(readings, machine, lambda what, until: stage(what, until, 1))


def _curve_of(arguments: argparse.Namespace, machine: Machine) -> CurveIdentification:
    """Learn the force law that --curve names, without the effect of an elastic shaft: predicted by the law so far."""
    place_of(machine, arguments.curve)  # a wrong name is found before the recording is read
    bag, angles, measured = read_samples(arguments, machine)
    read, estimate = readings_of(angles, measured), machine
    second, passes = read_second(arguments, machine, bag), 1 if machine.shaft is None else _PASSES
    with stages(len(angles)) as stage:
        for k in range(passes):
            rigid = read
            if estimate.shaft is not None:
                done = stage("predicting", (k + _PREDICTED) / passes, 2 * len(angles))
                predicted = recompute(angles, estimate, "smooth", done, second)
                known = (predicted.stamps_ns, predicted.torque_Nm, predicted.settled)
                rigid = without_elasticity(read, estimate, predicted.track, *known)
            found = identify_curve(rigid, machine, arguments.curve, partial(_begin, stage, k, passes))
            estimate = found.machine
    return found


def identifying(job: BatchJob) -> dict[str, Any]:
    """Identify from one recording of several; return the numbers of --json."""
    return quietly(job, lambda arguments, machine: identify_recording(arguments, machine).to_json())


def _line(numbers: Mapping[str, Any]) -> str:
    """Format the numbers of one recording of several in a line."""
    before, after = (
        "unknown" if numbers[name] is None else f"{numbers[name]:.4g}" for name in ("rms_before_Nm", "rms_after_Nm")
    )
    lost = ", ".join(numbers["not_identifiable"])
    return (
        f"{len(numbers['parameters'])} parameters, RMS error {before} N m before and {after} N m after"
        + f"; not identifiable: {lost}" * bool(lost)
    )


def _rows(found: Identification | ShaftIdentification) -> list[tuple[str, str]]:
    """Rows of parameters and residuals for display."""
    rows = []
    for name, each in found.parameters.items():
        unit, factor = next((shown for end, shown in _SHOWN.items() if name.endswith(end)), ("", 1.0))
        low, high = (end * factor for end in each.interval95)
        value = f"{each.value * factor:.5g} +- {each.sigma * factor:.2g} {unit}"
        rows.append((name, f"{value:34}  95 %: {low:.5g} .. {high:.5g}"))
    at = ", at the shaft" if isinstance(found, ShaftIdentification) else ""
    rows += [
        ("RMS error before", f"{found.rms_before_Nm:.4g} N m{at}"),
        ("RMS error after", f"{found.rms_after_Nm:.4g} N m{at}"),
    ]
    if isinstance(found, ShaftIdentification) and math.isfinite(found.second_rms_rad[0]):
        before, after = (math.degrees(each) for each in found.second_rms_rad)
        rows.append(("second encoder, RMS error", f"{before:.3g} deg before, {after:.3g} deg after"))
    return rows


def _numbers_of(arguments: argparse.Namespace, machine: Machine) -> FileNumbers:
    """Estimate the numbers of the machine file that --free names."""
    paths = [path.strip() for path in arguments.free.split(",") if path.strip()]
    _, angles, measured = read_samples(arguments, machine)
    with stages(len(angles)) as stage:
        return identify_numbers(readings_of(angles, measured), machine, paths, partial(_begin, stage, 0, 1))


def _begin(stage: Stage, k: int, passes: int, what: str, until: float) -> None:
    stage(what, (k + until) / passes, 1)


def _number_rows(found: FileNumbers) -> list[tuple[str, str]]:
    """Rows of the file's numbers for display, given its tolerances and given it exactly."""
    rows = []
    for path, each in found.parameters.items():
        exact = found.given_file[path]
        unit = f" {found.unit[path]}".rstrip()
        text = f"{each.value:.5g} +- {each.sigma:.2g}{unit} given the file's tolerances"
        rows.append((path, f"{text}; {exact.value:.5g} +- {exact.sigma:.2g}{unit} given the file exactly"))
    rows += [("not identifiable", path) for path in found.not_identifiable]
    return rows + [("note", text) for text in found.notes]


def _curve_rows(found: CurveIdentification) -> list[tuple[str, str]]:
    """Rows of the force laws: a few places of each, and the work of a turn."""
    rows = []
    for name, curve in found.curves.items():
        for way, force, sigma in (("in", curve.in_N, curve.in_sigma_N), ("out", curve.out_N, curve.out_sigma_N)):
            some = [round(k) for k in (share * (curve.knots.size - 1) for share in _SHARES)]
            shown = ", ".join(f"{force[k]:.0f} +- {sigma[k]:.0f}" for k in some)
            rows.append((f"{name}, way {way}", f"{shown} N"))
        places = ", ".join(f"{1e3 * (curve.knots[k] - curve.knots[0]):.1f}" for k in some)
        rows.append((f"{name}, depth", f"{places} mm beyond {curve.measure} = {curve.knots[0]:.5g} m"))
        work_in, sigma_in, work_out, sigma_out = curve.work_J()
        rows.append(
            (
                f"{name}, work",
                f"{work_in:.3g} +- {sigma_in:.2g} J in, {work_out:.3g} +- {sigma_out:.2g} J out, a stroke",
            )
        )
    return rows


def _print(found: Identification) -> None:
    rows = _rows(found)
    if isinstance(found, CurveIdentification):
        rows = [*_curve_rows(found), *rows]
    unmodelled = found.unmodelled
    over = f" over {unmodelled.cycle_turns} turns" if unmodelled.cycle_turns > 1 else ""
    if unmodelled.significant:
        rows.append(
            (
                "not modelled",
                f"a torque by shaft angle{over} of up to {float(abs(unmodelled.torque_Nm).max()):.3g} N m,"
                f" {unmodelled.share * 100.0:.0f} % of the residual",
            )
        )
    lost = [each.text for each in found.not_identifiable]
    rows += [("not identifiable", text) for text in lost]
    rows += [("note", text) for text in found.notes if text not in lost]
    print_rows(rows)
