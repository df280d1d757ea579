"""textile-twin simulate: outputs of a machine over a given motion of the shaft."""

from __future__ import annotations

import argparse
import math
from itertools import groupby
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.cli.arguments import Parser, add_machine, number, positive, shaft_speed
from textile_twin_core.cli.arguments import samples as sample_count
from textile_twin_core.cli.mistakes import UsageError, nearest, tell
from textile_twin_core.cli.named_machine import load_machine
from textile_twin_core.cli.outputs import check_output, keep_input
from textile_twin_core.cli.progress import progress, stages
from textile_twin_core.contact import ContactEvent
from textile_twin_core.errors import SceneError
from textile_twin_core.files import MotionTable, read_motion_table, staged, write_table
from textile_twin_core.files.motion_table import looks_like_degrees, rotation_mismatch
from textile_twin_core.machine import AnyMachine
from textile_twin_core.twin import compile_machine

_SAMPLES = 360
_MOST_EVENTS = 40
_BOUNCES = ("impact", "rest")
_SUFFIXES = (".csv", ".parquet", ".mcap")
_COMPUTED = 0.6
"""Share of the work for computing the outputs."""


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "simulate",
        "Outputs of a machine over a motion of its shaft: one turn at constant speed, or a table of motion.",
        "textile-twin simulate tufting --rpm 160 --samples 360 --out turn.csv",
    )
    add_machine(parser, option=False)
    parser.add_argument("--rpm", type=shaft_speed, metavar="R", help="one turn at this constant speed")
    parser.add_argument(
        "--samples",
        type=sample_count,
        metavar="N",
        help=f"samples of the turn, at theta = 2 pi k/N (default {_SAMPLES})",
    )
    parser.add_argument(
        "--input",
        type=Path,
        metavar="MOTION",
        help="a .csv or .parquet table with the columns theta_rad, omega_rad_s, alpha_rad_s2 and perhaps time_s",
    )
    parser.add_argument(
        "--outputs",
        metavar="A,B",
        help="names of outputs, with commas between (textile-twin machines MACHINE lists them); default: those of the"
        " machine file's scene, otherwise the balancing torque with its parts and the motion of needle, beater or sley",
    )
    parser.add_argument("--method", choices=["exact", "table", "auto"], help="default: the scene's, otherwise auto")
    parser.add_argument("--tolerance", type=positive, help="error over peak that --method table may make")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help=".csv, .parquet or .mcap; overwritten if it exists. An .mcap holds what the machine file's encoder and"
        " torque sensor would say",
    )
    parser.add_argument(
        "--png", type=Path, metavar="FILE", help="draw the machine and its curves over one turn, at --rpm if given"
    )
    parser.add_argument(
        "--at",
        type=number,
        metavar="DEG",
        help="with --png: shaft angle at which the linkage is drawn; default: where its links cover each other least",
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Simulate, and write the table or recording, the picture, or both."""
    if arguments.out is None and arguments.png is None:
        raise UsageError("nothing to write: give --out for a table or recording, or --png for a picture")
    check_output("--png", arguments.png, ".png")
    check_output("--out", arguments.out, *_SUFFIXES)
    keep_input(arguments.out, arguments.input)
    machine = load_machine(arguments.machine, arguments.set)
    if arguments.out is None:
        _draw(arguments, machine)
        return
    # Check all requests before the first file is written.
    names, motion = _outputs(machine, arguments.outputs), _motion(arguments)
    if arguments.png is not None:
        _draw(arguments, machine)
    with stages(len(motion)) as stage:
        stage("computing", _COMPUTED, 1)
        values, events = _evaluate(arguments, machine, names, motion)
        done = stage("writing", 1.0, len(motion))
        if arguments.out.suffix == ".mcap":
            from textile_twin_core.recordings.simulated_bag import write_simulated_bag

            write_simulated_bag(arguments.out, machine, motion, values)
        else:
            write_table(arguments.out, motion.columns() | values, done)
    _tell_gaps(machine, motion, values)
    print(f"{arguments.out}: {len(motion)} samples of {len(names)} outputs")
    if events:
        _print_events(events)


def _draw(arguments: argparse.Namespace, machine: AnyMachine) -> None:
    """Draw the picture of the machine."""
    from textile_twin_core.views import plot_machine

    with staged(arguments.png) as partial, progress(1, "drawing", " pictures", long=1):
        plot_machine(partial, machine, rpm=arguments.rpm, at_deg=arguments.at)
    print(f"{arguments.png}: {arguments.machine}")


def _evaluate(
    arguments: argparse.Namespace, machine: AnyMachine, names: list[str], motion: MotionTable
) -> tuple[dict[str, FloatArray], list[ContactEvent]]:
    """Evaluate the outputs over the motion, and return them with impacts and touches, if the machine has them."""
    method, tolerance = arguments.method or machine.scene.method, arguments.tolerance or machine.scene.tolerance
    twin = compile_machine(machine, names, method=method, tolerance=tolerance)
    columns = (motion.theta_rad, motion.omega_rad_s, motion.alpha_rad_s2)
    found = twin.evaluate(*columns, time=motion.time_s)
    return {name: found[name] for name in names}, list(twin.events)


def _tell_gaps(machine: AnyMachine, motion: MotionTable, values: dict[str, FloatArray]) -> None:
    """Report where outputs are NaN: beyond the declared part of the turn, or at a change point."""
    missing = np.flatnonzero(np.any([np.isnan(column) for column in values.values()], axis=0))
    if missing.size:
        tell(
            f"{missing.size} of {len(motion)} samples are nan, the first at a shaft angle of"
            f" {math.degrees(motion.theta_rad[missing[0]]):.4f} deg: there machine '{machine.name}' cannot close, or"
            " its motion is not determined"
        )


def _print_events(events: list[ContactEvent]) -> None:
    """Print the instants between samples; consecutive bounces on one stop share a line."""
    lines: list[str] = []
    for (_, name), group in groupby(events, key=lambda event: (event.kind in _BOUNCES, event.name)):
        several = list(group)
        kinds = " ".join(dict.fromkeys(event.kind for event in several))
        first, last = (f"{event.time_s * 1e3:.4f}" for event in (several[0], several[-1]))
        when = first if len(several) == 1 else f"{first} .. {last}"
        bounces = sum(event.kind == "impact" for event in several)
        impulse = max(abs(event.impulse_Ns) for event in several)
        hit = f", {bounces} impacts" * (bounces > 1) + f", impulse {impulse:.4g} N s" * (impulse > 0.0)
        lines.append(f"{when:>24} ms  {name} {kinds}{hit}")
    if len(lines) > _MOST_EVENTS:
        lines[_MOST_EVENTS:] = [f"and {len(lines) - _MOST_EVENTS} more"]
    print("\n".join(lines))


def _outputs(machine: AnyMachine, asked: str | None) -> list[str]:
    """Return the names of the outputs, checked against the machine."""
    if asked is None:
        return list(machine.shown_outputs)
    names = list(dict.fromkeys(name.strip() for name in asked.split(",") if name.strip()))
    if not names:
        raise SceneError("--outputs names nothing; give names with commas between, such as balancing_torque_Nm")
    for name in names:
        if name not in machine.outputs:
            raise SceneError(f"machine '{machine.name}' has no output '{name}'; {nearest(name, machine.outputs)}")
    return names


def _motion(arguments: argparse.Namespace) -> MotionTable:
    """Return the motion of the shaft: a table, or one turn at constant speed."""
    revolution = arguments.rpm is not None or arguments.samples is not None
    if arguments.input is not None:
        if revolution:
            raise UsageError("--input stands alone: leave --rpm and --samples away, or --input")
        motion = read_motion_table(arguments.input)
        if looks_like_degrees(motion.theta_rad):
            low, high = motion.theta_rad.min(), motion.theta_rad.max()
            tell(
                f"{arguments.input}: theta_rad runs from {low:g} to {high:g}: are these degrees? They are"
                " taken for radians"
            )
        elif away := rotation_mismatch(motion):
            tell(
                f"{arguments.input}: over time_s the shaft turns by {away[0]:.4g} rad as theta_rad says, and by"
                f" {away[1]:.4g} rad as omega_rad_s says: is one in degrees, rpm or ms? They are taken as named"
            )
        return motion
    if arguments.rpm is None:
        raise UsageError("give the motion: --rpm R for one turn, or --input motion.csv")
    samples = arguments.samples or _SAMPLES
    theta = 2.0 * math.pi * np.arange(samples) / samples
    omega = np.full(samples, arguments.rpm * 2.0 * math.pi / 60.0)
    return MotionTable(theta, omega, np.zeros(samples))
