"""Tests of natural frequencies and critical speeds drawn over an order-speed map."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.comparison.orders import order_map
from textile_twin_core.driveline import elastic_shaft, find_resonances
from textile_twin_core.views.orders_picture import orders_figure

RPM = math.pi / 30.0


def test_the_line_of_a_mode_and_its_critical_speeds_stand_where_they_are_met() -> None:
    machine = ttc.load_machine(Path(__file__).parents[2] / "examples" / "wide_tufting.yaml")
    assert isinstance(machine, ttc.Machine)
    time = np.arange(0.0, 12.0, 1e-3)
    speed = (300.0 + 15.0 * time) * RPM
    theta = np.cumsum(speed) * 1e-3
    found = order_map(time, theta, np.cos(15.0 * theta), max_order=24)
    resonances = find_resonances(elastic_shaft(machine), (300.0 * RPM, 480.0 * RPM))
    figure = orders_figure({"torque [N m]": found}, resonances)
    axes = next(each for each in figure.axes if each.get_title(loc="left") == "Order over speed")
    rpm, order = axes.lines[0].get_data()
    np.testing.assert_allclose(np.asarray(rpm) * np.asarray(order) / 60.0, resonances.modes[0].damped_Hz)
    dots = np.concatenate([np.asarray(each.get_offsets()) for each in axes.collections if each.get_array() is None])
    # Order 15 of this machine meets its first mode at 448.9 rpm (integrated run-ups).
    assert abs(dots[np.argmin(abs(dots[:, 1] - 15.0)), 0] - 448.9) < 0.005 * 448.9
    assert set(dots[:, 1]) == {each.order for each in resonances.critical if each.mode == 1 and each.order < 24}
