"""textile-twin fmu: a machine as a functional mock-up unit for other simulation programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, add_machine
from textile_twin_core.cli.mistakes import UsageError, nearest, tell
from textile_twin_core.cli.named_machine import load_machine
from textile_twin_core.cli.outputs import check_output, keep_input, print_rows
from textile_twin_core.files import staged
from textile_twin_core.fmu import write_fmu
from textile_twin_core.machine import AnyMachine, ContactMachine


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "fmu",
        "Writes a machine as a source FMU in C, for co-simulation and (without stops and pads) for model exchange,\n"
        "with a library for 64-bit Linux where a C compiler is at hand. It needs no Python where it runs.",
        "textile-twin fmu tufting --input torque --fmi 2 --out tufting.fmu",
    )
    add_machine(parser, option=False)
    parser.add_argument(
        "--input",
        choices=["angle", "torque"],
        default="angle",
        help="what drives it: the shaft's angle, speed and acceleration, or the drive torque (default %(default)s)",
    )
    parser.add_argument(
        "--fmi", type=int, choices=[2, 3], default=2, help="version of the standard, 2.0 or 3.0 (default %(default)s)"
    )
    parser.add_argument(
        "--outputs",
        metavar="A,B",
        help="names of outputs, with commas between (textile-twin machines MACHINE lists them); default as in simulate",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="the .fmu file; overwritten if it exists"
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Write the unit and print its contents."""
    check_output("--out", arguments.out, ".fmu")
    keep_input(arguments.out, Path(arguments.machine))
    machine = load_machine(arguments.machine, arguments.set)
    names = _outputs(machine, arguments.outputs)
    with staged(arguments.out) as partial:
        made = write_fmu(partial, machine, input=arguments.input, fmi=arguments.fmi, outputs=names)
    if made.fixed:
        tell(f"constants of this unit, since another closed form belongs to other values: {', '.join(made.fixed)}")
    if getattr(machine, "shaft", None) is not None:
        tell("the linkages are constants of this unit, held in tables; its parameters are the numbers of the shaft")
    if isinstance(machine, ContactMachine):
        tell("for co-simulation alone, and the law of motion is a constant of this unit")
    if not made.has_binary:
        tell("without a library, since no C compiler for 64-bit Linux works here: the importer compiles the sources")
    print_rows(
        [
            ("outputs", ", ".join(made.outputs)),
            ("parameters", ", ".join(made.parameters)),
            ("library", "64-bit Linux" if made.has_binary else "none"),
        ]
    )


def _outputs(machine: AnyMachine, given: str | None) -> list[str] | None:
    if given is None:
        return None
    names = [name.strip() for name in given.split(",") if name.strip()]
    for name in names:
        if name not in machine.outputs:
            raise UsageError(f"--outputs {name}: no such output; {nearest(name, machine.outputs)}")
    return list(dict.fromkeys(names))
