"""textile-twin synthesize balance: counterweights, a spring, a second linkage or a flywheel for a machine."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from textile_twin_core.cli.arguments import Parser, add_machine, number, positive
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.synthesis.shared import add_output, write
from textile_twin_core.synthesis.balancing import WAYS, balancing_spring, counterweights, flywheel, opposed_linkages

if TYPE_CHECKING:
    from textile_twin_core.machine import Machine

DESCRIPTION = "A machine balanced by counterweights, a spring, a second linkage out of phase, or a flywheel."
EXAMPLE = "textile-twin synthesize balance tufting --by counterweight --out balanced.yaml"


def add(parser: Parser) -> None:
    """Add the arguments of the task."""
    add_machine(parser, option=False)
    parser.add_argument(
        "--by",
        choices=WAYS,
        required=True,
        help="counterweight: against the torque of gravity; force: counterweights against the shaking force; spring:"
        " against the torque at one speed; second-linkage: against the inertial torque; flywheel: against speed ripple",
    )
    parser.add_argument("--links", metavar="A,B", help="links that carry counterweights (default: the crank)")
    parser.add_argument(
        "--radius", type=positive, metavar="M", help="of the counterweights (default: the link's length)"
    )
    parser.add_argument("--phase", type=number, metavar="DEG", help="of the second linkage (default: the best)")
    parser.add_argument("--ripple", type=positive, default=0.02, metavar="X", help="speed ripple, default %(default)s")
    parser.add_argument("--rpm", type=positive, help="speed of the shaft (default: the machine's)")
    add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Balance, print the values before and after, and write the machine."""
    machine = load_linkage(arguments.machine, arguments.set)
    speed = machine.nominal_speed_rad_s if arguments.rpm is None else arguments.rpm * math.pi / 30.0
    balanced, lines, result = _WAYS[arguments.by](machine, speed, arguments)
    print("\n".join(lines))
    write(arguments, balanced, {"kind": "balance", "by": arguments.by, **result})


Balanced = tuple["Machine", list[str], dict[str, Any]]


def _weights(machine: Machine, speed: float, arguments: argparse.Namespace) -> Balanced:

    force = arguments.by == "force"
    links = arguments.links.split(",") if arguments.links else None
    aim = "shaking_force" if force else "gravity_torque"
    found = counterweights(machine, links, aim, arguments.radius, speed)  # type: ignore[arg-type]
    unit = "N" if force else "N m"
    lines = [
        f"counterweight on {w.link}: {w.mass_kg:.6g} kg at {w.radius_m:.6g} m, {math.degrees(w.angle_rad):.4f} deg from"
        " the link"
        for w in found.weights
    ]
    before, after = found.rms
    lines.append(f"RMS {aim.replace('_', ' ')} {before:.6g} {unit} before, {after:.6g} {unit} after")
    weights = [asdict(weight) for weight in found.weights]
    return found.machine, lines, {"counterweights": weights, "rms_before": before, "rms_after": after}


def _spring(machine: Machine, speed: float, _: argparse.Namespace) -> Balanced:

    found = balancing_spring(machine, speed)
    spring = found.spring
    lines = [
        f"spring from {spring.from_point} to {spring.to_point}: {spring.stiffness_N_m:.6g} N/m, free length"
        f" {spring.free_length_m:.6g} m, preload {spring.preload_N:.6g} N",
        f"RMS balancing torque at this speed: {found.rms_share:.4f} of what it was",
    ]
    return found.machine, lines, {"spring": asdict(spring), "rms_share": found.rms_share}


def _second(machine: Machine, speed: float, arguments: argparse.Namespace) -> Balanced:

    phase = None if arguments.phase is None else math.radians(arguments.phase)
    found = opposed_linkages(machine, phase, speed)
    in_step, apart = (math.sqrt(float((x**2).mean())) for x in (found.together_Nm, found.apart_Nm))
    lines = [
        f"second linkage {math.degrees(found.phase_rad):.4f} deg ahead of the first",
        f"RMS inertial torque of both: {in_step:.6g} N m in step, {apart:.6g} N m so",
    ]
    result = {"phase_rad": found.phase_rad, "rms_in_step_Nm": in_step, "rms_apart_Nm": apart}
    return found.machine, lines, result


def _flywheel(machine: Machine, speed: float, arguments: argparse.Namespace) -> Balanced:

    found = flywheel(machine, arguments.ripple, speed)
    lines = [
        f"flywheel of {found.inertia_kgm2:.6g} kg m^2 (energy swing over ripple and speed squared:"
        f" {found.rule_of_thumb_kgm2:.6g})",
        f"speed ripple {found.ripple_before:.6g} before, {found.ripple_after:.6g} after, under a constant"
        f" {found.mean_torque_Nm:.6g} N m",
    ]
    return found.machine, lines, {k: v for k, v in vars(found).items() if k != "machine"}


_WAYS = {
    "counterweight": _weights,
    "force": _weights,
    "spring": _spring,
    "second-linkage": _second,
    "flywheel": _flywheel,
}
