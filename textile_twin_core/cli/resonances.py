"""textile-twin resonances: natural frequencies, mode shapes and critical speeds of an elastic main shaft."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from textile_twin_core import views
from textile_twin_core.cli.arguments import MOST_RPM, Parser, add_machine
from textile_twin_core.cli.mistakes import tell
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import check_outputs, save, save_json
from textile_twin_core.driveline import CriticalSpeed, Resonances, ShaftMode, elastic_shaft, find_resonances
from textile_twin_core.machine import Machine

_RPM = 30.0 / math.pi
_SLOWEST, _FASTEST = 0.2, 2.0
"""Default range of speeds over the nominal speed of the machine."""
_SHOWN_MODES, _SHOWN_SPEEDS = 6, 12


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "resonances",
        "Natural frequencies of an elastic main shaft, undamped and damped, its mode shapes, and the critical speeds:\n"
        "where an order of the machine's own torque meets a natural frequency. The machine file needs a `shaft`.",
        "textile-twin resonances wide.yaml --rpm 100:600 --png campbell.png",
    )
    add_machine(parser, option=False)
    parser.add_argument(
        "--rpm", type=_speeds, metavar="A:B", help="range of speeds (default: from 0.2 to 2 times the nominal speed)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers; overwritten if it exists")
    parser.add_argument("--png", type=Path, metavar="FILE", help="draw the Campbell diagram; overwritten if it exists")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Compute, print and write the outputs."""
    check_outputs(arguments)
    machine = load_linkage(arguments.machine, arguments.set)
    elastic = elastic_shaft(machine)
    if elastic.shaft.drive.inertia_kgm2 is None:
        name = elastic.shaft.names[elastic.shaft.drive_station]
        tell(f"the drive's inertia is unknown and counts as 0 at station '{name}'; give shaft.drive.inertia_kgm2")
    nominal = machine.nominal_speed_rad_s * _RPM
    low, high = arguments.rpm or (_SLOWEST * nominal, _FASTEST * nominal)
    found = find_resonances(elastic, (low / _RPM, high / _RPM))
    _print(found)
    save_json(arguments.json, _numbers(machine, found))
    save(arguments.png, lambda path: views.plot_campbell(path, found, title=f"Resonances of {machine.name}"))


def _speeds(text: str) -> tuple[float, float]:
    """Parse a range of speeds in rpm."""
    try:
        low, high = (float(each) for each in text.split(":"))
    except ValueError:
        low = high = math.nan
    if not 0.0 < low < high <= MOST_RPM:
        raise argparse.ArgumentTypeError(f"must be two rising speeds in rpm, such as 100:600, not '{text}'")
    return low, high


def _print(found: Resonances) -> None:
    print(f"{'mode':>4}  {'undamped':>11}  {'damped':>11}  {'damping':>8}  undamped over the turn")
    for number, mode in enumerate(found.modes[:_SHOWN_MODES], start=1):
        damped = f"{mode.damped_Hz:8.2f} Hz" if mode.damped_Hz else "overdamped"
        damping = round(mode.damping_ratio, 4) + 0.0  # without the sign of a rounded zero
        print(
            f"{number:4}  {mode.undamped_Hz:8.2f} Hz  {damped:>11}  {damping:8.2%}"
            f"  {mode.lowest_Hz:.2f} to {mode.highest_Hz:.2f} Hz"
        )
    hidden = len(found.modes) - _SHOWN_MODES
    if hidden > 0:
        print(f"      {hidden} more up to {found.modes[-1].undamped_Hz:.0f} Hz")
    low, high = (speed * _RPM for speed in found.speeds_rad_s)
    if not found.critical:
        print(f"no critical speed from {low:.4g} to {high:.4g} rpm")
        return
    severest = sorted(found.critical, key=lambda each: each.severity, reverse=True)[:_SHOWN_SPEEDS]
    print(
        f"critical speeds from {low:.4g} to {high:.4g} rpm, {len(severest)} of {len(found.critical)}, severest first:"
    )
    for each in severest:
        print(f"  {_in_words(each, found)}")


def _in_words(each: CriticalSpeed, found: Resonances) -> str:
    near, far = found.stations[each.piece : each.piece + 2]
    gain = f"{each.amplification:.3g} times amplified" if math.isfinite(each.amplification) else "without damping"
    return (
        f"{each.speed_rad_s * _RPM:7.1f} rpm: order {each.order} meets mode {each.mode} ({each.frequency_Hz:.4g} Hz);"
        f" {each.share:.1%} of the peak torque in {near} - {far}, {gain}"
    )


def _numbers(machine: Machine, found: Resonances) -> dict[str, object]:
    return {
        "machine": machine.name,
        "stations": list(found.stations),
        "rpm": [speed * _RPM for speed in found.speeds_rad_s],
        "modes": [_mode_numbers(mode) for mode in found.modes],
        "critical_speeds": [
            {
                "rpm": each.speed_rad_s * _RPM,
                "order": each.order,
                "mode": each.mode,
                "frequency_Hz": each.frequency_Hz,
                "share_of_peak_torque": each.share,
                "amplification": each.amplification if math.isfinite(each.amplification) else None,
                "piece": list(found.stations[each.piece : each.piece + 2]),
            }
            for each in found.critical
        ],
    }


def _mode_numbers(mode: ShaftMode) -> dict[str, object]:
    return {
        "undamped_Hz": mode.undamped_Hz,
        "damped_Hz": mode.damped_Hz,
        "damping_ratio": mode.damping_ratio,
        "lowest_Hz": mode.lowest_Hz,
        "highest_Hz": mode.highest_Hz,
        "shape": mode.shape.tolist(),
    }
