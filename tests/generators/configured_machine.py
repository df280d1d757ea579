"""The machine of a case's user: the engine's own declaration with the case's sensor settings."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import textile_twin_core as ttc
from tests.generators.mill_recordings import Case
from tests.generators.rocker_spring import SPRINGS
from tests.generators.shaft_law import LOOM_FILE
from textile_twin_core.dynamics.loads import ShaftFriction, Spring
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensors import Encoder, Sensors, TorqueSensor


@cache
def _declared(name: str) -> Machine:
    if name == "tufting":
        return ttc.machines.tufting()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "friction_loom.yaml"
        path.write_text(LOOM_FILE)
        machine = ttc.load_machine(path)
    assert isinstance(machine, Machine)
    return machine


def configured_machine(case: Case) -> Machine:
    """Return the machine of the user's machine file."""
    machine, configured = _declared(case.configured_machine), case.configured
    if not configured.friction:
        machine = replace(machine, loads=tuple(load for load in machine.loads if not isinstance(load, ShaftFriction)))
    if case.spring:
        spring = SPRINGS[case.configured_machine]
        anchor = (spring.anchor.real, spring.anchor.imag)
        load = Spring("B", "G", spring.stiffness_N_m, spring.free_length_m)
        machine = replace(machine, points={**machine.points, "G": anchor}, loads=(*machine.loads, load))
    encoder = Encoder(configured.zero_rad, configured.direction, configured.ratio)
    return replace(
        machine, sensors=Sensors(encoder, TorqueSensor(configured.gain, configured.offset_Nm, configured.delay_s))
    )
