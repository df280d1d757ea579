"""Peak force, depth of the pierce and work of each stitch, against the integrals of the true law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.configured_machine import configured_machine
from tests.generators.force_laws import LAWS, PLANE_M, case_of, force, pierce_in_cloth, reach, record_law
from tests.generators.mill_recordings import Case, MillRecording
from tests.generators.shaft_law import Friction
from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.fault_watch import WatchSettings
from textile_twin_core.comparison.monitor import Monitor, Trend, monitor_recording
from textile_twin_core.dynamics.loads import Backing, ForceCurve, ShaftFriction
from textile_twin_core.machine import Machine


@pytest.fixture(scope="module")
def watched() -> Trend:
    law = LAWS["pierce"]
    case = replace(case_of(law, 1, duration_s=18.0), friction=Friction(0.01, 0.25))
    made, machine = record_law(law, case), configured_machine(case)
    machine = replace(machine, loads=(*machine.loads, ShaftFriction(0.01, 0.25)))
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return monitor_recording(readings, machine, WatchSettings(learn_turns=20))


def _true_work(growing: bool) -> float:
    place = np.linspace(PLANE_M, reach("tufting"), 4001)
    values = force(LAWS["pierce"], place, growing)
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(place)))


@pytest.mark.slow
def test_work_peak_and_depth_are_those_of_the_law(watched: Trend) -> None:
    steady = np.abs(watched.columns["speed_rad_s"]) > 10.0
    median = {name: float(np.median(values[steady])) for name, values in watched.columns.items()}
    assert median["work_in_J"] == pytest.approx(_true_work(True), rel=0.02)
    assert median["work_out_J"] == pytest.approx(_true_work(False), rel=0.02)
    assert median["force_peak_N"] == pytest.approx(1235.0, rel=0.05)  # the mean of a twelfth of the depth
    assert median["pierce_depth_m"] == pytest.approx(0.2 * (reach("tufting") - PLANE_M), abs=0.001)
    single = watched.columns["work_in_J"][steady]
    assert np.std(single) < 0.02 * median["work_in_J"]  # every stitch, not their mean alone


def pierced(case: Case) -> Machine:
    """Return the machine file with the true law of the pierce and the friction."""
    knots = np.linspace(PLANE_M, reach("tufting"), 60)
    down, up = (tuple(force(LAWS["pierce"], knots, growing)) for growing in (True, False))
    curve = ForceCurve("backing", "needle_position_m", tuple(knots), down, up)
    machine = configured_machine(case)
    others = tuple(load for load in machine.loads if not isinstance(load, Backing))
    return replace(machine, loads=(*others, curve, ShaftFriction(0.01, 0.25)))


def needles(seed: int, turns: int) -> Case:
    """Return the case of a tufting machine at one speed for some turns, with samples at 250 Hz."""
    case = case_of(LAWS["pierce"], seed, duration_s=turns * 0.375, run_up=False)
    encoder, torque = (replace(each, rate_hz=250.0) for each in (case.encoder, case.torque))
    return replace(case, encoder=encoder, torque=torque, friction=Friction(0.01, 0.25))


def rolls(seed: int, turns: int, spread: float = 0.05) -> Callable[[FloatArray], FloatArray]:
    """Return the change of the cloth's force by the turn, for rolls of some turns each."""
    forces = np.random.default_rng(seed).uniform(-spread, spread, 1000)
    return lambda turn: np.asarray(forces[np.maximum(turn // turns, 0).astype(int)])


def watch(case: Case, made: MillRecording) -> Trend:
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    return monitor_recording(readings, pierced(case), WatchSettings(learn_turns=60))


@pytest.mark.parametrize(("seed", "with_pierce"), [(1, True), *more(*((s, w) for s in (2, 3) for w in (True, False)))])
def test_needles_that_blunt_are_named_beside_cloth_that_differs(seed: int, with_pierce: bool) -> None:
    """The pierce grows by 30 % over 2000 turns from the 100th on, so by 10 % until the 767th."""
    case = needles(seed, 1000)
    made = pierce_in_cloth(case, lambda turn: 0.3 * np.clip((turn - 100) / 2000, 0, 1), rolls(seed, 150), with_pierce)
    trend = watch(case, made)
    kinds = [alarm.kind for alarm in trend.alarms]
    assert kinds and set(kinds) == {"blunt_needles"} and trend.alarms[0].side == "needle"
    assert 100 < trend.alarms[0].turn - trend.columns["turn"][0] < 767 + 200
    assert 0.05 < trend.alarms[0].size < 0.13


@pytest.mark.parametrize(("seed", "turns", "with_pierce"), [(4, 500, False), *more((5, 5000, True), (6, 5000, False))])
def test_cloth_that_differs_as_usual_raises_no_alarm(seed: int, turns: int, with_pierce: bool) -> None:
    case = needles(seed, turns)
    made = pierce_in_cloth(case, lambda turn: 0.0 * turn, rolls(seed, 80), with_pierce)
    assert watch(case, made).alarms == ()


@pytest.mark.parametrize("change", [0.35, -0.35])
def test_another_cloth_is_named_with_its_size(change: float) -> None:
    case = needles(7, 250)
    made = pierce_in_cloth(case, lambda turn: 0.0 * turn, lambda turn: np.where(turn > 150, change, 0.0), True)
    (alarm,) = watch(case, made).alarms
    assert (alarm.kind, alarm.side, alarm.size) == ("cloth", "needle", pytest.approx(change, abs=0.05))


def test_friction_is_named_beside_cloth_that_differs() -> None:
    case = needles(8, 250)
    made = pierce_in_cloth(case, lambda turn: 0.0 * turn, lambda turn: np.where(turn > 120, 0.05, 0.0), True)
    turn = (made.torque_stamps_ns - made.torque_stamps_ns[0]) * 1e-9 / 0.375
    (alarm,) = watch(case, replace(made, torque=made.torque + np.where(turn > 180, 0.6, 0.0))).alarms
    assert alarm.kind == "constant_torque" and alarm.size == pytest.approx(0.6, abs=0.06)


def test_a_machine_without_a_load_over_a_measure_has_no_such_columns() -> None:
    machine = configured_machine(case_of(LAWS["beat-up"], 1))
    assert isinstance(machine, Machine)
    assert Monitor(machine).finish().columns == {}
