"""textile-twin synthesize: machines from their task, and balanced machines."""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

from textile_twin_core.cli.arguments import Parser, add_machine, count, number, positive, seed
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import add_outputs, check_out, save_json
from textile_twin_core.cli.progress import shares
from textile_twin_core.errors import SceneError
from textile_twin_core.files import save_machine_file
from textile_twin_core.machine import Machine
from textile_twin_core.synthesis import (
    BarSection,
    CrankRockerDesign,
    CrankRockerSynthesis,
    Tool,
    best_rotation,
    crank_rocker,
    crank_rocker_machine,
    fit_curve,
    offset_slider,
    rocker_through,
    rotation_of_time_ratio,
    through_points,
)
from textile_twin_core.synthesis.balancing import WAYS, balancing_spring, counterweights, flywheel, opposed_linkages


class _Task(NamedTuple):
    """One task: its line, its example, and what adds its arguments and runs it."""

    description: str
    example: str
    add: Callable[[Parser], None]
    run: Callable[[argparse.Namespace], None]


def _add_output(parser: Parser) -> None:
    """Add --out, --name, --json and --force."""
    add_outputs(parser, machine_required=False)
    parser.add_argument("--name", help="the machine's name in it (default: that of the file)")


def _add_section(parser: Parser) -> None:
    """Add --section."""
    parser.add_argument(
        "--section",
        type=_section,
        default="7210,0.030,0.010",
        metavar="KG/M3,M,M",
        help="density, width (in the plane of motion) and thickness of the links; default %(default)s",
    )


def _add_rotation(parser: Parser, default: str) -> None:
    """Add --rotation or --time-ratio."""
    parser.add_argument(
        "--rotation",
        type=number,
        metavar="DEG",
        help=f"crank rotation from the outer to the inner dead centre (default: {default})",
    )
    parser.add_argument(
        "--time-ratio", type=positive, metavar="Q", help="or duration of this stroke over that of the return stroke"
    )


def _rotation(arguments: argparse.Namespace, default_rad: float) -> float:
    """Return the requested crank rotation [rad]."""
    if arguments.rotation is not None and arguments.time_ratio is not None:
        raise UsageError("--rotation and --time-ratio specify the same quantity; give one of them")
    if arguments.time_ratio is not None:
        return rotation_of_time_ratio(arguments.time_ratio)
    return default_rad if arguments.rotation is None else math.radians(arguments.rotation)


def _points(text: str) -> list[tuple[float, float]]:
    """Parse points in metres, `X,Y X,Y ..`."""
    found = []
    for word in text.split():
        try:
            x, y = (float(part) for part in word.split(","))
        except ValueError:
            raise argparse.ArgumentTypeError(f"write points as 'X,Y X,Y ..' in metres, not '{word}'") from None
        found.append((x, y))
    return found


def _section(text: str) -> BarSection:
    try:
        density, width, thickness = (float(part) for part in text.split(","))
        return BarSection(density, width, thickness)
    except (ValueError, SceneError):
        raise argparse.ArgumentTypeError(
            f"write DENSITY,WIDTH,THICKNESS as three positive numbers, not '{text}'"
        ) from None


def _write(arguments: argparse.Namespace, machine: Machine | None, result: dict[str, Any]) -> None:
    """Write the outputs of --json and --out."""
    save_json(arguments.json, result)
    if arguments.out and machine is not None:
        save_machine_file(replace(machine, name=arguments.name or arguments.out.stem), arguments.out)
        print(f"wrote {arguments.out}: textile-twin simulate {arguments.out} --rpm 60 --samples 360 --out turn.csv")


_CHOICES = {"best": "best", "continuous": "best_continuous", "transmission": "best_transmission"}
_STEP_DEG = 5


def _add_crank_rocker(parser: Parser) -> None:
    parser.add_argument("--swing", type=number, metavar="DEG", help="swing of the rocker in degrees")
    parser.add_argument(
        "--hand",
        type=_points,
        metavar="'X,Y X,Y X,Y'",
        help="or three positions of the hand in metres, in one argument: swing, rocker pivot and arm follow from them",
    )
    _add_rotation(parser, "the one of the best transmission angle at r/l = 0.3")
    parser.add_argument("--ground", type=positive, metavar="M", help="length of the ground link, for lengths in metres")
    parser.add_argument(
        "--choose",
        choices=_CHOICES,
        help="which design --out writes: the best whole degree of beta (default where there is one), the best of any"
        " beta, or the one of the largest transmission angle",
    )
    parser.add_argument("--arm", type=positive, metavar="M", help="length of an arm on the rocker that carries a tool")
    parser.add_argument("--tool-mass", type=positive, metavar="KG", help="mass at the arm's end, such as a beater's")
    _add_section(parser)
    _add_output(parser)


def _run_crank_rocker(arguments: argparse.Namespace) -> None:
    if (arguments.swing is None) == (arguments.hand is None):
        raise UsageError("give --swing in degrees, or --hand with three positions")
    if arguments.hand and len(arguments.hand) != 3:
        raise UsageError(f"--hand takes three positions, not {len(arguments.hand)}")
    hand = rocker_through(*arguments.hand) if arguments.hand else None
    swing = hand.swing_rad if hand else math.radians(arguments.swing)
    result = crank_rocker(swing, _rotation(arguments, best_rotation(swing)))
    machine = None
    chosen = _chosen(result, arguments.choose)
    if arguments.out:
        if arguments.ground is None:
            raise UsageError("--out needs --ground, the length of the ground link in metres")
        arm = arguments.arm or (hand.radius_m if hand else None)
        if arguments.tool_mass and arm is None:
            raise UsageError("--tool-mass needs --arm, the length of the arm that carries the tool")
        tool = None if arm is None else Tool(arm, arguments.tool_mass or 0.0)
        machine = crank_rocker_machine(chosen.scaled(arguments.ground), arguments.section, tool, hand)
    lines = _table(result) + ([] if arguments.ground is None else _lengths(result, chosen, arguments.ground))
    if hand:
        x, y = hand.pivot_m
        lines.insert(1, f"rocker pivot at {x:.6g}, {y:.6g} m, the hand {hand.radius_m:.6g} m from it")
    print("\n".join(lines))
    _write(arguments, machine, result.to_json(arguments.ground))


def _chosen(result: CrankRockerSynthesis, choice: str | None) -> CrankRockerDesign:
    found = getattr(result, _CHOICES[choice]) if choice else result.best or result.best_transmission
    if found is None:
        raise UsageError(
            f"there is no such design for this task; leave out --choose {choice or ''}, or change the task"
        )
    return found


def _table(result: CrankRockerSynthesis) -> list[str]:
    count = len(result.designs)
    low, high = (math.degrees(beta) for beta in result.family.beta_bounds_rad)
    lines = [
        f"crank-rocker, swing {math.degrees(result.family.swing_rad):g} deg, rotation"
        f" {math.degrees(math.pi + result.family.imbalance_rad):g} deg ({result.case}):"
        f" beta from {low:.6g} to {high:.6g} deg, {count} design{'s' if count != 1 else ''}",
        "",
        f"{'beta deg':>10}{'a':>9}{'b':>9}{'c':>9}{'r/l':>8}{'mu_min deg':>12}",
    ]
    for design in result.designs:
        whole = round(math.degrees(design.beta_rad), 9)
        if design is result.best or whole % _STEP_DEG == 0 or count < 2 * _STEP_DEG:
            lines.append(_row(design) + ("  best" if design is result.best else ""))
    if result.best_continuous:
        lines.append(_row(result.best_continuous) + "  best of any beta")
    else:
        lines.append("no design keeps the transmission angle within 40 deg of 90")
    if result.best_transmission:
        lines.append(_row(result.best_transmission) + "  largest mu_min")
    return lines


def _lengths(result: CrankRockerSynthesis, chosen: CrankRockerDesign, ground_m: float) -> list[str]:
    """Return the chosen design in metres, with its name."""
    word = next(word for word, attribute in _CHOICES.items() if chosen is getattr(result, attribute))
    length = chosen.scaled(ground_m)
    return [
        "",
        f"ground link {length.ground_m:g} m: crank {length.crank_m:.6g} m, coupler {length.coupler_m:.6g} m,"
        f" rocker {length.rocker_m:.6g} m ({word})",
    ]


def _row(design: CrankRockerDesign) -> str:
    beta, mu_min = math.degrees(design.beta_rad), math.degrees(design.mu_min_rad)
    sides = f"{design.crank:9.4f}{design.coupler:9.4f}{design.rocker:9.4f}"
    return f"{round(beta, 4):10g}{sides}{design.crank_over_coupler:8.3f}{mu_min:12.2f}"


def _add_slider(parser: Parser) -> None:
    parser.add_argument("--stroke", type=positive, required=True, metavar="M", help="stroke in metres")
    _add_rotation(parser, "180, in line")
    parser.add_argument(
        "--crank-over-rod",
        type=positive,
        metavar="R",
        help="crank over rod; by default the one nearest 0.3 with a transmission angle of at least 50 deg",
    )
    parser.add_argument("--slider-mass", type=positive, default=1.0, metavar="KG", help="default %(default)s")
    _add_section(parser)
    _add_output(parser)


def _run_slider(arguments: argparse.Namespace) -> None:
    design = offset_slider(arguments.stroke, _rotation(arguments, math.pi), arguments.crank_over_rod)
    print(
        f"slider-crank, stroke {design.stroke_m:g} m, rotation {math.degrees(design.rotation_rad):.6g} deg:"
        f" crank {design.crank_m:.6g} m, rod {design.rod_m:.6g} m, offset {design.offset_m:.6g} m,"
        f" r/l {design.crank_over_rod:.3f}, transmission angle at least {math.degrees(design.mu_min_rad):.2f} deg"
    )
    machine = design.machine(arguments.section, arguments.slider_mass)
    _write(arguments, machine, {"kind": "slider", **design.to_json()})


def _add_points(parser: Parser) -> None:
    parser.add_argument(
        "--points", type=_points, required=True, metavar="'X,Y X,Y ..'", help="the points in metres, in one argument"
    )
    parser.add_argument("--least-transmission", type=number, default=0.0, metavar="DEG", help="default %(default)s")
    parser.add_argument("--count", type=count, default=5, help="designs to find (default %(default)s)")
    parser.add_argument("--seed", type=seed, default=0, help="of the random starts (default %(default)s)")
    _add_section(parser)
    _add_output(parser)


def _run_points(arguments: argparse.Namespace) -> None:
    found = through_points(
        arguments.points, arguments.seed, arguments.count, math.radians(arguments.least_transmission)
    )
    print(
        f"{'mu_min deg':>10}{'crank':>10}{'coupler':>10}{'rocker':>10}{'miss m':>10}   crank angles at the points, deg"
    )
    for design in found:
        bar = design.four_bar
        angles = " ".join(f"{math.degrees(angle):.1f}" for angle in design.angles_rad)
        lengths = f"{bar.crank_m:10.5f}{bar.coupler_m:10.5f}{bar.rocker_m:10.5f}"
        print(f"{math.degrees(bar.mu_min_rad):10.2f}{lengths}{design.miss_m:10.1e}   {angles}")
    designs = [asdict(design) | {"mu_min_deg": math.degrees(design.four_bar.mu_min_rad)} for design in found]
    _write(arguments, found[0].four_bar.machine(arguments.section), {"kind": "points", "designs": designs})


def _add_curve(parser: Parser) -> None:
    parser.add_argument("--file", type=Path, metavar="CSV", help="points in metres, two columns x and y")
    parser.add_argument("--points", type=_points, metavar="'X,Y X,Y ..'", help="or the points in one argument")
    parser.add_argument("--least-transmission", type=number, default=0.0, metavar="DEG", help="default %(default)s")
    parser.add_argument("--generations", type=count, default=600, help="of the search (default %(default)s)")
    parser.add_argument("--seed", type=seed, default=0, help="of the search (default %(default)s)")
    _add_section(parser)
    _add_output(parser)


def _run_curve(arguments: argparse.Namespace) -> None:
    if (arguments.file is None) == (arguments.points is None):
        raise UsageError("give the curve by --file or by --points")
    curve = arguments.points if arguments.file is None else _read_points(arguments.file)
    with shares("designs") as report:
        found = fit_curve(
            curve, arguments.seed, math.radians(arguments.least_transmission), arguments.generations, report
        )
    bar_found = found.four_bar
    print(
        f"four-bar after {found.designs} designs: RMS distance {1e3 * found.rms_m:.4g} mm, largest"
        f" {1e3 * found.largest_m:.4g} mm; crank {bar_found.crank_m:.6g} m, coupler {bar_found.coupler_m:.6g} m, rocker"
        f" {bar_found.rocker_m:.6g} m, transmission angle at least {math.degrees(bar_found.mu_min_rad):.2f} deg"
    )
    _write(arguments, bar_found.machine(arguments.section), {"kind": "curve", **asdict(found)})


def _read_points(path: Path) -> list[tuple[float, float]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if row]
    found = []
    for number_of_row, row in enumerate(rows, 1):
        try:
            found.append((float(row[0]), float(row[1])))
        except (ValueError, IndexError):
            if number_of_row > 1:  # the first line may be a heading
                raise UsageError(f"{path}, row {number_of_row}: two numbers x,y in metres are needed") from None
    return found


def _add_balance(parser: Parser) -> None:
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
    _add_output(parser)


def _run_balance(arguments: argparse.Namespace) -> None:
    machine = load_linkage(arguments.machine, arguments.set)
    speed = machine.nominal_speed_rad_s if arguments.rpm is None else arguments.rpm * math.pi / 30.0
    balanced, lines, result = _WAYS[arguments.by](machine, speed, arguments)
    print("\n".join(lines))
    _write(arguments, balanced, {"kind": "balance", "by": arguments.by, **result})


_Balanced = tuple[Machine, list[str], dict[str, Any]]


def _weights(machine: Machine, speed: float, arguments: argparse.Namespace) -> _Balanced:
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


def _spring(machine: Machine, speed: float, _: argparse.Namespace) -> _Balanced:
    found = balancing_spring(machine, speed)
    spring = found.spring
    lines = [
        f"spring from {spring.from_point} to {spring.to_point}: {spring.stiffness_N_m:.6g} N/m, free length"
        f" {spring.free_length_m:.6g} m, preload {spring.preload_N:.6g} N",
        f"RMS balancing torque at this speed: {found.rms_share:.4f} of what it was",
    ]
    return found.machine, lines, {"spring": asdict(spring), "rms_share": found.rms_share}


def _second(machine: Machine, speed: float, arguments: argparse.Namespace) -> _Balanced:
    phase = None if arguments.phase is None else math.radians(arguments.phase)
    found = opposed_linkages(machine, phase, speed)
    in_step, apart = (math.sqrt(float((x**2).mean())) for x in (found.together_Nm, found.apart_Nm))
    lines = [
        f"second linkage {math.degrees(found.phase_rad):.4f} deg ahead of the first",
        f"RMS inertial torque of both: {in_step:.6g} N m in step, {apart:.6g} N m so",
    ]
    result = {"phase_rad": found.phase_rad, "rms_in_step_Nm": in_step, "rms_apart_Nm": apart}
    return found.machine, lines, result


def _flywheel(machine: Machine, speed: float, arguments: argparse.Namespace) -> _Balanced:
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


_TASKS = {
    "crank-rocker": _Task(
        "Crank-rockers for a swing of the rocker and the rotation of the crank that belongs to it, the ground link"
        " being 1: all whole degrees of beta (the angle at the crank's pivot, from ground link to coupler at the "
        "stretched dead centre), and the best.",
        "textile-twin synthesize crank-rocker --swing 30 --rotation 180 --json designs.json",
        _add_crank_rocker,
        _run_crank_rocker,
    ),
    "slider": _Task(
        "A slider-crank for a stroke, offset where the way out and the way back differ in time.",
        "textile-twin synthesize slider --stroke 0.05 --time-ratio 1.1 --out slider.yaml",
        _add_slider,
        _run_slider,
    ),
    "points": _Task(
        "Four-bars whose coupler point passes two to five points exactly, in their order.",
        "textile-twin synthesize points --points '0,0 0.1,0.02 0.15,0.1 0.1,0.16' --out four_bar.yaml",
        _add_points,
        _run_points,
    ),
    "curve": _Task(
        "The four-bar whose coupler curve comes nearest to six or more points, by optimisation.",
        "textile-twin synthesize curve --file path.csv --least-transmission 40 --out four_bar.yaml",
        _add_curve,
        _run_curve,
    ),
    "balance": _Task(
        "A machine balanced by counterweights, a spring, a second linkage out of phase, or a flywheel.",
        "textile-twin synthesize balance tufting --by counterweight --out balanced.yaml",
        _add_balance,
        _run_balance,
    ),
}


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "synthesize",
        "Linkages from what they must do, as machine files that every other command takes; and machines balanced.",
        "textile-twin synthesize crank-rocker --swing 30 --rotation 180 --ground 0.3 --out loom.yaml",
    )
    tasks = parser.add_subparsers(dest="mechanism", metavar="TASK", required=True, parser_class=_TaskParser)
    for name, task in _TASKS.items():
        task.add(tasks.add_parser(name, help=task.description, description=task.description, epilog=task.example))
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Run the task.

    Raises:
        UsageError: The machine file to write exists already.
    """
    check_out(arguments)
    _TASKS[arguments.mechanism].run(arguments)


class _TaskParser(Parser):
    """Parser of one task."""

    def __init__(self, *, prog: str, description: str, epilog: str, **_: Any) -> None:
        super().__init__(prog.removeprefix("textile-twin "), description, epilog)
