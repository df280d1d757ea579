"""Start of the suite beside a machine, without a ROS installation: twin, recording, view, monitor, fault book and, on
request, the machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import difflib
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

signal.signal(signal.SIGINT, signal.SIG_DFL)  # before any program runs, Ctrl-C ends this script without a message
from bring_up import bring_up  # noqa: E402
from this_computer import RANGE, asked_for, this_computer_alone  # noqa: E402

from textile_twin_core.errors import TwinError  # noqa: E402
from textile_twin_core.machine import AnyMachine, Machine  # noqa: E402
from textile_twin_ros.machine import load_machine  # noqa: E402

NODES = ("twin_node", "record_node")
WATCH = ("monitor_node", "fault_node")
"""Nodes that raise alarms and keep them, for a machine whose torque is known."""
FOLDERS = {
    "record_node": {"folder": "out/recordings"},
    "monitor_node": {"book": "out/faults"},
    "fault_node": {"book": "out/faults"},
}
"""Folders unless others are given; the fault book also holds what the monitor has learnt."""
PROGRAM = "suite.sh"
DESCRIPTION = """\
Starts twin_node, record_node, view_node, monitor_node and fault_node for MACHINE (a name or the path of a machine
file; tufting when not given), until Ctrl-C. They listen on main_shaft/angle and balancing_torque/measured. Recordings
go to out/recordings; alarms, and what the monitor has learnt of the machine, to the fault book out/faults.
ROS ARGUMENTS go to every node that they concern; a parameter for one node alone takes that node's name before it:
  launch_scripts/suite.sh tufting --shaft simulated
  launch_scripts/suite.sh tufting -p twin_node:shaft:=lag -p record_node:bag:=out/monday -r __ns:=/machine_3
  launch_scripts/suite.sh looms/my_loom.yaml --params-file my_parameters.yaml"""


def declared(node: str) -> dict[str, object]:
    """Return the parameters of a node with their defaults."""
    module = import_module(f"textile_twin_ros.{node}")
    declaration = getattr(module, f"{node.removesuffix('_node').capitalize()}Parameters")
    return {field.name: field.default for field in dataclasses.fields(declaration)}


class Arguments:
    """Arguments of each node: parameters go to the nodes that declare them, everything else to all nodes.

    Args:
        nodes: Nodes to start.
        words: ROS arguments as written, without --ros-args.

    Raises:
        TwinError: A parameter or node does not exist.
    """

    def __init__(self, nodes: Sequence[str], words: Sequence[str]) -> None:
        self._parameters = {node: declared(node) for node in nodes}
        self._told: dict[str, list[str]] = {node: [] for node in nodes}
        given = iter(word for word in words if word != "--ros-args")
        for word in given:
            if word in ("-p", "--param"):
                self._parameter(next(given, ""))
            elif word in ("-r", "--remap", "--params-file", "-e", "--enclave", "--log-level", "--log-config-file"):
                self._to_all(word, next(given, ""))
            else:
                self._to_all(word)

    def of(self, node: str, **defaults: str) -> list[str]:
        """Return the arguments of a node, preceded by the defaults, which apply unless another value is given."""
        words = [word for name, value in defaults.items() for word in ("-p", f"{name}:={value}")]
        return ["--ros-args", *words, *self._told[node]]

    def _to_all(self, *words: str) -> None:
        for told in self._told.values():
            told += words

    def _parameter(self, text: str) -> None:
        name, assigned, value = text.partition(":=")
        if not assigned:
            raise TwinError(f"-p {text}: is not written as NAME:=VALUE")
        node, colon, own = name.rpartition(":")
        if colon and node not in self._parameters:
            raise TwinError(f"-p {text}: no node '{node}'; there are {', '.join(self._parameters)}")
        own_and_common = {"use_sim_time"}
        takers = [
            taker
            for taker, parameters in self._parameters.items()
            if taker == node or (not colon and own in parameters.keys() | own_and_common)
        ]
        known = {name for taker in takers or self._parameters for name in self._parameters[taker]} | own_and_common
        if own not in known and not own.startswith("qos_overrides."):
            nearest = difflib.get_close_matches(own, known, n=1)
            hint = f"did you mean '{nearest[0]}'?" if nearest else f"there are {', '.join(sorted(known))}"
            raise TwinError(f"-p {text}: no parameter '{own}'; {hint}")
        for taker in takers or self._parameters:
            # In a namespace the node has another full name, so the parameter is given without the node name.
            self._told[taker] += ["-p", f"{own}:={value}"]


def commands(arguments: Sequence[str]) -> list[list[str]]:
    """Return the programs to start, the twin first."""
    parser = argparse.ArgumentParser(
        PROGRAM,
        usage=f"launch_scripts/{PROGRAM} [MACHINE] [--shaft simulated] [--no-torque] [--no-view] [ROS ARGUMENTS ...]",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--check", action="store_true", help="only look for mistakes in what is asked for")
    parser.add_argument(
        "--shaft", choices=("machine", "simulated"), default="machine", help="simulated: a dry run without a machine"
    )
    parser.add_argument("--no-torque", action="store_true", help="the machine has no torque sensor: no alarms")
    parser.add_argument("--no-view", action="store_true", help="serve no live view, which takes a sixth of a core")
    options, words = parser.parse_known_args(arguments)
    machine = words.pop(0) if words and not words[0].startswith("-") else "tufting"
    loaded = load_machine(machine)  # a mistake ends the script here, before anything runs or is recorded
    watched = has_torque(loaded) and not options.no_torque
    simulated = ["shaft_node"] * (options.shaft == "simulated")
    nodes = [
        *NODES,
        *(WATCH if watched else ()),
        *(() if options.no_view else ("view_node",)),
        *simulated,
    ]  # after a power cut alarms come before pictures
    told = Arguments(nodes, words)
    if options.check:
        return []
    folder, programs = Path(sys.executable).parent, []
    for node in nodes:
        own = {"machine": machine} if "machine" in declared(node) else {}
        programs.append([str(folder / node), *told.of(node, **own, **FOLDERS.get(node, {}))])
    return programs


def has_torque(machine: AnyMachine) -> bool:
    """Return true for a linkage with masses, whose torque a monitor can watch."""
    return isinstance(machine, Machine) and not machine.missing_for_torque


def main(arguments: Sequence[str] | None = None) -> int:
    """Start all programs, and return the exit code."""
    try:
        programs = commands(sys.argv[1:] if arguments is None else arguments)
    except TwinError as error:
        print(f"{PROGRAM}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    if not programs:
        return 0
    if asked_for(os.environ):
        os.environ.update(this_computer_alone())
        print(f"{PROGRAM}: nodes on this computer hear each other; {RANGE}=SUBNET lets other computers in", flush=True)
    return bring_up(programs, essential="twin_node")


if __name__ == "__main__":
    sys.exit(main())
