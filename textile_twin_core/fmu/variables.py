"""Variables of an FMU: inputs, states, outputs and parameters, with their value references."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

from textile_twin_core.fmu.chain_code import ChainCode
from textile_twin_core.fmu.model_code import ModelCode
from textile_twin_core.fmu.model_description import Variable
from textile_twin_core.machines.symbolic_machine import SymbolicMachine

_TIME, _TORQUE, _THETA, _OMEGA, _ALPHA, _DER_THETA = range(6)
_INDICATOR, _OUTPUT, _PARAMETER, _STATE, _DER_STATE = 100, 1000, 100_000, 200_000, 300_000
"""Value references, as in c/textile_twin.h."""
_SHAFT = {"theta": "theta_rad", "omega": "omega_rad_s", "alpha": "alpha_rad_s2"}


def rigid_variables(
    made: SymbolicMachine, code: ModelCode, outputs: Sequence[str], torque_input: bool, fmi: int
) -> list[Variable]:
    """List the variables of a linkage on a rigid shaft."""
    shaft, known = _SHAFT, _time(fmi)
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
        known += _motion_inputs()
    for k, (name, depends) in enumerate(zip(outputs, code.depends, strict=True)):
        on = moved if torque_input and "alpha" in depends else tuple(shaft[d] for d in shaft if d in depends)
        known.append(Variable(name, _OUTPUT + k, "output", initial="calculated", depends=on))
    return known + _indicators(code.leaps + torque_input, fmi) + _parameters(made.parameters)


def chain_variables(
    chain: ChainCode, outputs: Sequence[str], torque_input: bool, fmi: int, indicators: int
) -> list[Variable]:
    """List the variables of an elastic shaft; a variable of the chain depends on all of its states."""
    shaft = tuple(_SHAFT.values())
    known = _time(fmi)
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
        known += _motion_inputs("of the encoder's station")
        others = [name for k, name in enumerate(chain.stations) if k != chain.driven]
        states = [*twists, *(f"shaft.relative_speed_{name}_rad_s" for name in others)]
    known += _outputs(outputs)
    for k, state in enumerate(states):
        known += [
            Variable(state, _STATE + k, "local", initial="calculated"),
            Variable(f"der({state})", _DER_STATE + k, "local", initial="calculated", derivative_of=state, depends=None),
        ]
    return known + _indicators(indicators, fmi) + _parameters(chain.parameters)


def contact_variables(outputs: Sequence[str], parameters: Mapping[str, float], fmi: int) -> list[Variable]:
    """List the variables of a contact machine; its outputs depend on everything, its states are internal."""
    return _time(fmi) + _motion_inputs() + _outputs(outputs) + _parameters(parameters)


def _time(fmi: int) -> list[Variable]:
    return [Variable("time", _TIME, "independent")] if fmi == 3 else []


def _motion_inputs(description: str = "") -> list[Variable]:
    return [
        Variable(name, reference, "input", start=0.0, description=description)
        for name, reference in zip(_SHAFT.values(), (_THETA, _OMEGA, _ALPHA), strict=True)
    ]


def _outputs(names: Sequence[str]) -> list[Variable]:
    """Outputs that depend on everything."""
    return [Variable(name, _OUTPUT + k, "output", initial="calculated", depends=None) for k, name in enumerate(names)]


def _indicators(count: int, fmi: int) -> list[Variable]:
    numbers = range(count if fmi == 3 else 0)
    return [Variable(f"event_indicator_{k}", _INDICATOR + k, "local", initial="calculated") for k in numbers]


def _parameters(values: Mapping[str, float]) -> list[Variable]:
    return [
        Variable(name, _PARAMETER + k, "parameter", "tunable", "exact", value)
        for k, (name, value) in enumerate(values.items())
    ]
