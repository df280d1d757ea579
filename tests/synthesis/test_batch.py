"""Many designs at once against the exact machine, one by one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core import machines
from textile_twin_core.dynamics.loads import (
    JointDamping,
    JointFriction,
    PointDamping,
    SliderFriction,
    TorqueTable,
    TorsionSpring,
)
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import read, slots, write
from textile_twin_core.synthesis import Batch, family_of, offset_slider
from textile_twin_core.synthesis.balancing import shaking
from textile_twin_core.synthesis.design_chart import TRANSMISSION
from textile_twin_core.synthesis.family import DeclaredFamily
from textile_twin_core.synthesis.numbers import MOTION, dwell, largest, motion_number, shaking_numbers, torque_numbers
from textile_twin_core.synthesis.tolerance import monte_carlo, sensitivities
from textile_twin_core.synthesis.turn import over_turn, shaft_angles

GEAR_MASSES = {
    name: 0.1 + 0.01 * k if name.endswith("_kg") else 1e-3 + 1e-5 * k
    for k, name in enumerate(machines.elliptic_gear_beatup().missing_for_torque)
}
MACHINES = [
    machines.tufting(),
    machines.handloom_beatup(),
    machines.elliptic_gear_beatup(**GEAR_MASSES),
    ttc.load_machine("examples/tufting_two_linkages.yaml"),
    offset_slider(0.05, 3.3).machine(),
]


def loaded() -> Machine:
    """A six-bar with many kinds of load."""
    machine = ttc.load_machine("examples/six_bar_loom.yaml")
    assert isinstance(machine, Machine)
    more = (
        JointFriction("l2", 0.3, "l3"),
        JointDamping("l5", 0.02, "l4"),
        PointDamping("E", 3.0),
        TorsionSpring("l6", 4.0, 2.0, 0.5),
        TorsionSpring("l5", 2.0, 0.1, 0.0, "l6"),
        TorqueTable((0.0, 2.0, 4.0), (0.0, 1.0, 0.0), harmonics=1),
    )
    return replace(machine, loads=(*machine.loads, *more))


def exact_numbers(machine: Machine, speed: float) -> dict[str, float]:
    theta, found = shaft_angles(720), {}
    for measure in machine.measures:
        names = [f"{measure.name}_{k}" for k in ("position_m", "velocity_m_s", "acceleration_m_s2")]
        curves = over_turn([machine.model.output(n) for n in names], theta, speed)
        found |= {f"{measure.name}_{what}": motion_number(what, *curves) for what in MOTION}
    torque = over_turn([machine.model.output("balancing_torque_Nm")], theta, speed)[0]
    felt = shaking(machine, speed)
    return {k: float(v) for k, v in (found | torque_numbers(torque) | shaking_numbers(felt.x_N, felt.y_N)).items()}


@pytest.mark.parametrize("machine", [*MACHINES, loaded()], ids=lambda m: m.name)
def test_batch_agrees_with_the_exact_machine(machine: Machine) -> None:
    random = np.random.default_rng(7)
    family, speed = family_of(machine), 1.1 * machine.nominal_speed_rad_s
    values = {
        p.name: (p.value * (1.0 + 0.003 * random.standard_normal(3)) if p.value else 1e-3 * random.random(3))
        for p in family.parameters
        if p.name in family.searchable and p.value is not None
    }
    batch = Batch(family, speed_rad_s=speed, samples=720)
    found = batch.evaluate(values, batch.names)
    for k in range(3):
        one = family.machine({name: float(v[k]) for name, v in values.items()})
        assert isinstance(one, Machine)
        for name, value in exact_numbers(one, speed).items():
            assert found[name][k] == pytest.approx(value, rel=1e-8), name
        worst = min(close.transmission_angle_rad for close in one.closeness)
        assert found[TRANSMISSION][k] == pytest.approx(worst, abs=1e-6)


def test_designs_that_cannot_close_are_nan() -> None:
    batch = Batch(DeclaredFamily(machines.handloom_beatup()))
    found = batch.evaluate({"l3.length_m": np.array([0.23082, 0.02, 0.9])}, ["beater_stroke_m", "peak_torque_Nm"])
    assert np.isfinite(found["beater_stroke_m"]).tolist() == [True, False, False]
    assert np.isfinite(found["peak_torque_Nm"]).tolist() == [True, False, False]


@pytest.mark.parametrize("slot", ["l2.mass_kg", "l5.inertia_kgm2", "l2.length_m", "l4.length_m", "backing.force_N"])
def test_designs_that_a_machine_refuses_have_no_numbers(slot: str) -> None:
    machine = machines.tufting()
    batch, value = Batch(DeclaredFamily(machine)), read(machine)[slot]
    found = batch.evaluate({slot: np.array([value, -value, -1e-9])}, batch.names)
    with pytest.raises(MachineError):
        write(machine, {slot: -1e-9})
    for name, numbers in found.items():
        assert np.isfinite(numbers[0]) and np.isnan(numbers[1:]).all(), name
    as_it_is = batch.evaluate({"l4.angle_rad": np.array([read(machine)["l4.angle_rad"]])}, batch.names)
    assert all(np.isfinite(numbers).all() for numbers in as_it_is.values())


def test_a_tolerance_that_reaches_below_zero_is_scrap_and_no_number() -> None:
    machine = machines.tufting()
    family, name = family_of(machine), "rms_torque_Nm"
    mass = read(machine)["l2.mass_kg"]
    (parameter,) = [p.name for p in family.parameters if p.value == mass and p.unit == "kg"][:1]
    found = monte_carlo(family, {}, Batch(family), [name], {parameter: 3.0 * mass}, samples=20_000)
    assert abs(found.scrap_rate - 0.1587 + 0.0013) < 0.01  # of normal errors, one in six is beyond a sigma below
    could_be = Batch(DeclaredFamily(machine)).evaluate({"l2.mass_kg": np.linspace(0.0, 4.0 * mass, 1000)}, [name])[name]
    spread = found.spreads[name]
    assert could_be.min() - 1e-5 <= spread.worst_low and spread.worst_high <= could_be.max() + 1e-9


def test_a_mass_of_zero_has_a_sensitivity() -> None:
    machine = machines.handloom_beatup()
    family, name = family_of(machine), "largest_shaking_force_N"
    found = sensitivities(family, {}, Batch(family), [name], ["rocker_kg"])[name]["rocker_kg"]
    numbers = Batch(DeclaredFamily(machine)).evaluate({"l3.mass_kg": np.array([0.0, 1e-5])}, [name])[name]
    assert found == pytest.approx(float(np.diff(numbers)[0]) * 1e5, rel=1e-6) and found != 0.0


def test_a_design_that_opens_far_from_the_front_has_no_number_either() -> None:
    """The second dyad of the loom opens over part of the turn, in which the sley is not at its front."""
    machine = ttc.load_machine("examples/six_bar_loom.yaml")
    assert isinstance(machine, Machine)
    lengths = np.linspace(0.1, 0.2, 21)
    batch = Batch(DeclaredFamily(machine))
    found = batch.evaluate({"l5.length_m": lengths}, batch.names)
    for k, length in enumerate(lengths.tolist()):
        try:
            closes = bool(write(machine, {"l5.length_m": length}))
        except MachineError:
            closes = False
        assert {name for name in batch.names if np.isfinite(found[name][k])} == (set(batch.names) if closes else set())


def test_blocks_do_not_show() -> None:
    batch = Batch(DeclaredFamily(machines.handloom_beatup()))
    lengths = np.linspace(0.055, 0.062, 333)
    whole = batch.evaluate({"l1.length_m": lengths}, ["beater_stroke_m", "rms_torque_Nm"])
    for k in (0, 63, 64, 200, 332):
        one = batch.evaluate({"l1.length_m": lengths[k : k + 1]}, ["beater_stroke_m", "rms_torque_Nm"])
        assert one["beater_stroke_m"][0] == whole["beater_stroke_m"][k]
        assert one["rms_torque_Nm"][0] == pytest.approx(whole["rms_torque_Nm"][k], rel=1e-12)


def test_slider_with_friction_agrees() -> None:
    machine = offset_slider(0.05, 3.3).machine()
    rubbing = replace(machine, loads=(SliderFriction("l3", 12.0),))
    found = Batch(DeclaredFamily(rubbing), {}, 20.0, samples=720).evaluate({}, ["peak_torque_Nm", "rms_torque_Nm"])
    exact = exact_numbers(rubbing, 20.0)
    assert {k: v[0] for k, v in found.items()} == pytest.approx({k: exact[k] for k in found}, rel=1e-10)


def test_needles_that_do_and_do_not_come_as_far_as_the_backing() -> None:
    """The largest travel is 0.5743 m; the needle leaves at 0.56 m."""
    entries = np.array([0.5742, 0.60])
    batch = Batch(DeclaredFamily(machines.tufting(exit_plane_m=0.56)), {}, 16.755, samples=720)
    found = batch.evaluate({"backing.entry_plane_m": entries}, ["peak_torque_Nm", "rms_torque_Nm"])
    for k, entry in enumerate(entries):
        exact = exact_numbers(machines.tufting(entry_plane_m=entry, exit_plane_m=0.56), 16.755)
        for name, values in found.items():
            assert values[k] == pytest.approx(exact[name], rel=1e-8), (entry, name)


def test_unknown_names_are_refused() -> None:
    batch = Batch(DeclaredFamily(machines.handloom_beatup()))
    with pytest.raises(SceneError, match=r"no number 'l9\.length_m'"):
        batch.evaluate({"l9.length_m": np.ones(2)}, batch.names)
    with pytest.raises(SceneError, match="there is no number 'beauty'"):
        batch.evaluate({}, ["beauty"])
    with pytest.raises(SceneError):
        write(machines.handloom_beatup(), {"l9.length_m": 1.0})


def test_every_slot_can_be_written_and_read() -> None:
    machine = ttc.load_machine("examples/six_bar_loom.yaml")
    assert isinstance(machine, Machine)
    assert write(machine, read(machine)) == machine
    for slot in slots(machine)[::3]:
        before = read(machine)
        value = before[slot.name] * 1.0001 + 1e-6
        after = read(write(machine, {slot.name: value}))
        assert after == before | {slot.name: value}


@pytest.mark.parametrize("law", ["simple_harmonic", "modified_sine", "cycloidal", "polynomial_345"])
def test_the_acceleration_of_a_cam_that_starts_at_once_is_no_more_than_it_is(law: str, tmp_path: Path) -> None:
    """A simple harmonic's acceleration after a dwell begins with its largest value, lift (pi w/turn)^2/2."""
    (tmp_path / "cam.yaml").write_text(f"""
      points: {{O: [0, 0]}}
      groups:
        - {{type: cam_follower, cam: cam, follower: f, at: O, mark: M, end: B, guide_direction: [0, 1], tip: T,
           length_m: 0.1, base_radius_m: 0.1, roller_radius_m: 0.01,
           strokes: [{{start_rad: 0.3, turn_rad: 1.5, to: 0.02, law: {law}}},
                     {{start_rad: 2.5, turn_rad: 2, to: 0, law: {law}}}]}}
      measures: [{{type: travel, name: tool, point: T, origin: O, direction: [0, 1]}}]""")
    factor = {"simple_harmonic": math.pi**2 / 2, "modified_sine": 5.52796, "cycloidal": 2 * math.pi}
    largest_m_s2 = factor.get(law, 10.0 / math.sqrt(3.0)) * 0.02 * (10.0 / 1.5) ** 2
    machine = ttc.load_machine(tmp_path / "cam.yaml")
    assert isinstance(machine, Machine)
    theta = shaft_angles(720)
    names = [f"tool_{what}" for what in ("position_m", "velocity_m_s", "acceleration_m_s2")]
    curves = over_turn([machine.model.output(name) for name in names], theta, 10.0)
    assert motion_number("largest_acceleration_m_s2", *curves) == pytest.approx(largest_m_s2, rel=3e-4)
    assert motion_number("front_acceleration_m_s2", *curves) == 0.0  # it dwells there


def test_dwell_and_peaks_of_known_curves() -> None:
    theta = shaft_angles(360) + 0.0012345
    assert largest(np.cos(theta)) == pytest.approx(1.0, abs=2e-8)
    assert dwell(1.0 - np.cos(theta), 1.0 - math.cos(0.7)) == pytest.approx(1.4, abs=2e-4)
    designs = np.stack([1.0 - np.cos(theta), 2.0 - 2.0 * np.cos(theta - 1.0)])
    spans = dwell(designs, np.array([1.0 - math.cos(0.7), 2.0 * (1.0 - math.cos(0.4))]))
    assert spans == pytest.approx([1.4, 0.8], abs=2e-4)
