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
from pathlib import Path
from typing import Literal

from textile_twin_core.errors import SceneError
from textile_twin_core.fmu.chain_code import chain_code, indicators
from textile_twin_core.fmu.contact_code import contact_code
from textile_twin_core.fmu.model_code import model_code, quantities
from textile_twin_core.fmu.model_description import ModelDescription
from textile_twin_core.fmu.variables import chain_variables, contact_variables, rigid_variables
from textile_twin_core.machine import AnyMachine, ContactMachine, Machine
from textile_twin_core.machines.symbolic_machine import symbolic_machine

Input = Literal["angle", "torque"]
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
    """Write a machine as a functional mock-up unit.

    With `angle` the inputs are the motion of the main shaft, and all outputs follow directly. With `torque` the input
    is the drive torque, and angle and speed of the shaft are states; steps of the loads and standstill under dry
    friction are state events. On an elastic main shaft the twist and speed of every station are states, with `angle`
    beside the motion of the encoder's station, with `torque` beside the drive's.

    A linkage is for model exchange and co-simulation. A contact machine is for co-simulation alone, with `angle`: it
    goes from impact to impact within each communication step.

    Args:
        path: the .fmu file to write.
        machine: a linkage, linkages on an elastic main shaft, or a contact machine.
        input: input of the unit, "angle" or "torque".
        fmi: version of the standard, 2 (2.0) or 3 (3.0).
        outputs: names of outputs of the machine; by default its shown outputs.

    Returns:
        Content of the archive.

    Raises:
        SceneError: for an unknown output, a torque without masses, or a torque on a contact machine.

    Examples:
        >>> import tempfile, textile_twin_core as ttc
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_fmu(f"{folder}/tufting.fmu", ttc.machines.tufting(), fmi=3).outputs[0]
        'balancing_torque_Nm'

    References:
        Modelica Association: Functional Mock-up Interface, versions 2.0.4 and 3.0.1, https://fmi-standard.org.
    """
    torque_input = input == "torque"
    names = tuple(outputs if outputs is not None else machine.shown_outputs)
    fixed: tuple[str, ...] = ()
    runtime: tuple[str, ...]
    about = [fmi, machine.name]
    if isinstance(machine, ContactMachine):
        if torque_input:
            raise SceneError(
                f"machine '{machine.name}' has bodies that move beside the shaft, and `drive` has no law of motion for"
                " them and a shaft under a torque; export it with --input angle"
            )
        code, parameters = contact_code(machine, names, about)
        runtime, count = ("polynomials.c", "impacts.c", "contact_motion.c", "contact.c"), 0
        variables = contact_variables(names, parameters, fmi)
    else:
        assert isinstance(machine, Machine)
        if torque_input and not machine.has_complete_torque:
            raise SceneError(
                f"machine '{machine.name}' lacks masses, without which a torque moves nothing; give"
                f" {', '.join(machine.missing_for_torque)}"
            )
        if machine.shaft is not None:
            chain = chain_code(machine, names, torque_input, about)
            code, parameters, runtime = chain.code, chain.parameters, ("chain.c",)
            count = indicators(machine)
            variables = chain_variables(chain, names, torque_input, fmi, count)
        else:
            made = symbolic_machine(machine, partial(quantities, names, torque_input))
            code = model_code(made, names, torque_input, about)
            parameters, fixed, runtime = made.parameters, made.fixed, ("runtime.c",)
            count = code.leaps + torque_input
            variables = rigid_variables(made, code, names, torque_input, fmi)
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
        kinds=("CoSimulation",) if isinstance(machine, ContactMachine) else ("ModelExchange", "CoSimulation"),
    )
    shared = files("textile_twin_core.fmu") / "c"
    parts = ("variables.c", *runtime, interface)
    sources = {name: (shared / name).read_bytes() for name in ("textile_twin.h", *parts)}
    together = "".join(f'#include "{name}"\n' for name in ("model.c", *parts))
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
