"""textile-twin calibrate: encoder and torque sensor of a machine settled from a recording."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.readings import read_samples, readings_of
from textile_twin_core.cli.sensor_options import add_sensors, with_sensors
from textile_twin_core.comparison import calibrate

if TYPE_CHECKING:
    from textile_twin_core.comparison import Calibration, Estimate


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "calibrate",
        "Settles direction, ratio and zero of the encoder, and sign, unit, gain, offset and delay of the torque\n"
        "sensor from a recording, and writes the machine with them. What the recording cannot tell apart is named. A\n"
        "recording with rest, run-up and coast-down tells most.",
        "textile-twin calibrate bags/tufting_160rpm_synthetic --machine tufting --out my_machine.yaml",
    )
    add_recording(parser)
    add_machine(parser, option=True)
    add_sensors(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="machine file to write (.yaml)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers; is replaced when it is there")
    parser.add_argument("--force", action="store_true", help="replace the machine file when it is there")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Calibrate, write, tell."""
    machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)

    from textile_twin_core.files import save_machine_file, staged

    if arguments.out.suffix not in (".yaml", ".yml"):
        raise UsageError(f"--out {arguments.out}: must end in .yaml")
    if arguments.out.exists() and not arguments.force:
        raise UsageError(f"--out {arguments.out}: is there already; choose another name, or replace it with --force")
    _, angles, measured = read_samples(arguments, machine)
    found = calibrate(readings_of(angles, measured), machine)
    if arguments.json is not None:
        about = {"bag": str(arguments.bag), "machine": machine.name}
        text = json.dumps({**about, **found.to_json()}, indent=1, allow_nan=False)
        with staged(arguments.json) as partial:
            partial.write_text(text + "\n", encoding="utf-8")
    if found.angle_unit != "radians":
        raise UsageError(
            f"{arguments.bag}: the angle is in {found.angle_unit}, and messages hold radians; record it in radians, or"
            " make the recording again from its log with textile-twin import, which converts it"
        )
    save_machine_file(found.machine, arguments.out)
    _print(found)


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
    rows += [("was wrong", cause.text) for cause in found.assessment.verdict]
    rows += [("not told", f"{each.text}; it takes {each.recording}") for each in found.ambiguous]
    rows += [("note", note) for note in found.assessment.notes]
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {value}")


def _text(estimate: Estimate, unit: str) -> str:
    if not math.isfinite(estimate.sigma):
        return f"{estimate.value:.5g} {unit} (as configured)".replace("  ", " ")
    return f"{estimate.value:.5g} +- {estimate.sigma:.2g} {unit}".rstrip()
