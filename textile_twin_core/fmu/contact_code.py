"""C sources of a contact machine: its elements and parts, the law of motion, parameters, outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import Pad, SpringDamper, Stop
from textile_twin_core.errors import SceneError
from textile_twin_core.fmu.model_code import ModelCode, finished, static_array
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machine.contact_machine import DRIVE, MOTION
from textile_twin_core.mechanism.motion_law import TURN


def contact_code(
    machine: ContactMachine, outputs: Sequence[str], about: object
) -> tuple[ModelCode, Mapping[str, float]]:
    """Write the C sources of a contact machine.

    Args:
        machine: the machine.
        outputs: names of its outputs.
        about: further text that distinguishes the model description.

    Returns:
        The sources, and the parameters: the numbers of bodies, springs, stops and pads by their place in the machine
        file. The law of motion of the driven element is constant.

    Raises:
        SceneError: for an unknown output.
    """
    for name in outputs:
        if name not in machine.outputs:
            raise SceneError(f"machine '{machine.name}' has no output '{name}'; outputs: {', '.join(machine.outputs)}")
    parameters, plant = _parameters(machine)
    law = machine.law
    powers = max(len(section.polynomial) for section in law.sections)
    polynomials = np.array(
        [np.pad(section.arrays[0], (0, powers - len(section.polynomial))) for section in law.sections]
    )
    model = machine.model
    order = [f"{element}_{motion}" for motion in MOTION for element in model.movers] + list(DRIVE)
    tables = {
        "double tt_spring_ends": _ends(machine, model.springs, 1.0),
        "double tt_stop_ends": _ends(machine, model.stops, -1.0),  # opens the gap
        "double tt_pad_ends": _ends(machine, model.pads, 1.0),
        "int tt_pad_pulls": np.array([int(pad.pulls) for pad in model.pads], dtype=np.int64),
        "double tt_law_start": np.array([*law.starts_rad, TURN]),
        "double tt_law": polynomials,
        "double tt_wave": np.array([section.arrays[1] for section in law.sections]),
        "int tt_output": np.array([order.index(name) for name in outputs], dtype=np.int64),
    }
    starts = "".join(f"    p[{k}] = {value!r};\n" for k, value in enumerate(parameters.values()))
    assignments = "".join(f"    s->{line};\n" for line in plant)
    source = "\n".join(
        [
            '#include <math.h>\n#include "textile_twin.h"\n',
            *(static_array(name, values) for name, values in tables.items()),
            f"TT_LOCAL void tt_start_values(double *p) {{\n{starts}}}\n",
            f"TT_LOCAL void tt_plant(const double *p, tt_state *s) {{\n{assignments}}}\n",
        ]
    )
    sizes = {
        "CHAIN": 0,
        "CONTACT": 1,
        "TORQUE_INPUT": 0,
        "OUTPUTS": len(outputs),
        "PARAMETERS": len(parameters),
        "BODIES": len(model.bodies),
        "SPRINGS": len(model.springs),
        "STOPS": len(model.stops),
        "PADS": len(model.pads),
        "PAD_POWERS": max((len(pad.stiffness) for pad in model.pads), default=1),
        "SECTIONS": len(law.sections),
        "LAW_POWERS": powers,
        "NOMINAL_SPEED": float(machine.nominal_speed_rad_s),
    }
    return finished(source, sizes, [outputs, list(parameters), about], 0, ()), parameters


def _parameters(machine: ContactMachine) -> tuple[dict[str, float], list[str]]:
    """Return the parameters by name, and the C assignments of the machine's numbers from them."""
    found: dict[str, float] = {}
    lines: list[str] = []

    def p(place: str, name: str, value: float) -> None:
        lines.append(f"{place} = p[{len(found)}]")
        found[name] = float(value)

    for k, body in enumerate(machine.bodies):
        p(f"mass[{k}]", f"bodies.{body.name}.mass_kg", body.mass_kg)
        p(f"weight[{k}]", f"bodies.{body.name}.force_N", body.force_N)
        p(f"start[{k}]", f"start_m.{body.name}", machine.start[k])
    p("driven_mass", "driven.mass_kg", machine.driven.mass_kg)
    for k, spring in enumerate(machine.springs):
        place, name = f"spring[{k}]", f"springs.{spring.name}"
        p(f"{place}.stiffness", f"{name}.stiffness_N_m", spring.stiffness_N_m)
        p(f"{place}.damping", f"{name}.damping_Ns_m", spring.damping_Ns_m)
        p(f"{place}.free_length", f"{name}.free_length_m", spring.free_length_m)
    for k, stop in enumerate(machine.stops):
        p(f"stop[{k}].limit", f"stops.{stop.name}.limit_m", stop.limit_m)
        p(f"stop[{k}].restitution", f"stops.{stop.name}.restitution", stop.restitution)
    for k, pad in enumerate(machine.pads):
        p(f"pad[{k}].position", f"pads.{pad.name}.position_m", pad.position_m)
        p(f"pad[{k}].damping", f"pads.{pad.name}.damping_Ns_m", pad.damping_Ns_m)
        for power, stiffness in enumerate(pad.stiffness):
            p(f"pad[{k}].stiffness[{power}]", f"pads.{pad.name}.stiffness[{power}]", stiffness)
    return found, lines


def _ends(machine: ContactMachine, parts: Sequence[SpringDamper | Stop | Pad], sign: float) -> FloatArray:
    """Build rows (parts, elements) with `sign` at the upper and -`sign` at the lower end of each part."""
    movers = machine.model.movers
    rows = np.zeros((len(parts), len(movers)))
    for row, part in zip(rows, parts, strict=True):
        for end, value in ((part.upper, sign), (part.lower, -sign)):
            if end in movers:
                row[movers.index(end)] += value
    return rows
