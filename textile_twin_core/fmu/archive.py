"""Export of a machine as an FMU: model description, C sources, and a library if a C compiler is available."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Literal

from textile_twin_core.errors import SceneError
from textile_twin_core.fmu.chain_code import ChainCode, chain_code, indicators
from textile_twin_core.fmu.model_code import ModelCode, model_code, quantities
from textile_twin_core.fmu.model_description import ModelDescription, Variable
from textile_twin_core.fmu.symbolic_machine import SymbolicMachine, symbolic_machine
from textile_twin_core.machine import AnyMachine, Machine

Input = Literal["angle", "torque"]
_TIME, _TORQUE, _THETA, _OMEGA, _ALPHA, _DER_THETA = range(6)
_INDICATOR, _OUTPUT, _PARAMETER, _STATE, _DER_STATE = 100, 1000, 100_000, 200_000, 300_000
"""Value references, as in c/textile_twin.h."""
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-fno-math-errno", "-ffp-contract=off")
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in the archive, so that equal machines give equal archives."""


@dataclass(frozen=True)
class FmuReport:
    """Content of an exported FMU.

    Attributes:
        outputs: names of the output variables.
        parameters: names of the parameters.
        fixed: numbers of the machine that remain constants, since other values need another closed form.
        has_binary: whether the archive holds a library for this computer.
    """

    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    fixed: tuple[str, ...]
    has_binary: bool


def write_fmu(
    path: str | os.PathLike[str],
    machine: AnyMachine,
    *,
    input: Input = "angle",
    fmi: Literal[2, 3] = 2,
    outputs: Sequence[str] | None = None,
) -> FmuReport:
    """Write a machine as a functional mock-up unit for model exchange and co-simulation.

    With `angle` the inputs are the motion of the main shaft, and all outputs follow directly. With `torque` the input
    is the drive torque, and angle and speed of the shaft are states; steps of the loads and standstill under dry
    friction are state events. On an elastic main shaft the twist and speed of every station are states, with `angle`
    beside the motion of the encoder's station, with `torque` beside the drive's.

    Args:
        path: the .fmu file to write.
        machine: a linkage, or linkages on an elastic main shaft.
        input: input of the unit, "angle" or "torque".
        fmi: version of the standard, 2 (2.0) or 3 (3.0).
        outputs: names of outputs of the machine; by default its shown outputs.

    Returns:
        Content of the archive.

    Raises:
        SceneError: for another kind of machine, an unknown output, or a torque without masses.

    Example:
        >>> import tempfile, textile_twin_core as ttc
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_fmu(f"{folder}/tufting.fmu", ttc.machines.tufting(), fmi=3).outputs[0]
        'balancing_torque_Nm'

    References:
        Modelica Association: Functional Mock-up Interface, versions 2.0.4 and 3.0.1, https://fmi-standard.org.
    """
    if not isinstance(machine, Machine):
        raise SceneError(
            f"machine '{machine.name}' has bodies between stops and pads, and the engine that solves their impacts is"
            " not written in C; export a table of its motion instead, with textile-twin simulate"
        )
    torque_input = input == "torque"
    if torque_input and not machine.tells_torque:
        raise SceneError(
            f"machine '{machine.name}' lacks masses, without which a torque moves nothing; give"
            f" {', '.join(machine.missing_for_torque)}"
        )
    names = tuple(outputs if outputs is not None else machine.shown_outputs)
    fixed: tuple[str, ...] = ()
    if machine.shaft is not None:
        chain = chain_code(machine, names, torque_input, [fmi, machine.name])
        code, parameters, runtime = chain.code, chain.parameters, "chain.c"
        count = indicators(machine)
        variables = _chain_variables(chain, names, torque_input, fmi, count)
    else:
        made = symbolic_machine(machine, partial(quantities, names, torque_input))
        code = model_code(made, names, torque_input, [fmi, machine.name])
        parameters, fixed, runtime = made.parameters, made.fixed, "runtime.c"
        count = code.leaps + torque_input
        variables = _variables(made, code, names, torque_input, fmi)
    identifier = re.sub(r"\W", "_", machine.name, flags=re.ASCII)
    identifier = identifier if not identifier[:1].isdigit() else f"m_{identifier}"
    interface = f"fmi{fmi}.c"
    description = ModelDescription(
        name=machine.name,
        identifier=identifier,
        token=code.token,
        about=machine.description,
        variables=variables,
        sources=("all.c",),
        indicators=count,
    )
    shared = files("textile_twin_core.fmu") / "c"
    sources = {name: (shared / name).read_bytes() for name in ("textile_twin.h", runtime, interface)}
    together = "".join(f'#include "{name}"\n' for name in ("model.c", runtime, interface))
    sources |= {"model.h": code.header.encode(), "model.c": code.source.encode()}
    sources["all.c"] = f"#define TT_LOCAL static\n{together}".encode()
    archive = {"modelDescription.xml": description.xml(fmi), **{f"sources/{k}": v for k, v in sources.items()}}
    if fmi == 3:
        archive["sources/buildDescription.xml"] = description.build_description()
    library = _library(sources, identifier)
    if library is not None:
        archive[f"binaries/{'linux64' if fmi == 2 else 'x86_64-linux'}/{identifier}.so"] = library
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in archive.items():
            out.writestr(zipfile.ZipInfo(name, _EPOCH), content, zipfile.ZIP_DEFLATED)
    return FmuReport(names, tuple(parameters), fixed, library is not None)


def _variables(
    made: SymbolicMachine, code: ModelCode, outputs: Sequence[str], torque_input: bool, fmi: int
) -> list[Variable]:
    shaft = {"theta": "theta_rad", "omega": "omega_rad_s", "alpha": "alpha_rad_s2"}
    known: list[Variable] = []
    if fmi == 3:
        known.append(Variable("time", _TIME, "independent"))
    if torque_input:
        moved: tuple[str, ...] = (shaft["theta"], shaft["omega"], "drive_torque_Nm")
        known += [
            Variable("drive_torque_Nm", _TORQUE, "input", start=0.0, description="torque on the main shaft"),
            Variable(shaft["theta"], _THETA, "output", initial="exact", start=0.0, depends=(shaft["theta"],)),
            Variable(shaft["omega"], _OMEGA, "output", initial="exact", start=0.0, depends=(shaft["omega"],)),
            Variable("der(theta_rad)", _DER_THETA, "local", initial="calculated", derivative_of=shaft["theta"],
                     depends=(shaft["omega"],)),
            Variable(shaft["alpha"], _ALPHA, "output", initial="calculated", derivative_of=shaft["omega"],
                     depends=moved),
        ]  # fmt: skip
    else:
        moved = tuple(shaft.values())
        known += [
            Variable(name, reference, "input", start=0.0)
            for name, reference in zip(moved, (_THETA, _OMEGA, _ALPHA), strict=True)
        ]
    for k, (name, depends) in enumerate(zip(outputs, code.depends, strict=True)):
        on = moved if torque_input and "alpha" in depends else tuple(shaft[d] for d in shaft if d in depends)
        known.append(Variable(name, _OUTPUT + k, "output", initial="calculated", depends=on))
    if fmi == 3:
        known += [
            Variable(f"event_indicator_{k}", _INDICATOR + k, "local", initial="calculated")
            for k in range(code.leaps + torque_input)
        ]
    known += [
        Variable(name, _PARAMETER + k, "parameter", "tunable", "exact", value)
        for k, (name, value) in enumerate(made.parameters.items())
    ]
    return known


def _chain_variables(
    chain: ChainCode, outputs: Sequence[str], torque_input: bool, fmi: int, indicators: int
) -> list[Variable]:
    """Variables of an elastic shaft; a variable of the chain depends on all of its states."""
    shaft = ("theta_rad", "omega_rad_s", "alpha_rad_s2")
    known = [Variable("time", _TIME, "independent")] if fmi == 3 else []
    twists = [f"shaft.twist_{a}_{b}_rad" for a, b in pairwise(chain.stations)]
    if torque_input:
        known += [
            Variable("drive_torque_Nm", _TORQUE, "input", start=0.0, description="torque on the drive's station"),
            *(
                Variable(name, reference, "output", initial="exact", start=0.0, depends=None,
                         description="of the drive's station, reduced to the main shaft")
                for name, reference in zip(shaft, (_THETA, _OMEGA), strict=False)
            ),
            Variable(shaft[2], _ALPHA, "output", initial="calculated", depends=None),
        ]  # fmt: skip
        states = ["shaft.angle_rad", *twists, *(f"shaft.speed_{name}_rad_s" for name in chain.stations)]
    else:
        known += [
            Variable(name, reference, "input", start=0.0, description="of the encoder's station")
            for name, reference in zip(shaft, (_THETA, _OMEGA, _ALPHA), strict=True)
        ]
        others = [name for k, name in enumerate(chain.stations) if k != chain.driven]
        states = [*twists, *(f"shaft.relative_speed_{name}_rad_s" for name in others)]
    known += [
        Variable(name, _OUTPUT + k, "output", initial="calculated", depends=None) for k, name in enumerate(outputs)
    ]
    for k, state in enumerate(states):
        known += [
            Variable(state, _STATE + k, "local", initial="calculated"),
            Variable(f"der({state})", _DER_STATE + k, "local", initial="calculated", derivative_of=state, depends=None),
        ]
    if fmi == 3:
        known += [
            Variable(f"event_indicator_{k}", _INDICATOR + k, "local", initial="calculated") for k in range(indicators)
        ]
    known += [
        Variable(name, _PARAMETER + k, "parameter", "tunable", "exact", value)
        for k, (name, value) in enumerate(chain.parameters.items())
    ]
    return known


def _library(sources: dict[str, bytes], identifier: str) -> bytes | None:
    """Compile the shared library for this computer; None without a C compiler or on other than 64-bit Linux."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or not sys.platform.startswith("linux") or os.uname().machine != "x86_64":
        return None
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        for name, content in sources.items():
            (Path(folder) / name).write_bytes(content)
        command = [compiler, *_FLAGS, "-o", f"{identifier}.so", "all.c", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        return (Path(folder) / f"{identifier}.so").read_bytes() if done.returncode == 0 else None
