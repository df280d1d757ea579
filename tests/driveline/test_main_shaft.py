"""The declaration of an elastic main shaft, in Python and in a machine file."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from pathlib import Path

import pytest

import textile_twin_core as ttc
from textile_twin_core.errors import MachineError
from textile_twin_core.files import save_machine_file
from textile_twin_core.machine import EvenShaft, Machine, MainShaft, ShaftDrive, ShaftPiece, ShaftPlace, Station

TUFTING = "machine: tufting\n"
CHAIN = TUFTING + "linkages: [{at: s1}]\nshaft:\n  stations: [{name: s0, inertia_kgm2: 1}, {name: s1}]\n  pieces: "
LONG = """machine: tufting
linkages: [{at: s1}, {at: s2, phase_rad: 0.5}]
shaft:
  stations: [{name: motor, inertia_kgm2: 0.02, viscous_Nms: 0.1}, {name: s1, inertia_kgm2: 0.01}, {name: s2}]
  pieces:
    - {from: motor, to: s1, stiffness_Nm_rad: 4.0e+5, damping_Nms_rad: 20, gear_ratio: 3, backlash_rad: 0.002}
    - {from: s1, to: s2, diameter_m: 0.06, length_m: 0.25}
  second_encoder_at: s2
  torque_sensor: [s1, s2]
  drive: {at: motor, inertia_kgm2: 1.0, slip_Nms_rad: 80}
"""


def load(folder: Path, text: str) -> Machine:
    path = folder / "m.yaml"
    path.write_text(text)
    machine = ttc.load_machine(path)
    assert isinstance(machine, Machine)
    return machine


def test_the_long_form_is_read_and_written_back(tmp_path: Path) -> None:
    machine = load(tmp_path, LONG)
    assert machine.shaft == MainShaft(
        (Station("motor", 0.02, 0.1), Station("s1", 0.01), Station("s2")),
        (
            ShaftPiece("motor", "s1", 4.0e5, 20.0, gear_ratio=3.0, backlash_rad=0.002),
            ShaftPiece("s1", "s2", diameter_m=0.06, length_m=0.25),
        ),
        second_encoder_at="s2",
        torque_sensor=("s1", "s2"),
        drive=ShaftDrive("motor", 1.0, 80.0),
    )
    assert machine.linkages == (ShaftPlace(0.0, "s1"), ShaftPlace(0.5, "s2"))
    assert machine.shaft.torque_piece == (1, 1)
    assert machine.shaft.second_encoder_station == 2
    assert machine.shaft.speed_ratios == (1.0, 1.0 / 3.0, 1.0 / 3.0)
    save_machine_file(machine, tmp_path / "again.yaml")
    again = ttc.load_machine(tmp_path / "again.yaml")
    assert again == machine
    assert pickle.loads(pickle.dumps(again)) == machine


def test_a_bar_has_the_stiffness_and_inertia_of_mechanics(tmp_path: Path) -> None:
    bar = ShaftPiece("a", "b", diameter_m=0.06, length_m=4.0)
    moment = math.pi * 0.06**4 / 32.0
    assert bar.stiffness == pytest.approx(7.9e10 * moment / 4.0, rel=1e-15)
    assert bar.bar_inertia_kgm2 == pytest.approx(0.5 * (7850.0 * math.pi * 0.03**2 * 4.0) * 0.03**2, rel=1e-14)


@pytest.mark.parametrize(
    ("linkages", "places"),
    [
        ("", [(0.0, f"s{k}") for k in range(1, 5)]),
        ("linkages: [{}]", [(0.0, "s3")]),
        ("linkages: [{phase_rad: 1}, {}]", [(1.0, "s2"), (0.0, "s4")]),
        ("linkages: [{phase_rad: 1, at: s1}, {}]", [(1.0, "s1"), (0.0, "s4")]),
    ],
)
def test_the_short_form_spreads_the_linkages(tmp_path: Path, linkages: str, places: list[tuple[float, str]]) -> None:
    text = f"{TUFTING}{linkages}\nshaft: {{diameter_m: 0.06, length_m: 4, stations: 4, drive: {{inertia_kgm2: 1}}}}"
    machine = load(tmp_path, text)
    assert [(place.phase_rad, place.at) for place in machine.linkages] == places
    assert machine.shaft == EvenShaft(0.06, 4.0, 4, drive=ShaftDrive(inertia_kgm2=1.0)).main_shaft()
    save_machine_file(machine, tmp_path / "again.yaml")
    assert ttc.load_machine(tmp_path / "again.yaml") == machine


def test_a_shaft_leaves_the_rigid_outputs_as_they_are() -> None:
    rigid = ttc.machines.tufting()
    shaft = EvenShaft(0.06, 4.0, 1)
    elastic = replace(rigid, shaft=shaft.main_shaft(), linkages=shaft.places())
    torques = [ttc.compile(m, ["balancing_torque_Nm"]).evaluate(0.7, 20.0, 3.0) for m in (rigid, elastic)]
    assert torques[0] == torques[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TUFTING + "linkages: [{at: s1}]", "linkages[0].at: 's1' is a station, but there is no shaft with stations"),
        (
            CHAIN.replace("[{at: s1}]", "[{}]") + "[{from: s0, to: s1, stiffness_Nm_rad: 1}]",
            "linkages[0]: key 'at' is missing; name the station of the shaft that carries it: s0, s1",
        ),
        (
            CHAIN.replace("{at: s1}", "{at: sl}") + "[{from: s0, to: s1, stiffness_Nm_rad: 1}]",
            "linkages[0].at: there is no station 'sl'; did you mean",
        ),
        (CHAIN + "[{from: s0, to: s9, stiffness_Nm_rad: 1}]", "pieces[0].to: there is no station 's9'; did you mean"),
        (CHAIN + "[{from: s1, to: s0, stiffness_Nm_rad: 1}]", "here stands from 's0' to 's1'"),
        (CHAIN + "[]", "pieces: the one from 's0' to 's1' is missing"),
        (CHAIN + "[{from: s0, to: s1}]", "give either stiffness_Nm_rad, or both diameter_m and length_m"),
        (CHAIN + "[{from: s0, to: s1, stiffness_Nm_rad: 1, length_m: 1}]", "give either stiffness_Nm_rad, or both"),
        (CHAIN + "[{from: s0, to: s1, stiffness_Nm_rad: -1}]", "stiffness_Nm_rad must be positive, not -1.0"),
        (
            CHAIN + "[{from: s0, to: s1, stiffness: 1}]",
            "shaft.pieces[0].stiffness: unknown key 'stiffness'; did you mean",
        ),
        (
            CHAIN + "[{from: s0, to: s1, stiffness_Nm_rad: 1}]\n  torque_sensor: [s0, s0]",
            "not the two ends of one piece",
        ),
        (CHAIN + "[{from: s0, to: s1, stiffness_Nm_rad: 1}]\n  encoder_at: s5", "encoder_at: there is no station 's5'"),
        (TUFTING + "shaft: {diameter_m: 0.06, length_m: 4, stations: 0}", "stations: must be 1 or more, not 0"),
        (
            "machine: needle_transfer\nshaft: {diameter_m: 0.06, length_m: 4, stations: 4}",
            "is no linkage; leave this out",
        ),
        (
            LONG.replace("to: s2, diameter_m: 0.06", "to: s2, gear_ratio: 2, diameter_m: 0.06"),
            "linkages[1].at: a gear between 's2' and 's1' gives their linkages two speeds",
        ),
    ],
)
def test_a_wrong_shaft_is_refused_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(MachineError) as caught:
        load(tmp_path, text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
