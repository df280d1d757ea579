"""textile-twin drive: the motion of a machine under a drive torque: run-up, coast-down, speed ripple."""

from __future__ import annotations

import argparse
import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.cli.arguments import MOST_RPM, Parser, add_machine, number, positive, samples, shaft_speed
from textile_twin_core.cli.mistakes import UsageError, tell
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import check_output, keep_input
from textile_twin_core.cli.progress import shares
from textile_twin_core.driveline import ChainMotion
from textile_twin_core.driveline.free_motion import ElasticDriveResult, drive
from textile_twin_core.dynamics.drive_torque import DriveTorque, TorqueOverAngle, TorqueOverTime
from textile_twin_core.errors import MotionError
from textile_twin_core.files import write_table
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.log_files import read_table

_SUFFIXES = (".csv", ".parquet")
_TIMES_NOMINAL, _TIMES_START = 100.0, 10.0
"""Multiple of the nominal and the initial speed that counts as runaway."""
_OVER_TIME, _OVER_ANGLE = ("time_s", "torque_Nm"), ("theta_rad", "torque_Nm")


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "drive",
        "Torque in, motion out: how a machine runs up, coasts down or ripples under a drive torque, a number or a\n"
        "table over time (time_s, torque_Nm) or over the shaft angle (theta_rad, torque_Nm, one turn). The table that\n"
        "comes out is one that simulate takes.",
        "textile-twin drive tufting --torque 0 --rpm 160 --time 5 --out coast_down.csv",
    )
    add_machine(parser, option=False)
    parser.add_argument(
        "--torque", required=True, metavar="FILE|NUMBER", help="N m, or a .csv or .parquet table (see above)"
    )
    parser.add_argument("--time", type=positive, required=True, metavar="T", help="seconds to follow")
    parser.add_argument(
        "--rpm", type=shaft_speed, default=0.0, metavar="R", help="speed at the start (default %(default)s)"
    )
    parser.add_argument("--start", type=number, default=0.0, metavar="DEG", help="angle at the start (default 0)")
    parser.add_argument(
        "--samples", type=samples, default=1001, metavar="N", help="rows, evenly in time (default 1001)"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help=".csv or .parquet; overwritten if it exists"
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Integrate and write the motion, and report events."""
    check_output("--out", arguments.out, *_SUFFIXES)
    keep_input(arguments.out, Path(arguments.torque))
    if arguments.samples < 2:
        raise UsageError("--samples: a motion has two or more")
    machine = load_linkage(arguments.machine, arguments.set)

    times = np.linspace(0.0, arguments.time, arguments.samples)
    omega = arguments.rpm * 2.0 * math.pi / 60.0
    torque = _torque(arguments.torque)
    if isinstance(torque, TorqueOverTime) and not torque.time_s[0] <= 0.0 < arguments.time <= torque.time_s[-1]:
        tell(
            f"{arguments.torque}: has the torque from {torque.time_s[0]:g} to {torque.time_s[-1]:g} s; it is taken as"
            f" constant before and after, for 0 to {arguments.time:g} s"
        )
    with shares("following") as report:
        start = math.radians(arguments.start)
        found = drive(machine, torque, start, omega, times, fastest_rad_s=_fastest(machine, omega), report=report)
    columns = {
        "theta_rad": found.theta_rad,
        "omega_rad_s": found.omega_rad_s,
        "alpha_rad_s2": found.alpha_rad_s2,
        "time_s": found.time_s,
        "drive_torque_Nm": found.drive_torque_Nm,
        "kinetic_energy_J": found.kinetic_energy_J,
        "potential_energy_J": found.potential_energy_J,
        "drive_work_J": found.drive_work_J,
    }
    if isinstance(found, ElasticDriveResult):
        columns |= _chain_columns(found.motion)
    write_table(arguments.out, columns)
    rpm = found.omega_rad_s * 30.0 / math.pi
    turns = (found.theta_rad[-1] - found.theta_rad[0]) / (2.0 * math.pi)
    print(f"{arguments.out}: {len(times)} rows, {turns:.1f} turns, {rpm[0]:.4g} -> {rpm[-1]:.4g} rpm")
    last = rpm[found.theta_rad >= found.theta_rad[-1] - 2.0 * math.pi]
    if abs(turns) > 1.0 and last.mean() != 0.0:
        print(f"last turn: {last.min():.5g} .. {last.max():.5g} rpm, ripple {np.ptp(last) / abs(last.mean()):.2%}")
    for event in found.events:
        if event.kind != "leaps":
            print(f"{event.time_s:10.4f} s  the shaft {event.kind} at {math.degrees(event.theta_rad):.2f} deg")


def _chain_columns(motion: ChainMotion) -> dict[str, FloatArray]:
    """Return the columns of every station and piece of an elastic shaft."""
    columns = {}
    for k, name in enumerate(motion.stations):
        columns[f"station_{name}_theta_rad"] = motion.theta_rad[:, k]
        columns[f"station_{name}_omega_rad_s"] = motion.omega_rad_s[:, k]
    for k, (near, far) in enumerate(pairwise(motion.stations)):
        columns[f"torque_{near}_{far}_Nm"] = motion.piece_torque_Nm[:, k]
    return columns


def _fastest(machine: Machine, omega: float) -> float:
    """Return a speed beyond all plausible ones [rad/s]; exceeding it indicates a wrong torque or unit."""
    usual = max(_TIMES_NOMINAL * machine.nominal_speed_rad_s, _TIMES_START * abs(omega))
    return min(usual, 2.0 * MOST_RPM * math.pi / 30.0)


def _torque(text: str) -> DriveTorque | float:
    """Parse a number, or a table over time or angle."""
    try:
        value = float(text)
    except ValueError:
        return _table(Path(text))
    if not math.isfinite(value):
        raise UsageError(f"--torque {text}: must be a finite number, or a table")
    return value


def _table(path: Path) -> DriveTorque:
    columns, _ = read_table(path)
    for names, kind in ((_OVER_TIME, TorqueOverTime), (_OVER_ANGLE, TorqueOverAngle)):
        if all(name in columns for name in names):
            first, torque = (tuple(columns[name].tolist()) for name in names)
            try:
                return kind(first, torque)
            except MotionError as error:
                raise UsageError(f"{path}: {error}") from error
    there = ", ".join(columns)
    raise UsageError(f"{path}: needs the columns time_s and torque_Nm, or theta_rad and torque_Nm; available: {there}")
