"""C sources of one machine: its outputs, acceleration and events."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
import numpy.typing as npt

from textile_twin_core.dynamics.motion_equation import level, split_leaps
from textile_twin_core.expression import Expr, const, topological_order, variable
from textile_twin_core.expression.c_source import PLAIN_SINCOS, c_function, c_statements, hoisted, with_parameters
from textile_twin_core.machine import Machine
from textile_twin_core.machine.drive import load_torques
from textile_twin_core.machine.model import total
from textile_twin_core.machines.symbolic_machine import SymbolicMachine

_STATE = "const double *c, double theta, double omega"
_OUTPUTS = f"TT_LOCAL void tt_outputs({_STATE}, double alpha, const double *leap, double *y)"
_LEAPS = f"TT_LOCAL void tt_leaps({_STATE}, double alpha, double *value, double *level)"
_ACCELERATION = f"TT_LOCAL double tt_acceleration({_STATE}, double torque, const double *leap)"
_OMEGA, _TORQUE = variable("omega"), variable("torque")


@dataclass(frozen=True)
class ModelCode:
    """Generated C sources of a machine.

    Attributes:
        header, source: model.h and model.c.
        token: identifies this model description.
        leaps: number of load steps, each a state event.
        depends: for each output, the variables that it depends on: theta, omega, alpha.
    """

    header: str
    source: str
    token: str
    leaps: int
    depends: tuple[frozenset[str], ...]


def quantities(outputs: Sequence[str], torque_input: bool, machine: Machine) -> list[Expr]:
    """Return the expressions of an export: the outputs and, for a torque as input, the equation of motion."""
    model = machine.model
    needed = [model.output(name) for name in outputs]
    if torque_input:
        terms = ("equivalent_inertia_kgm2", "equivalent_inertia_slope_kgm2", "torque_gravity_Nm")
        needed += [*(model.output(name) for name in terms), *load_torques(machine)]
    return needed


def model_code(made: SymbolicMachine, outputs: Sequence[str], torque_input: bool, about: object) -> ModelCode:
    """Write the C sources of a machine.

    Args:
        made: the machine with symbolic parameters.
        outputs: names of its outputs.
        torque_input: whether the drive torque is the input, instead of the shaft's motion.
        about: further text that distinguishes the model description.
    """
    machine, names = made.machine, list(made.parameters)
    asked = shown = [machine.model.output(name) for name in outputs]
    if torque_input:
        inertia, slope, weight, *loads = quantities((), True, machine)
        # Outputs hold the same sides of the steps as the acceleration: at an event, too, they belong to one state.
        leaps, held, _ = split_leaps([*loads, *shown], "leap[{}]")
        smooth, shown = held[: len(loads)], held[len(loads) :]
        along = _TORQUE + total(smooth) - 0.5 * slope * (_OMEGA * _OMEGA) - weight
        acceleration = along / inertia
    else:
        leaps, _, _ = split_leaps(shown)
        acceleration = const(0.0)
    levels = [level(leap) for leap in leaps]
    taken, (shown_code, leap_code, (push,)) = hoisted([shown, [*leaps, *levels], [acceleration]], "c")
    constants = with_parameters(taken, {name: f"p[{k}]" for k, name in enumerate(names)})
    lines, (result,) = c_statements([push])
    count = len(leaps)
    parts = [
        '#include <math.h>\n#include "textile_twin.h"\n',
        PLAIN_SINCOS,
        c_function("TT_LOCAL void tt_start_values(double *p)", [const(v) for v in made.parameters.values()], "p"),
        c_function("TT_LOCAL void tt_constants(const double *p, double *c)", constants, "c"),
        c_function(_OUTPUTS, shown_code, "y"),
        _leaps(leap_code[:count], leap_code[count:]),
        f"{_ACCELERATION} {{\n" + "".join(f"    {line}\n" for line in lines) + f"    return {result};\n}}\n",
    ]
    source = "\n".join(parts)
    depends = tuple(frozenset(str(n.payload) for n in topological_order([e]) if n.op == "variable") for e in asked)
    sizes = {
        "CHAIN": 0,
        "TORQUE_INPUT": int(torque_input),
        "OUTPUTS": len(outputs),
        "PARAMETERS": len(names),
        "CONSTANTS": len(constants),
        "LEAPS": count,
    }
    return finished(source, sizes, [outputs, names, about], count, depends)


def finished(
    source: str, sizes: Mapping[str, float], about: object, leaps: int, depends: tuple[frozenset[str], ...]
) -> ModelCode:
    """Add the header with the sizes, and the token of source and `about`."""
    token = sha256(json.dumps([source, about]).encode()).hexdigest()
    token = f"{{{token[:8]}-{token[8:12]}-{token[12:16]}-{token[16:20]}-{token[20:32]}}}"
    header = "".join(f"#define TT_{name} {value}\n" for name, value in {**sizes, "TOKEN": f'"{token}"'}.items())
    return ModelCode(header, source, token, leaps, depends)


def static_array(name: str, values: npt.NDArray[np.generic]) -> str:
    """Declare a static array; an empty one has a single zero."""
    values = values if values.size else np.zeros((1,) * values.ndim, values.dtype)
    sizes = "".join(f"[{n}]" for n in values.shape)

    def braces(part: npt.NDArray[np.generic]) -> str:
        inner = ", ".join(repr(v) for v in part.tolist()) if part.ndim == 1 else ",\n".join(map(braces, part))
        return f"{{{inner}}}"

    return f"static const {name}{sizes} = {braces(values)};\n"


def _leaps(values: Sequence[Expr], levels: Sequence[Expr]) -> str:
    lines, found = c_statements([*values, *levels])
    stores = [f"value[{k}] = {each};" for k, each in enumerate(found[: len(values)])]
    stores += [f"level[{k}] = {each};" for k, each in enumerate(found[len(values) :])]
    body = "".join(f"    {line}\n" for line in [*lines, *stores])
    return f"{_LEAPS} {{\n{body}}}\n"
