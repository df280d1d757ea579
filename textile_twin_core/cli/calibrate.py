"""textile-twin calibrate: encoder and torque sensor of a machine, estimated from a recording."""

from __future__ import annotations

import argparse
import math

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import add_outputs, check_out, print_rows, write_json
from textile_twin_core.cli.progress import stages
from textile_twin_core.cli.readings import read_samples, readings_of
from textile_twin_core.cli.sensor_options import add_sensors, with_sensors
from textile_twin_core.comparison import Calibration, Estimate, Readings, calibrate
from textile_twin_core.comparison.driven_speed import driven_rows, driven_speed
from textile_twin_core.files import save_machine_file
from textile_twin_core.machine import Machine

_MUCH_LESS = 0.9
"""Share of the RMS error below which the residual without friction and loads is printed."""


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "calibrate",
        "Calibrates direction, ratio and zero of the encoder, and sign, unit, gain, offset and delay of the torque\n"
        "sensor from a recording, and writes the machine with them. What the recording cannot separate is named. A\n"
        "recording with standstill, run-up and coast-down determines most.",
        "textile-twin calibrate bags/tufting_160rpm_synthetic --machine tufting --out my_machine.yaml",
    )
    add_recording(parser)
    add_machine(parser, option=True)
    add_sensors(parser)
    add_outputs(parser, machine_required=True)
    parser.add_argument(
        "--wheel",
        action="store_true",
        help="estimate a toothed wheel's pitch errors and the flywheel's inertia instead, from the speed under the"
        " measured torque",
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Calibrate, write the outputs and print the estimates."""
    machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)

    check_out(arguments)
    _, angles, measured = read_samples(arguments, machine)
    readings = readings_of(angles, measured)
    if arguments.wheel:
        _settle_wheel(arguments, machine, readings)
        return

    with stages(len(angles)) as stage:
        found = calibrate(readings, machine, lambda what, until: stage(what, until, 1))
    write_json(arguments, machine, found.to_json())
    if found.angle_unit != "radians":
        raise UsageError(
            f"{arguments.bag}: the angle is in {found.angle_unit}, and messages hold radians; give --angle-unit"
            " (deg, rev, gon, or the counts of a turn), or record it in radians"
        )
    save_machine_file(found.machine, arguments.out)
    _print(found)


def _settle_wheel(arguments: argparse.Namespace, machine: Machine, readings: Readings) -> None:
    """Estimate pitch errors and inertia from the speed under the measured torque."""
    if not machine.sensors.encoder.teeth:
        raise UsageError("--wheel: this machine's encoder has no teeth")
    with stages(readings.angle.size) as stage:
        stage("settling", 1.0, 1)
        driven = driven_speed(readings, machine)
    write_json(arguments, machine, driven.to_json())
    save_machine_file(driven.machine, arguments.out)
    print_rows(driven_rows(driven))


def _print(found: Calibration) -> None:
    rows = [
        ("encoder direction", f"{found.direction:+d}"),
        ("encoder ratio", f"{found.ratio:.6g}"),
        ("encoder zero", _text(found.zero_rad.scaled(180.0 / math.pi), "deg")),
        ("torque sign", f"{found.sign:+d}"),
        ("torque unit", found.unit),
        ("torque gain", _text(found.gain, "")),
        ("torque offset", _text(found.offset_Nm, "N m")),
        ("torque delay", _text(found.delay_s.scaled(1e3), "ms")),
        ("RMS error before", f"{found.rms_before_Nm:.4g} N m"),
        ("RMS error after", f"{found.rms_after_Nm:.4g} N m"),
    ]
    if found.rms_beside_Nm < _MUCH_LESS * found.rms_after_Nm:
        rows += [("  friction, loads fitted", f"{found.rms_beside_Nm:.4g} N m; the file has them as before: identify")]
    rows += [("was wrong", cause.text) for cause in found.assessment.verdict]
    rows += [("ambiguous", f"{each.text}; {each.recording}") for each in found.ambiguous]
    rows += [("note", note) for note in found.assessment.notes]
    print_rows(rows)


def _text(estimate: Estimate, unit: str) -> str:
    if not math.isfinite(estimate.sigma):
        return f"{estimate.value:.5g} {unit} (as configured)".replace("  ", " ")
    return f"{estimate.value:.5g} +- {estimate.sigma:.2g} {unit}".rstrip()
