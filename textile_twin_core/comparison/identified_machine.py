"""Machine declarations with identified values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from textile_twin_core.comparison.torque_model import DELAY, EVENTS, GAIN, INERTIA, OFFSET, ZERO
from textile_twin_core.comparison.unmodelled import UnmodelledTorque
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import Backing, Load, ShaftFriction, TorqueTable
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensors import Sensors, TorqueSensor
from textile_twin_core.twin import compile_machine


def identified_machine(machine: Machine, values: Mapping[str, float], free: Sequence[str]) -> Machine:
    """Return the machine with the identified loads, inertia and sensors; fixed parameters stay as declared.

    A negative added inertia is left out, since a declared inertia cannot be negative.
    """
    loads: list[Load] = []
    for load in machine.loads:
        if isinstance(load, Backing) and any(name in free for name in ("backing_force_N", "free_force_N", *EVENTS)):
            load = _backing(machine, load, values)
        if not isinstance(load, ShaftFriction):
            loads.append(load)
    friction = ShaftFriction(max(values["shaft_viscous_Nms"], 0.0), max(values["shaft_coulomb_Nm"], 0.0))
    if friction != ShaftFriction():
        loads.append(friction)
    bodies = machine.bodies
    if values[INERTIA] > 0.0:
        bodies = (*bodies, Body.flywheel(values[INERTIA]))
    encoder = machine.sensors.encoder
    sensors = Sensors(
        replace(encoder, zero_rad=values[ZERO]),
        TorqueSensor(values[GAIN], values[OFFSET], values[DELAY]),
    )
    return replace(machine, loads=tuple(loads), bodies=bodies, sensors=sensors)


def with_table(machine: Machine, torque: UnmodelledTorque) -> Machine:
    """Return the machine with the unmodelled torque as an additional load: the drive gives what the load takes.

    Raises RecordingError for a torque over several turns, which no load of a machine can be.
    """
    if torque.cycle_turns > 1:
        raise RecordingError(
            f"the torque that nobody modelled lasts {torque.cycle_turns} turns, and a machine's table lasts one: take"
            " it from the JSON"
        )
    table = TorqueTable(tuple(torque.angle_rad.tolist()), tuple((-torque.torque_Nm).tolist()))
    return replace(machine, loads=(*machine.loads, table))


def _backing(machine: Machine, load: Backing, values: Mapping[str, float]) -> Backing:
    name = f"{load.on}_position_m"
    travel = compile_machine(machine, [name])
    entry, leave = (float(travel.evaluate(values[event], 1.0, 0.0)[name]) for event in EVENTS)
    return replace(
        load,
        force_N=max(values["backing_force_N"], 0.0),
        free_force_N=max(values["free_force_N"], 0.0),
        entry_plane_m=entry,
        exit_plane_m=leave,
    )
