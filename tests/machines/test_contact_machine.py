"""Contact machines declared from their parts: closed forms of a picker, energy, files, twins, robot description."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.contact import FRAME, Pad, SlidingBody, SpringDamper, Stop
from textile_twin_core.errors import MachineError, TwinError
from textile_twin_core.files.machine_file import save_machine_file
from textile_twin_core.machine import ContactMachine, DrivenElement
from textile_twin_core.mechanism.law_strokes import Stroke
from textile_twin_core.mechanism.motion_law import MotionLaw, Section
from textile_twin_core.recordings.predicted_topics import predicted_topics

EXAMPLE = Path(__file__).parents[2] / "examples" / "picker.yaml"
SPEED = 20.0
STICK = DrivenElement("stick", (Stroke(1.0, 0.8, 0.17), Stroke(3.2, 1.4, 0.0, "cycloidal")), mass_kg=0.6)
STRAP = SpringDamper("strap", "stick", "picker", 24e3)


def picker(**declared: Any) -> ContactMachine:
    parts: dict[str, Any] = {"name": "picker", "driven": STICK, "bodies": (SlidingBody("picker", 0.25),)}
    return ContactMachine(**(parts | {"springs": (STRAP,), "nominal_speed_rad_s": SPEED} | declared))


def test_a_pick_at_uniform_nominal_acceleration() -> None:
    """A picker on an elastic strap follows x = s - a / n^2 (1 - cos n t) with n^2 = k / m.

    The frequency n is the loom's "alacrity" (Marks and Robinson, Principles of Weaving, 1976).
    """
    a, n = 900.0, math.sqrt(24e3 / 0.25)
    whole = Section((0.0, 0.0, 0.5 * a / SPEED**2))
    law = MotionLaw("uniform", (0.0, 0.5), (whole, Section((whole.value(0.5),))))
    machine = picker(driven=DrivenElement("stick", law=law))
    times = np.linspace(0.0, 0.5 / SPEED, 200)[:-1]
    run = machine.simulate(times=times)
    s = 0.5 * a * times**2
    np.testing.assert_allclose(run.positions[1], s, atol=1e-16)
    np.testing.assert_allclose(run.positions[0], s - a / n**2 * (1.0 - np.cos(n * times)), atol=1e-15)
    np.testing.assert_allclose(run.velocities[0], a * times - a / n * np.sin(n * times), atol=1e-12)


def test_a_buffer_and_a_stop_send_it_back() -> None:
    """It stays half a period on an elastic buffer; a stop gives back its restitution."""
    buffer = Pad("buffer", FRAME, "picker", 0.19, (3e4,))
    rear = Stop("rear", "picker", FRAME, 0.0, 0.25)
    machine = picker(springs=(), pads=(buffer, Pad("strap", "picker", "stick", 0.0, (24e3,))), stops=(rear,))
    run = machine.simulate(end_s=4.0 * math.pi / SPEED)
    touch, leave = (run.happened(kind, "buffer")[0] for kind in ("touch", "leave"))
    assert leave.time_s - touch.time_s == pytest.approx(math.pi * math.sqrt(0.25 / 3e4), rel=1e-12)
    pulled = dataclasses.replace(machine, bodies=(SlidingBody("picker", 0.25, -8.0),))
    run = pulled.simulate(end_s=4.0 * math.pi / SPEED)
    hit = run.happened("impact", "rear")[0]
    assert hit.energy_lost_J == pytest.approx(0.5 * 0.25 * hit.approach_speed_m_s**2 * (1.0 - 0.25**2), rel=1e-12)
    assert run.energies.imbalance < 1e-13


def test_energy_of_the_example_over_five_picks() -> None:
    machine = ttc.load_machine(EXAMPLE)
    assert isinstance(machine, ContactMachine)
    run = machine.simulate(end_s=5.0 * 2.0 * math.pi / machine.nominal_speed_rad_s)
    assert run.energies.imbalance < 1e-12
    assert len(run.happened("touch", "buffer")) > 5
    assert run.positions[0].min() > -1e-12
    assert 0.195 < run.positions[0].max() < 0.21
    lost = run.energies.impact_J[-1] + run.energies.damped_J[-1]
    assert lost == pytest.approx(run.energies.work_J[-1], rel=0.05)  # what the drive gives is worn away in the rubber


def test_torque_of_the_drive_does_its_work() -> None:
    """The torque over the angle is the work of the force on the stick: damped, lost and stored energy."""
    machine = ttc.load_machine(EXAMPLE)
    theta = np.linspace(0.0, 2.0 * math.pi, 200_001)
    twin = ttc.compile(machine, outputs=["balancing_torque_Nm"])
    torque = twin.evaluate(theta, machine.nominal_speed_rad_s)["balancing_torque_Nm"]
    energies = machine.simulate().energies  # type: ignore[attr-defined]
    assert np.trapezoid(torque, theta) == pytest.approx(energies.work_J[-1], rel=1e-5)


@pytest.mark.parametrize("machine", [ttc.machines.needle_transfer(), picker(nominal_speed_rad_s=SPEED)])
def test_the_equivalent_inertia_is_that_of_the_driven_element(machine: ContactMachine) -> None:
    """J omega^2 / 2 is its kinetic energy by the slope of its place, J' omega^2 / 2 its torque at an even speed."""
    speed, driven = machine.nominal_speed_rad_s, machine.driven.name
    theta = np.linspace(0.0, 2.0 * math.pi, 4001)
    names = ["equivalent_inertia_kgm2", "torque_inertial_Nm", "kinetic_energy_J"]
    names += [f"{element}_velocity_m_s" for element in machine.elements]
    found = ttc.compile(machine, outputs=[*names, f"{driven}_position_m"]).evaluate(theta, speed, 0.0)
    inertia = found["equivalent_inertia_kgm2"]
    moved = np.gradient(found[f"{driven}_position_m"], theta / speed)
    own = 0.5 * machine.driven.mass_kg * moved**2
    assert own.max() > 1e-2
    np.testing.assert_allclose(0.5 * inertia * speed**2, own, atol=1e-4 * own.max())
    bodies = sum(0.5 * body.mass_kg * found[f"{body.name}_velocity_m_s"] ** 2 for body in machine.bodies)
    np.testing.assert_allclose(0.5 * inertia * speed**2 + bodies, found["kinetic_energy_J"], rtol=1e-12, atol=1e-15)
    torque = found["torque_inertial_Nm"]
    slope = np.gradient(inertia, theta)
    np.testing.assert_allclose(0.5 * slope * speed**2, torque, atol=2e-3 * np.abs(torque).max())


def test_file_and_python_declare_the_same(tmp_path: Path) -> None:
    machine = ttc.load_machine(EXAMPLE)
    ours = picker(
        description=machine.description,
        nominal_speed_rad_s=18.85,
        springs=(SpringDamper("return_spring", FRAME, "picker", 90.0, 0.8, -0.05),),
        stops=(Stop("rear_stop", "picker", FRAME, 0.0, 0.3),),
        pads=(
            Pad("strap", "picker", "stick", 0.0, (24e3,), 6.0),
            Pad("buffer", FRAME, "picker", 0.19, (3e4, 0.0, 4e8), 40.0),
        ),
    )
    assert machine == ours
    turned = MotionLaw("to and fro", (0.0,), (Section(amplitude=0.05, frequency=1.0),))
    own_law = picker(driven=DrivenElement("stick", law=turned), start_m={"picker": 0.0})
    for saved in (machine, own_law, ttc.machines.needle_transfer(design="optimised", value_e_m=0.008)):
        save_machine_file(saved, tmp_path / "again.yaml")
        assert ttc.load_machine(tmp_path / "again.yaml") == saved


def test_a_session_gives_what_a_run_gives_and_the_robot_slides() -> None:
    machine = ttc.load_machine(EXAMPLE)
    speed = machine.nominal_speed_rad_s
    stamps = (np.arange(600) * 1_000_000).astype(np.int64)
    angles = speed * stamps * 1e-9
    names = ["picker_position_m", "picker_velocity_m_s"]
    session = ttc.compile(machine, outputs=names).session()
    found = session.step(stamps, angles, np.full(600, speed))
    run = machine.simulate(times=stamps[found.index] * 1e-9)  # type: ignore[attr-defined]
    np.testing.assert_allclose(found["picker_position_m"][300:], run.positions[0][300:], atol=1e-4)
    assert dict(predicted_topics(machine).joints)["picker"] == tuple(names)
    robot = Xml.fromstring(machine.urdf())
    joints = {joint.get("name"): joint for joint in robot.findall("joint")}
    assert joints["picker"].get("type") == "prismatic"
    limit = joints["picker"].find("limit")
    assert limit is not None and 0.195 < float(limit.get("upper", "nan")) < 0.21


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ({"start_m": {"shuttle": 0.1}}, "start_m names 'shuttle'; bodies: picker"),
        ({"nominal_speed_rad_s": 0.0}, "nominal_speed_rad_s must be positive"),
        ({"axis": (0.0, 0.0)}, "axis must be a finite vector"),
        ({"springs": (dataclasses.replace(STRAP, stiffness_N_m=1e15),)}, "too stiff to be followed"),
        ({"springs": (dataclasses.replace(STRAP, lower="stik"),)}, "no element is called 'stik'"),
        ({"stops": (Stop("rear", "picker", FRAME, -0.1),)}, "rear"),
    ],
)
def test_wrong_declarations(declared: dict[str, Any], said: str) -> None:
    with pytest.raises(TwinError, match=said):
        picker(**declared)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("driven: {name: stick}", "one of strokes, table and law"),
        ("driven: {name: stick, strokes: [{start_rad: 0, turn_rad: 1, to: 0.1}]}", "must lead back to 0"),
        (
            "driven: {name: stick, strokes: [{start_rad: 0, turn_rad: 1, too: 0.1}]}",
            r"driven.strokes\[0\].too: unknown",
        ),
        ("driven: {name: stick}\ngroups: []", "groups: unknown key"),
    ],
)
def test_a_wrong_file_names_the_place(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MachineError, match=said):
        ttc.load_machine(path)
