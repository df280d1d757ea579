"""The robot description: every body of a link counts."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body


def test_bodies_of_one_link_are_put_together() -> None:
    """Against the sums of mass, first and second moment of three bodies about the link's start."""
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
