"""Designs with slotted levers, yokes and gears at once, against the exact machine, one by one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.mechanism.test_slotted_mechanisms import BLOCK_SHAPER, CYLINDER, FIVE_BAR, SHAPER, WHITWORTH, YOKE
from tests.synthesis.test_batch import exact_numbers
from textile_twin_core.dynamics.loads import SliderFriction
from textile_twin_core.errors import MachineError
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import read, write
from textile_twin_core.mechanism import GearPair, RPPDyad, RPRDyad, RRPDyad, Travel
from textile_twin_core.synthesis import Batch, family_of
from textile_twin_core.synthesis.design_chart import TRANSMISSION


def measured(machine: Machine, point: str) -> Machine:
    sliders = [joint.child_link for joint in machine.joints if joint.kind == "prismatic"]
    measure = Travel("tool", point, "O", (1.0, 0.3))
    friction = tuple(SliderFriction(slider, 5.0) for slider in sliders)
    return dataclasses.replace(machine, measures=(measure,), loads=friction)


def on_a_link(group: RPPDyad | RRPDyad, name: str) -> Machine:
    bare = Machine(name, {"O": (0.0, 0.0), "C": (0.4, 0.1)}, (*CYLINDER.groups, group))
    return measured(dataclasses.replace(bare, bodies=(*CYLINDER.bodies, *YOKE.bodies[2:])), "E")


GUIDE = (0.1, 0.0), (1.0, 0.2)
MACHINES = [
    measured(WHITWORTH, "B"),
    measured(SHAPER, "E"),
    measured(BLOCK_SHAPER, "E"),
    measured(CYLINDER, "B"),
    measured(YOKE, "T"),
    measured(FIVE_BAR, "B"),
    on_a_link(RPPDyad("die", "ram", "A", "Q", ("S", "E"), (0.1, 0.2), *GUIDE, 1.2, "slider"), "yoke on it"),
    on_a_link(RRPDyad("rod", "ram", "A", "D", "E", (0.5, 0.2), *GUIDE, "forward", "slider"), "ram on it"),
]


def agrees(machine: Machine, change: float) -> None:
    """Check two designs with all parameters changed by a relative standard deviation, against the machine of each."""
    random = np.random.default_rng(7)
    family, speed = family_of(machine), 11.0
    batch = Batch(family, speed_rad_s=speed, samples=720)
    known = {p.name: p.value for p in family.parameters if p.value is not None and p.name in family.searchable}
    known = {name: value for name, value in known.items() if name not in batch.fixed(known)}
    values = {
        name: (value * (1.0 + change * random.standard_normal(2)) if value else 0.1 * change * random.random(2))
        for name, value in known.items()
    }
    found = batch.evaluate(values, batch.names)
    for k in range(2):
        one = family.machine({name: float(v[k]) for name, v in values.items()})
        assert isinstance(one, Machine)
        for name, value in exact_numbers(one, speed).items():
            assert found[name][k] == pytest.approx(value, rel=1e-8), name
        worst = min((close.transmission_angle_rad for close in one.closeness), default=math.pi / 2.0)
        assert found[TRANSMISSION][k] == pytest.approx(worst, abs=1e-6)


@pytest.mark.parametrize("machine", MACHINES, ids=lambda machine: machine.name)
def test_a_batch_agrees_with_the_exact_machine(machine: Machine) -> None:
    agrees(machine, 0.01)


def test_a_design_that_leaves_its_slot_has_no_numbers() -> None:
    lever = next(group for group in SHAPER.groups if isinstance(group, RPRDyad))
    groups = tuple(dataclasses.replace(g, slot_m=(0.13, 0.37)) if g is lever else g for g in SHAPER.groups)
    machine = measured(dataclasses.replace(SHAPER, groups=groups), "E")
    found = Batch(family_of(machine)).evaluate({"crank.length_m": np.array([0.05, 0.11, 0.13])}, ["tool_stroke_m"])[
        "tool_stroke_m"
    ]
    assert np.isfinite(found).tolist() == [True, True, False]
    with pytest.raises(MachineError, match="leaves its slot"):
        write(machine, {"crank.length_m": 0.13})


def test_every_number_of_a_crossing_is_a_slot_of_its_own() -> None:
    slots = read(BLOCK_SHAPER)
    assert slots["ram.guide_y_m"] == 0.22
    moved = write(BLOCK_SHAPER, {"ram.guide_y_m": 0.21, "lever.offset_m": 0.01})
    after = read(moved)
    assert {name for name, value in after.items() if value != slots[name]} == {"ram.guide_y_m", "lever.offset_m"}


def test_a_planet_on_a_link_that_swings() -> None:
    """At a ratio that is no whole number the planet's direction depends on the link's continuous angle."""
    machine = ttc.load_machine("examples/geared_five_bar.yaml")
    assert isinstance(machine, Machine)
    planet = GearPair("planet", "D", "B", "K", 0.02, (60, 40), "l4", mesh="M")
    made = dataclasses.replace(
        machine, groups=(*machine.groups, planet), measures=(Travel("tool", "K", "O", (1, 0.3)),)
    )
    agrees(made, 0.01)


def test_a_cam() -> None:
    """Its radii select a closed form; masses, loads and the dyads beside it vary."""
    machine = ttc.load_machine("examples/cam_loom.yaml")
    assert isinstance(machine, Machine)
    agrees(machine, 0.003)
