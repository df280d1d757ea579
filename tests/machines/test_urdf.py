"""The robot description: every body of a link counts."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body
from textile_twin_core.machine import AnyMachine, ContactMachine


def test_bodies_of_one_link_are_put_together() -> None:
    """The sums of mass, first and second moment of three bodies about the link's start."""
    machine = ttc.machines.handloom_beatup()
    bodies = (Body("l4", 0.6, 0.005), Body("l4", 2.5, 0.0, (1.0, 0.2)), Body("l4", 0.0, 0.002))
    robot = Xml.fromstring(replace(machine, bodies=bodies).urdf())
    inertial = robot.find("link[@name='l4']/inertial")
    assert inertial is not None
    mass, inertia = (float(inertial.find(tag).get(key)) for tag, key in (("mass", "value"), ("inertia", "izz")))
    centroid = np.array([float(v) for v in inertial.find("origin").get("xyz").split()[:2]])
    length = 0.3001
    places = np.array([body.centroid for body in bodies]) * length
    masses = np.array([body.mass_kg for body in bodies])
    assert mass == pytest.approx(3.1)
    assert mass * centroid == pytest.approx(masses @ places)
    about_start = 0.007 + masses @ (places**2).sum(axis=1)
    assert inertia + mass * centroid @ centroid == pytest.approx(about_start)
    assert robot.find("link[@name='l1']/inertial") is None


def joints_of(machine: AnyMachine) -> dict[str, Xml.Element]:
    return {str(joint.get("name")): joint for joint in Xml.fromstring(machine.urdf()).findall("joint")}


def bounds(joint: Xml.Element) -> tuple[float, float, float]:
    limit = joint.find("limit")
    assert limit is not None
    lower, upper, velocity = (float(str(limit.get(name))) for name in ("lower", "upper", "velocity"))
    return lower, upper, velocity


@pytest.mark.parametrize("name", ["tufting", "handloom_beatup", "elliptic_gear_beatup"])
def test_limits_are_those_of_the_motion(name: str) -> None:
    """Every position of a turn lies inside, both limits are reached, and a joint without limits turns fully."""
    machine = ttc.machines.create(name)
    assert isinstance(machine, ttc.Machine)
    moving = [joint.name for joint in machine.joints if joint.kind != "fixed"]
    columns = [f"joint_{joint}_{what}" for joint in moving for what in ("position", "velocity")]
    theta = np.linspace(0.0, 2.0 * np.pi, 20_001)
    speed = machine.nominal_speed_rad_s
    found = ttc.compile(machine, outputs=columns, method="exact").evaluate(
        theta, np.full_like(theta, speed), 0.0 * theta
    )
    described = joints_of(machine)
    for joint in moving:
        positions, velocities = found[f"joint_{joint}_position"], found[f"joint_{joint}_velocity"]
        if described[joint].get("type") == "continuous":
            assert abs(np.unwrap(positions)[-1] - positions[0]) == pytest.approx(2.0 * np.pi)
            continue
        lower, upper, velocity = bounds(described[joint])
        assert lower <= positions.min() and positions.max() <= upper
        assert (positions.min(), positions.max()) == pytest.approx((lower, upper), abs=1e-7 * (upper - lower))
        assert velocity == pytest.approx(np.abs(velocities).max(), rel=1e-3)


def test_the_tools_tip_is_where_the_topic_says() -> None:
    """The needle's tip is H1 - CF' above the shaft's axis, X1 + X2 beside it (Xu et al. 2016, Table 1)."""
    machine = ttc.machines.tufting()
    robot = Xml.fromstring(machine.urdf())
    joints = {str(joint.get("name")): joint for joint in robot.findall("joint")}
    for theta in (0.3, 2.0, 4.4):
        r = ttc.compile(machine, ["joint_needle_bar_position", "needle_position_m"]).evaluate(theta, 1.0, 0.0)
        place, turn = 0j, 1 + 0j
        for name, value in (("needle_bar", r["joint_needle_bar_position"]), ("needle_tip", 0.0)):
            origin = joints[name].find("origin")
            assert origin is not None
            x, y, _ = map(float, str(origin.get("xyz")).split())
            place += turn * complex(x, y)
            turn *= np.exp(1j * float(str(origin.get("rpy")).split()[2]))
            place += turn * value
        assert abs(place - complex(0.170, 0.155 - r["needle_position_m"])) < 1e-15
    assert robot.find("link[@name='needle_tip']") is not None


@pytest.mark.parametrize("name", ttc.machines.NAMES)
def test_links_collide_and_say_when_they_have_no_mass(name: str) -> None:
    text = ttc.machines.create(name).urdf()
    robot = Xml.fromstring(text)
    for link in robot.findall("link"):
        shapes = [link.find(f"{what}/geometry/box") for what in ("visual", "collision")]
        frame = link.get("name") in ("world", "base") or str(link.get("name")).endswith("_tip")
        assert (shapes[0] is None) is (shapes[1] is None) is frame
        silent = link.find("inertial") is None and not frame
        assert (f"no mass is declared for {link.get('name')} " in text) is silent
    children = [child.get("link") for child in robot.findall("joint/child")]
    assert sorted(children) == sorted(
        str(link.get("name")) for link in robot.findall("link") if link.get("name") != "world"
    )


def test_elements_of_the_needle_transfer_slide_within_their_limits() -> None:
    machine = ttc.machines.needle_transfer()
    assert isinstance(machine, ContactMachine)
    described, run = joints_of(machine), machine.simulate(times=np.linspace(0.0, 0.24, 7001))
    for element in ("element_1", "element_2", "element_3"):
        lower, upper, velocity = bounds(described[element])
        row = run.model.index[element]
        found = (run.positions[row].min(), run.positions[row].max())
        assert found == pytest.approx((lower, upper), abs=2e-6)
        assert np.abs(run.velocities[row]).max() <= 1.05 * velocity
    assert bounds(described["element_1"])[1] == pytest.approx(0.0326)
